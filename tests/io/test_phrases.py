"""Numbers, counts and lists of names in printed sentences."""

import pytest

from abhv_mc.io.phrases import counted, grouped_digits, joined, quoted


@pytest.mark.parametrize(
    ("number", "decimals", "text"),
    [
        (0, 0, "0"),
        (1500, 0, "1500"),
        (9999.96, 1, "10\u202f000.0"),
        (10_000, 0, "10\u202f000"),
        (-1234567, 0, "-1\u202f234\u202f567"),
    ],
)
def test_digits_are_grouped_from_ten_thousand_on(number, decimals, text):
    assert grouped_digits(number, decimals) == text


@pytest.mark.parametrize(
    ("count", "noun", "text"),
    [
        (0, "flight", "0 flights"),
        (1, "flight", "1 flight"),
        (2, "random flight", "2 random flights"),
        (1, "axis/axes", "1 axis"),
        (3, "flight fails/flights fail", "3 flights fail"),
    ],
)
def test_a_noun_agrees_with_its_count(count, noun, text):
    assert counted(count, noun) == text


def test_a_list_ends_with_a_conjunction():
    assert joined([]) == "" and joined(["a"]) == "a"
    assert joined(["a", "b", "c"], "or") == "a, b or c"
    assert quoted(["a", "b"]) == "'a' and 'b'"
    assert quoted([]) == "none"
