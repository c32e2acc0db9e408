"""Verdicts of a campaign, and the chart of the flights beside their limits."""

from dataclasses import replace

import pytest

from abhv_mc.report.pages.first_screen import chart_rows
from abhv_mc.statistics import judge
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import GlanceCell


@pytest.fixture(scope="module")
def verdicts(failing):
    return Models(failing)[VERDICTS]


def test_a_flight_that_ended_early_misses_every_requirement(verdicts):
    altitude = verdicts.requirements[0].controllers
    assert altitude["lqr"].failures == altitude["lqr"].ended_early == 12
    assert altitude["lqr"].status == judge(12, 100, 0.9973).status == "FAIL"
    assert altitude["tlc"].status == "NOT SHOWN"


def test_the_chart_prints_the_tolerance_limit_and_its_room(verdicts):
    """It printed the median, unlabelled, at its right edge."""
    lost = float("inf")
    cells = {
        "tlc": GlanceCell(0.2, 0.4, 0.6, 0.65),
        "lqr": GlanceCell(0.5, 0.98, 1.4, 1.57),
        "lqr_retuned": GlanceCell(0.5, lost, lost),
    }
    names = dict.fromkeys(cells, "")
    ((_, bars),) = chart_rows([replace(verdicts.glance[2], cells=cells)], names, names)
    assert [bar.edge for bar in bars] == ["0.650 deg, 7.1\u202f% to spare", "1.57 deg, 124\u202f% over", "lost"]
    assert [(bar.median is None, bar.tolerance is None, bar.beyond) for bar in bars] == [
        (False, False, False), (True, True, True), (True, True, True)]  # fmt: skip
