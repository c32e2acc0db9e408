"""Margins of a flexible vehicle against the growth of small disturbances in its flights."""

from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.flight.fly import fly_until
from abhv_mc_vehicle.flight.vehicle_parameters import vehicle_parameters
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.stability.linearize import closed_loop, linearize
from abhv_mc_vehicle.stability.points import closed_states, disturb, flown_points
from abhv_mc_vehicle.stability.probe import plant_states

TICK, TICKS = 20, 100


# The last case has frequency times step = 0.25.
@pytest.mark.parametrize(
    ("damping", "mode", "steps"), [(0.02, 19.0, 5), (0.03, 19.0, 5), (0.02, 25.0, 1)]
)
def test_growth_of_a_disturbance_is_that_of_the_pole(damping, mode, steps):
    plan = make_flight_plan("flexible", "flexible", "tlc")
    known = vehicle_parameters(plan.vehicle_code)
    rows = {name: getattr(plan, name)[: TICK + TICKS + 1] for name in ("reference", "gains")}
    rows |= {name: np.repeat(value[:1], len(value), axis=0) for name, value in rows.items()}
    timing = Timing(plan.timing.tick / steps, steps, TICK + TICKS)
    plan = replace(plan, timing=timing, **rows)

    def rows_of(excitation):
        row = known.nominal[None].copy()
        for i in (1, 2, 3):
            row[0, known.index[f"dynamics.excitation_{i}"]] *= excitation
        row[0, known.index["dynamics.damping_1"]] = damping
        row[0, known.index["dynamics.frequency_1"]] = mode
        return row

    def pole_of(row):
        """Growth (1/s) of the mode, and what projects states on it."""
        closed = closed_loop(
            linearize(plan, flown_points(plan, row, TICK * plan.timing.tick).points), 0
        )
        values, vectors = np.linalg.eig(closed.T)
        poles = np.log(values.astype(complex)) / plan.timing.tick
        i = np.abs(poles - 1j * mode).argmin()
        return poles[i].real, vectors[:, i]

    row = rows_of(1.0)
    growth, projection = pole_of(row)
    change = np.zeros(len(projection))
    change[plant_states(plan.vehicle).index("state.mode_1")] = 1e-7
    kept = fly_until(plan, row, TICK)
    ends = []
    for start in (kept, disturb(plan, kept, change)):
        ends.append(closed_states(plan, fly_until(plan, row, TICK + TICKS, start))[0])
    flown = np.log(abs(projection @ (ends[1] - ends[0])) / abs(projection @ change))
    flown /= TICKS * plan.timing.tick
    slope = (
        pole_of(rows_of(10.0 ** (0.5 / 20.0)))[0] - growth
    ) / 0.5  # 1/s for a decibel of the loop
    assert slope > 0.01
    assert abs(flown - growth) < 0.05 * slope
