"""Sentences say what the numbers say, and nothing that inverts them."""

from dataclasses import replace

import numpy as np

from abhv_mc.statistics.looks import judge_at_looks, judge_by_plan
from abhv_mc.statistics.sequential import choose_looks, make_sequential_plan
from abhv_mc.statistics.verdict_words import counts_words, needed_words, risk_words, verdict_words
from abhv_mc.statistics.verdicts import judge


def test_the_risk_is_of_the_rule():
    assert risk_words(0.1) == (
        "a system that just misses the requirement would PASS with a probability of at most 10 %"
    )
    assert risk_words(0.05, looks=True).endswith("5 %, however often it was looked at")


def test_both_counts_stand_with_their_meaning():
    """Never '89 failures in 5000, PASS'."""
    plan = make_sequential_plan(choose_looks(0.9973, 0.1, 5000), 0.9973, 0.1)
    missed = np.zeros(5000, dtype=bool)
    missed[2000:2089] = True
    verdict = judge_by_plan(missed, np.zeros(5000, dtype=bool), plan)
    words = verdict_words(verdict, int(missed.sum()), missed.size)
    assert words.startswith(f"PASS: 0 failures in {verdict.runs} flights; 89 failures in all 5000 flights, those after")
    assert "no part of the verdict" in words


def test_uncomputed_flights_are_told():
    verdict = judge(0, 1000, 0.9973, 0.1, uncomputed=148)
    assert counts_words(verdict) == (
        "148 failures in 1000 flights, 148 of them flights that the machine could not compute"
    )
    assert verdict_words(verdict).startswith("FAIL (provisional): ")
    assert "would be another one" in verdict_words(verdict)


def test_what_is_needed_is_a_new_campaign():
    verdict = judge(1, 1000, 0.9973, 0.1)
    assert needed_words(verdict) == (
        "a new campaign (another seed) of 1440 flights with at most 1 failure would PASS, or 'stop: when proven'"
    )
    assert "without a failure" in needed_words(judge(0, 100, 0.9973, 0.1))
    assert "more of its flights failed" in needed_words(judge(4, 1000, 0.9973, 0.1))


def test_estimates_say_why():
    none = np.zeros(1440, dtype=bool)
    words = verdict_words(judge_at_looks(none, none, (700, 1440), 0.9973))
    assert words.startswith("ESTIMATE: 0 failures in 1440 flights; the campaign was extended from 700 to 1440 flights")


def test_probabilities_never_round_to_certainty():
    verdict = replace(judge(0, 10_000, 0.9973), met=0.9999999)
    assert "99.99999 %" in verdict_words(verdict)
    assert "98 %" in verdict_words(replace(verdict, met=0.98))
    assert "a probability of less than 0.0001 %" in verdict_words(replace(verdict, met=2.3e-58))
