"""Extremes over every tick, bit for bit against complete histories."""

import dataclasses

import numpy as np
import pytest
from fake_flight import around
from short_flights import short_plan

from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.flight.fly_lanes import COMPACTION
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX

TICKS = COMPACTION + 111  # lanes are compacted once, in the middle of a bin of some widths
FLIGHTS = 2 * LANES + 5


@pytest.fixture(scope="module")
def plans():
    """Plans whose altitude limit ends some flights early."""
    plans = {name: short_plan(TICKS, name) for name in ("tlc", "lqr")}
    tight = {"altitude_max": 20_001.5}
    return {
        name: dataclasses.replace(plan, limits=plan.limits._replace(**tight))
        for name, plan in plans.items()
    }


@pytest.fixture(scope="module")
def dispersed():
    generator = np.random.default_rng(18)
    rows = nominal_parameters(FLIGHTS)
    for name, width in (
        ("aero.lift", 0.2),
        ("initial.sideslip", 0.003),
        ("wind.east", 8.0),
        ("initial.bank", 0.3),
    ):
        rows[:, PARAMETER_INDEX[name]] += generator.uniform(-width, width, FLIGHTS)
    rows[::13, PARAMETER_INDEX["failure.rudder.stuck_time"]] = 4.0
    rows[7, PARAMETER_INDEX["mass.total"]] = np.nan  # breaks before its first sample counts
    return rows


@pytest.fixture(scope="module")
def histories(plans, dispersed):
    """Every channel at every tick."""
    return {law: fly(plan, dispersed, 1) for law, plan in plans.items()}


ALL, SOME = (LANES, slice(None)), pytest.param((1, slice(4, 9)), marks=pytest.mark.thorough)


@pytest.mark.parametrize("law", ["tlc", "lqr"])
@pytest.mark.parametrize("every", [1, 7, 20, 300, TICKS + 1])
@pytest.mark.parametrize("flown", [ALL, SOME], ids=["abreast", "alone"])
def test_extremes_equal_those_of_complete_histories(plans, dispersed, histories, law, every, flown):
    (lanes, rows), histories = flown, histories[law]
    ends = np.unique(histories.end_time)
    assert (histories.outcome == Outcome.NOT_FINITE).any()
    assert ((ends > 0.1) & (ends < 6.0)).any() and (histories.outcome == Outcome.OK).any()
    for channels in (tuple(range(len(CHANNELS))), (11, 3, 3, 0)):
        recording = Recording(every, channels, extremes=True)
        extremes = fly(plans[law], dispersed[rows], recording, lanes=lanes)
        history = histories.history[rows][:, :, channels]
        np.testing.assert_array_equal(extremes.history, history[:, ::every])
        for side, extreme in ((extremes.low, np.fmin), (extremes.high, np.fmax)):
            expected = around(history, every, extreme)
            assert side.dtype == np.float32
            assert side.tobytes() == expected.tobytes()  # -0 and 0 are one
        for name in ("outcome", "end_time", "metrics"):
            assert getattr(extremes, name).tobytes() == getattr(histories, name)[rows].tobytes()
