"""Equilibria of controllers that do not maintain the trim, e.g. without integrators.

The limits of a custom controller are in its code. At the trim, a controller that does not maintain
it may be saturated: NASA's F-16 controller commands full aft stick at an altitude error of two
metres. Derivatives at a saturated point do not describe a closed loop.
"""

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant.parameter_names import NEVER
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.periods import find_period, over_period
from abhv_mc_vehicle.stability.plant_inputs import held_at, mixes, solved_states
from abhv_mc_vehicle.stability.point_slopes import Points, Slopes, newton_step, plant_slopes

_ITERATIONS = 40
_AT_REST = 1e-8  # tolerance of rates, changes of memory, and commands minus controls
_ROUNDING = 1e-8  # rounding error of the controller's slopes with respect to the measurement
_LOST = 1e-3  # relative slope below which the controller counts as saturated
_MEASURED = 11  # index of the first measurement in the result of plant_slopes


def leave_limits(plan: FlightPlan, points: Points, at_errors_zero: Floats) -> tuple[Points, Mask]:
    """Move saturated points to an equilibrium; also return a mask of points still saturated."""
    free = over_period(plan, points._replace(measured=at_errors_zero))
    limited = is_off_trim = _limited(plan, points, free)
    if plan.vehicle.constants.driven and not mixes(
        plan
    ):  # The mixing matrix alone does not determine the equilibrium.
        command = over_period(plan, points).value[:, points.memory.shape[1] :]
        is_off_trim = limited | (np.abs(command - points.controls) > _AT_REST).any(axis=1)
    rows = np.flatnonzero(is_off_trim)
    if not rows.size:
        return points, limited
    some = points._replace(**{name: getattr(points, name)[rows] for name in Points._fields[:-1]})
    free = Slopes(free.value[rows], free.slope[rows], free.uneven[rows])
    equilibria, at_rest = _come_to_rest(plan, some, free)
    at_rest &= ~_limited(plan, equilibria, free)
    for name in ("path", "controls", "custom", "measured", "memory"):
        getattr(points, name)[rows[at_rest]] = getattr(equilibria, name)[at_rest]
    limited[rows] &= ~at_rest
    return points, limited


def _moves(plan: FlightPlan, points: Points) -> Mask:
    """Return a mask [point, input] of the inputs that the controller moves."""
    free = held_at(plan.vehicle, points.lane) == NEVER
    return np.hstack([free, np.ones((len(free), 1), bool)])


def _limited(plan: FlightPlan, points: Points, free: Slopes) -> Mask:
    present = over_period(plan, points)
    strength, free_strength = (
        _strengths(slopes.slope[:, points.memory.shape[1] :]) for slopes in (present, free)
    )
    lost = (free_strength > _ROUNDING) & (strength < _LOST * free_strength)
    return np.asarray((lost.any(axis=2) & _moves(plan, points)).any(axis=1))


def _strengths(slope: Floats) -> Floats:
    """Return norms [point, input, 2] of the slopes over speed, and over angles and rates."""
    angles = np.linalg.norm(slope[:, :, path.GAMMA : path.R + 1], axis=2)
    return np.stack([np.abs(slope[:, :, path.SPEED]), angles], axis=2)


def _come_to_rest(plan: FlightPlan, points: Points, free: Slopes) -> tuple[Points, Mask]:
    """Return equilibria with a constant heading rate, and a mask of the converged points."""
    m, n = points.memory.shape[1], points.measured.shape[1]
    law_measured, law_memory = (
        free.slope[:, :, :n],
        free.slope[:, :, n:] - np.eye(free.slope.shape[1], m),
    )
    moves, k, own = _moves(plan, points), 10 + points.controls.shape[1], solved_states(plan)
    seen = slice(_MEASURED, _MEASURED + n)
    columns = [*range(k), *(k + own)]  # columns of path, controls and custom states
    for iteration in range(_ITERATIONS + 1):
        plant = plant_slopes(plan, points)
        frozen = (plant.slope[:, seen] == 0.0).all(axis=2)
        points = points._replace(measured=np.where(frozen, points.measured, plant.value[:, seen]))
        memory, command = np.split(over_period(plan, points).value, [m], axis=1)
        memory = np.where(find_period(plan).carried, points.memory, memory)
        rates = plant.value[:, :10].copy()
        rates[:, path.CHI] -= plan.reference[0, ref.HEADING_RATE]
        mismatch = np.where(moves, command - points.controls, 0.0)
        left = np.hstack([rates, memory - points.memory, mismatch, plant.value[:, seen.stop + own]])
        at_rest = np.asarray(np.abs(left).max(axis=1) < _AT_REST)
        if iteration == _ITERATIONS or at_rest.all():
            break
        J, j = np.zeros((*left.shape, k + own.size + m)), k + own.size
        law = slice(10, m + k)  # rows of the controller's memory and commands
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
