"""Sentences say what the numbers say, and nothing that inverts them."""

import pytest

from abhv_mc.statistics.verdict_words import verdict_words
from abhv_mc.statistics.verdicts import judge


@pytest.mark.parametrize(
    ("failures", "flights", "words"),
    [
        (0, 1000, "PASS: 0 failures in 1000 flights"),
        (1, 1000, "NOT SHOWN: 1 failure in 1000 flights; extend to 2235 flights (--runs 2235): passes if none of the "
                  "added flights fails, 29 % at today's rate"),
        (0, 500, "NOT SHOWN: 0 failures in 500 flights; extend to 981 flights (--runs 981): passes if none of the "
                 "added flights fails"),
        (29, 8000, "NOT SHOWN: 29 failures in 8000 flights; more of its flights failed than the requirement allows"),
        (30, 1000, "FAIL: 30 failures in 1000 flights"),
    ],
)  # fmt: skip
def test_words(failures, flights, words):
    assert verdict_words(judge(failures, flights, 0.9973, 0.10)) == words


def test_uncomputed_flights_are_told():
    assert "148 of them not computed" in verdict_words(judge(0, 1000, 0.9973, 0.1, uncomputed=148))
