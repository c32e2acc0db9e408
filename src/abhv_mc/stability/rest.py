"""Where a flight comes to rest under a law that does not hold the trim: without integrals it keeps an error.

A law of the user's own has its limits in its code. At a trim that it does not hold it may stand behind one of them, as
NASA's F-16 does with its stick full aft at an error of two metres of altitude; its slopes there are no closed loop's.
"""

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.laws import columns as ref
from abhv_mc.kernel.plant.parameter_names import NEVER
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.periods import find_period, over_period
from abhv_mc.stability.plant_inputs import held_at, mixes, solved_states
from abhv_mc.stability.point_slopes import Points, Slopes, newton_step, plant_slopes

_ITERATIONS = 40
_AT_REST = 1e-8  # of all rates, of the memory's change in a tick and of what commands and controls differ by
_ROUNDING = 1e-8  # of the law's slopes over the measurement
_LOST = 1e-3  # of a slope, what is left of it behind a limit
_MEASURED = 11  # the first measurement of what plant_slopes gives


def leave_limits(plan: FlightPlan, points: Points, at_errors_zero: Floats) -> tuple[Points, Mask]:
    """Trims, or where a law behind a limit of its code comes to rest; which stay behind it [point]."""
    free = over_period(plan, points._replace(measured=at_errors_zero))
    limited = apart = _limited(plan, points, free)
    if plan.vehicle.constants.driven and not mixes(plan):  # no mix says where it rests
        command = over_period(plan, points).value[:, points.memory.shape[1] :]
        apart = limited | (np.abs(command - points.controls) > _AT_REST).any(axis=1)
    rows = np.flatnonzero(apart)
    if not rows.size:
        return points, limited
    some = points._replace(**{name: getattr(points, name)[rows] for name in Points._fields[:-1]})
    free = Slopes(free.value[rows], free.slope[rows], free.uneven[rows])
    found, at_rest = _come_to_rest(plan, some, free)
    at_rest &= ~_limited(plan, found, free)
    for name in ("path", "controls", "custom", "measured", "memory"):
        getattr(points, name)[rows[at_rest]] = getattr(found, name)[at_rest]
    limited[rows] &= ~at_rest
    return points, limited


def _moves(plan: FlightPlan, points: Points) -> Mask:
    """Whether the law moves each of the inputs, [point, input]."""
    free = held_at(plan.vehicle, points.lane) == NEVER
    return np.hstack([free, np.ones((len(free), 1), bool)])


def _limited(plan: FlightPlan, points: Points, free: Slopes) -> Mask:
    now = over_period(plan, points)
    here, at_zero = (_strengths(each.slope[:, points.memory.shape[1] :]) for each in (now, free))
    lost = (at_zero > _ROUNDING) & (here < _LOST * at_zero)
    return np.asarray((lost.any(axis=2) & _moves(plan, points)).any(axis=1))


def _strengths(slope: Floats) -> Floats:
    """How much the speed, and all angles and rates together, move each command, [point, input, 2]."""
    angles = np.linalg.norm(slope[:, :, path.GAMMA : path.R + 1], axis=2)
    return np.stack([np.abs(slope[:, :, path.SPEED]), angles], axis=2)


def _come_to_rest(plan: FlightPlan, points: Points, free: Slopes) -> tuple[Points, Mask]:
    """Where nothing but the heading changes under the law, and whether [point], by Newton's method."""
    m, n = points.memory.shape[1], points.measured.shape[1]
    law_measured, law_memory = (
        free.slope[:, :, :n],
        free.slope[:, :, n:] - np.eye(free.slope.shape[1], m),
    )
    moves, k, own = _moves(plan, points), 10 + points.controls.shape[1], solved_states(plan)
    seen = slice(_MEASURED, _MEASURED + n)
    columns = [*range(k), *(k + own)]  # of path, controls and custom states
    for iteration in range(_ITERATIONS + 1):
        plant = plant_slopes(plan, points)
        frozen = (plant.slope[:, seen] == 0.0).all(axis=2)
        points = points._replace(measured=np.where(frozen, points.measured, plant.value[:, seen]))
        memory, command = np.split(over_period(plan, points).value, [m], axis=1)
        memory = np.where(find_period(plan).carried, points.memory, memory)
        rates = plant.value[:, :10].copy()
        rates[:, path.CHI] -= plan.reference[0, ref.HEADING_RATE]
        apart = np.where(moves, command - points.controls, 0.0)
        left = np.hstack([rates, memory - points.memory, apart, plant.value[:, seen.stop + own]])
        at_rest = np.asarray(np.abs(left).max(axis=1) < _AT_REST)
        if iteration == _ITERATIONS or at_rest.all():
            break
        J, j = np.zeros((*left.shape, k + own.size + m)), k + own.size
        law = slice(10, m + k)  # rows of the law's memory and commands
        J[:, :10, :j] = plant.slope[:, :10, columns]
        J[:, law, :j] = law_measured @ plant.slope[:, seen][:, :, columns]
        J[:, law, j:] = law_memory
        J[:, 10 + m : m + k][~moves] = 0.0
        J[:, 10 + m : m + k, 10:k] -= np.eye(k - 10)
        J[:, m + k :, :j] = plant.slope[:, seen.stop + own][:, :, columns]
        step = np.where(at_rest[:, None], 0.0, newton_step(J, left))
        custom = points.custom.copy()
        custom[:, own] -= step[:, k:j]
        points = points._replace(
            path=points.path - step[:, :10],
            controls=points.controls - step[:, 10:k],
            custom=custom,
            memory=points.memory - step[:, j:],
        )
    return points, at_rest
