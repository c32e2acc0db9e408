"""Survival after a failure, and the sentences about it."""

import numpy as np
import pytest

from abhv_mc.report.numbers.failure_cases import failure_case_rows, failure_case_sentence, still_flying
from abhv_mc.report.numbers.parameters import shown_value


def test_still_flying_is_kaplan_and_meiers_estimate():
    after = np.array([1.0, 2.0, 2.0, 3.0, 5.0])  # the third's and the last's missions were over
    lost = np.array([True, True, False, True, False])
    share = still_flying(after, lost, np.array([0.5, 1.0, 2.5, 4.0, 6.0]))
    assert share[:4] == pytest.approx([1.0, 0.8, 0.8 * 3 / 4, 0.8 * 3 / 4 * 1 / 2])
    assert np.isnan(share[4])
    everyone = still_flying(after[:2], lost[:2], np.array([0.0, 10.0]))
    assert everyone.tolist() == [1.0, 0.0]


def _cell(flights, lost):
    survived = {"value": 1.0 - lost / flights, "low": 0.1, "high": 0.9}
    found = {"missed": lost, "status": "FAIL"}
    return {"flights": flights, "lost": lost, "survived": survived, "median_time_to_loss_s": 2.5,
            "requirements": {"altitude < 50 m": found}}  # fmt: skip


def test_sentences_count_the_flights_of_single_failures():
    cases = [
        {"case": "none", "flights": 9, "controllers": {"tlc": _cell(9, 0)}},
        {"case": "engine failed", "flights": 7, "controllers": {"tlc": _cell(7, 0), "lqr": _cell(7, 3)}},
        {"case": "elevator stuck", "flights": 4, "controllers": {"tlc": _cell(4, 4)}},
        {"case": "elevator stuck + engine failed", "flights": 2, "controllers": {"tlc": _cell(2, 1)}},
    ]
    labels = {"tlc": "TLC", "lqr": "LQR (paper's weights)"}
    assert failure_case_sentence({"cases": cases}, labels) == (
        "Flights that survived one failure alone: engine failed: TLC 7 of 7, LQR (paper's weights) 4 of 7; "
        "elevator stuck: TLC 0 of 4."
    )
    row = failure_case_rows({"cases": cases})[1]
    assert [cell["controller"] for cell in row["cells"]] == ["TLC", "LQR"]
    assert row["cells"][0]["verdicts"] == ["altitude < 50 m: missed by 0, FAIL"]
    assert failure_case_rows({}) == []
    assert failure_case_sentence({}, labels) == ""


def test_a_failure_that_never_comes_is_said_so():
    assert shown_value("failure.engine.time", None) == "never"
    assert shown_value("failure.elevator.stuck_at", np.inf) == "where it is"
    assert shown_value("failure.engine.duration", None) == "for good"
    assert shown_value("failure.engine.time", 12.0).startswith("12")
