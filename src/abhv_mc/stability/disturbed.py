"""Full flights from a kept state with a small disturbance: what a linear model's closed loop must predict."""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.arguments import Kept
from abhv_mc.flight.fly import fly_until
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.effectors import POSITION, STAGE
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.plant_inputs import actuator_columns, as_axes
from abhv_mc.stability.probe import begin, law_at, law_memory_rows


def closed_states(plan: FlightPlan, kept: Kept) -> Floats:
    """States [flight, n + memory] of the closed loop: path coordinates, actuators, the law's memory; as flown."""
    now = kept.rows[:, s.X : s.X + s.N_STATES]
    memory = law_at(plan, begin(plan, kept)[0], kept.tick)
    return np.hstack([path.make_path(now), kept.rows[:, actuator_columns(plan.vehicle)], memory])


def disturb(plan: FlightPlan, kept: Kept, change: Floats) -> Kept:
    """The same flights with ``change`` [n + memory] added to the closed loop's states, but a law's at tick 0."""
    rows, there = kept.rows.copy(), closed_states(plan, kept) + change
    states = rows[:, s.X : s.X + s.N_STATES]
    columns = np.array(actuator_columns(plan.vehicle))
    n = 10 + len(columns)
    shown = as_axes(plan.vehicle, there[:, 10:n:2])
    moved = path.make_states(there[:, :10], shown, states[:, s.LATITUDE], states[:, s.MASS])
    moved[:, s.LONGITUDE] = states[:, s.LONGITUDE]
    rows[:, s.X : s.X + s.N_STATES] = rows[:, s.XS : s.XS + s.N_STATES] = moved
    rows[:, columns] = there[:, 10:n]
    if plan.vehicle.constants.driven:
        rows[:, columns[:-2:2] + STAGE - POSITION] = there[:, 10 : n - 2 : 2]
    rows[:, list(law_memory_rows(plan).values())] = there[:, n:]
    return Kept(kept.tick, rows)


def fly_disturbed(plan: FlightPlan, parameters: Floats, tick: int, change: Floats, ticks: int) -> Floats:
    """States [tick, n + memory] of one flight's closed loop from ``tick`` on, with ``change`` added to the first."""
    kept = disturb(plan, fly_until(plan, parameters, tick), change)
    found = [closed_states(plan, kept)[0]]
    for later in range(tick + 1, min(tick + ticks, plan.timing.ticks) + 1):
        kept = fly_until(plan, parameters, later, kept)
        found.append(closed_states(plan, kept)[0])
    return np.array(found)
