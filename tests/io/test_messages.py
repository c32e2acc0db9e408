"""Numbers, counts and lists of names in printed sentences."""

import pytest

from abhv_mc.io.messages import grouped_digits


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
