"""Points of linearization along flights, and warnings about points near table nodes.

A disturbed flight can be continued from a point to verify a linear model.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.arguments import SavedFlights
from abhv_mc_vehicle.flight.fly import fly_until
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.flight.interface import Z_ROWS
from abhv_mc_vehicle.kernel.flight.observe import ALIVE
from abhv_mc_vehicle.kernel.laws.columns import N_LIMITS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuators import POSITION, STAGE
from abhv_mc_vehicle.kernel.plant.vehicle import NEVER, VARIABLES, Tables
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.point_slopes import SWITCHES, Points, ask_at, over_period, switching
from abhv_mc_vehicle.stability.probe import (
    actuator_columns,
    as_axes,
    begin,
    custom_of,
    held_at,
    law_at,
    law_memory_rows,
    law_tick,
    range_of,
)

AT_LIMIT = "a command is at a limit"
_STATES = slice(s.X, s.X + s.N_STATES)  # states in the kernel's memory


class Found(NamedTuple):
    """Points of linearization, and the fault of each (empty if none)."""

    points: Points
    faults: list[str]


def flown_points(plan: FlightPlan, parameters: Floats, time: float) -> Found:
    """Return the points of flights [flight, parameter] at the tick nearest to `time` (s).

    A flight that has ended is represented by its start and marked by a fault.
    """
    tick = min(round(time / plan.timing.tick), plan.timing.ticks)
    saved = fly_until(plan, parameters, tick)
    finite = np.isfinite(saved.rows[:, _STATES]).all(axis=1)
    ended = ~finite | (saved.rows[:, Z_ROWS + ALIVE] == 0.0)
    # Flights that have ended get finite values as placeholders, which are not reported.
    if ended.any():
        saved.rows[ended] = fly_until(plan, parameters[ended], 0).rows
    sensed, lane = begin(plan, saved)
    now = lane[:, _STATES]
    points = Points(
        path=path.make_path(now),
        controls=saved.rows[:, actuator_columns(plan.vehicle)[::2]],
        latitude=now[:, s.LATITUDE],
        mass=now[:, s.MASS],
        measured=sensed[:, s.MEASURED : s.MEASURED + measured_count(plan)],
        memory=law_at(plan, sensed, tick),
        lane=lane,
        custom=custom_of(plan.vehicle, lane),
        tick=tick,
    )
    limited = behind_limit(plan, points)
    switches = np.zeros(len(ended), bool)
    if plan.law in USER_LAWS:
        switches = switching(plan, over_period(plan, points))
    reasons = [f"the flight has ended before {time:g} s", SWITCHES, AT_LIMIT]
    return Found(points, np.select([ended, switches, limited], reasons, "").tolist())


def behind_limit(plan: FlightPlan, points: Points) -> Mask:
    """Return a mask [point] of points with commands beyond controller or vehicle limits."""
    free = law_tick(plan, points.tick, points.measured, points.memory)
    low, high = range_of(plan.vehicle)
    outside = (free.command < low) | (free.command > high)
    outside[:, :-1] &= held_at(plan.vehicle, points.lane) == NEVER
    beyond = np.asarray(outside.any(axis=1))
    if (
        plan.commanding_law in USER_LAWS
    ):  # The limits on angle of attack and bank are applied inside the controller's code.
        return beyond
    low, high, bank = plan.settings[-N_LIMITS:][:3]
    alpha = free.guidance[:, 1]
    sigma = np.abs(free.guidance[:, 2])
    return beyond | (alpha < low) | (alpha > high) | (sigma > bank)


_NEAR = 0.02  # largest distance to a node that counts as near, in cell lengths
_DEGREES = ("angle_of_attack", "sideslip", "aileron", "rudder", "elevator")


def near_nodes(plan: FlightPlan, points: Points) -> list[str]:
    """Return a sentence for each variable of the first point that is near a table node."""
    first = points.path[:1], points.controls[:1], points.custom[:1]
    variables = ask_at(plan, points, *first, point=np.zeros(1, np.int64))[0].variables
    sentences = _near("the vehicle's tables", plan.vehicle.tables, variables[0])
    if plan.commanding_law == "tlc":
        answer = law_tick(plan, points.tick, points.measured[:1], points.memory[:1])
        sentences += _near("the tables at trim", plan.trim_tables, answer.guided[0])
    return list(dict.fromkeys(sentences))


def _near(owner: str, tables: Tables, variables: Floats) -> list[str]:
    sentences = []
    for start, length, variable in zip(
        tables.axis_start, tables.axis_length, tables.axis_variable, strict=True
    ):
        name = VARIABLES[variable]
        x = variables[variable]
        if name == "one":
            continue
        grid = tables.grid[start : start + length]
        nearest = int(np.abs(grid - x).argmin())
        cell = min(max(int(np.searchsorted(grid, x, side="right")) - 1, 0), length - 2)
        if abs(grid[nearest] - x) < _NEAR * (grid[cell + 1] - grid[cell]):
            value, node = np.rad2deg((x, grid[nearest])) if name in _DEGREES else (x, grid[nearest])
            unit = " deg" if name in _DEGREES else ""
            sentences.append(
                f"{name} {value:.4f}{unit} lies near the node {node:.4f}{unit} of {owner}, so its "
                "slopes are one-sided"
            )
    return sentences


def closed_states(plan: FlightPlan, saved: SavedFlights) -> Floats:
    """Return the closed-loop states [flight, n + memory] of simulated flights.

    The states are path coordinates, actuators, custom states and the controller's memory.
    """
    now = saved.rows[:, _STATES]
    memory = law_at(plan, begin(plan, saved)[0], saved.tick)
    moving = saved.rows[:, actuator_columns(plan.vehicle)], custom_of(plan.vehicle, saved.rows)
    return np.hstack([path.make_path(now), *moving, memory])


def disturb(plan: FlightPlan, saved: SavedFlights, change: Floats) -> SavedFlights:
    """Return saved flights with `change` [n + memory] added to the closed-loop states.

    The controller's memory at tick 0 cannot be changed.
    """
    rows = saved.rows.copy()
    disturbed = closed_states(plan, saved) + change
    states = rows[:, _STATES]
    columns = np.array(actuator_columns(plan.vehicle))
    n = 10 + len(columns)
    axes = as_axes(plan.vehicle, disturbed[:, 10:n:2])
    moved = path.make_states(disturbed[:, :10], axes, states[:, s.LATITUDE], states[:, s.MASS])
    moved[:, s.LONGITUDE] = states[:, s.LONGITUDE]
    rows[:, _STATES] = rows[:, s.XS : s.XS + s.N_STATES] = moved
    rows[:, columns] = disturbed[:, 10:n]
    if plan.vehicle.constants.driven:
        rows[:, columns[:-2:2] + STAGE - POSITION] = disturbed[:, 10 : n - 2 : 2]
    last = n + plan.vehicle.foreign.states
    for first in (s.CUSTOM_STATE, s.CUSTOM_STAGE):
        rows[:, first : first + last - n] = disturbed[:, n:last]
    rows[:, list(law_memory_rows(plan).values())] = disturbed[:, last:]
    return SavedFlights(saved.tick, rows)


def fly_disturbed(
    plan: FlightPlan, parameters: Floats, tick: int, change: Floats, ticks: int
) -> Floats:
    """Return the closed-loop states [tick, n + memory] of a flight disturbed at `tick`."""
    saved = disturb(plan, fly_until(plan, parameters, tick), change)
    history = [closed_states(plan, saved)[0]]
    for later in range(tick + 1, min(tick + ticks, plan.timing.ticks) + 1):
        saved = fly_until(plan, parameters, later, saved)
        history.append(closed_states(plan, saved)[0])
    return np.array(history)
