"""Figures that explain single flights."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.report.figures.searches import FLIGHT_PANELS
from abhv_mc.report.pages.single_flights import make_explained_figure
from abhv_mc_vehicle.plant.parameters import OURS


@pytest.mark.parametrize(("ended", "until"), [([5, 5], 28), ([5, 0], 14), ([0, 5], 14)])
def test_the_axis_ends_at_twice_the_last_early_end_or_with_the_flight(ended, until):
    """The last two flights end at 10 and 14 s, early if their outcome is not 0."""
    times = np.arange(61.0)
    history = np.ones((3, 61, len(FLIGHT_PANELS)))
    block = SimpleNamespace(
        times=times, history=history, end_time=np.array([60, 10, 14]), outcome=np.array([0, *ended])
    )
    explanation = SimpleNamespace(
        block=block,
        channels=[SimpleNamespace(name=name) for name, *_ in FLIGHT_PANELS],
        flight=7,
        controller="tlc",
        causes=("aero.lift",),
        samples={"aero.lift": 1.1},
        known=OURS,
        failure=SimpleNamespace(words="failed"),
    )
    curve = make_explained_figure(explanation).axes[0].lines[0]
    assert curve.get_xdata()[-1] == until
