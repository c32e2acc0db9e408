"""The flight under control as a linear sampled system, about points of it: the plant and the law, apart and closed.

Continuous plant in path coordinates; surfaces and engine of second order without limits; exact zero-order hold over
the control period; the law as the slopes of its own compiled tick with its memory. Arrays have the point first.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.flight.sensors import MAX_DELAY_TICKS
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import NEVER
from abhv_mc.kernel.plant.vehicle import MAX_EFFECTORS
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.periods import law_phases
from abhv_mc.stability.probe import check_linear
from abhv_mc.stability.sensing import add_sensors
from abhv_mc.stability.slopes import Points, plant_slopes
from abhv_mc.vehicle.model import drive_axes

INPUTS = ("aileron", "rudder", "elevator", "equivalence_ratio")
ACTUATOR_STATES = tuple(f"{name}{part}" for name in INPUTS for part in ("", "_rate"))
PLANT_STATES = (*path.COORDINATES, *ACTUATOR_STATES)
_N_PATH = len(path.COORDINATES)
_AIR_SIDESLIP = _N_PATH  # behind the rates, in what plant_slopes gives
_WHOLE = 1e-7  # how near to a whole number a slope of the measurement is taken for one
_AT_ONCE = 1e5  # rad/s: of an ideal actuator, with a damping of 1: 0.02 ms late
_FELT = 1e-8  # slope of a rate over a control, of which rounding leaves some

# Why an input has no loop.
STUCK, NO_EFFECT = 1, 2
REASONS = {STUCK: "stuck", NO_EFFECT: "no effect"}


class Linear(NamedTuple):
    """Linear models, one for each point; discrete ones are x+ = A x + B u, y = C x + D u at the control rate."""

    period: float  # s, of the control
    plant_A: Floats  # [point, 10, 10] continuous, path coordinates
    plant_B: Floats  # [point, 10, 4] continuous, positions of surfaces and engine
    A: Floats  # [point, 18, 18] discrete, path coordinates and actuators
    B: Floats  # [point, 18, 4] commands
    law_A: Floats  # [point, memory, memory], sensors' states behind the law's
    law_B: Floats  # [point, memory, 10] measurement
    law_C: Floats  # [point, 4, memory] commands
    law_D: Floats  # [point, 4, 10]
    delay: Ints  # [point] age of the measurement, control periods
    sense: Floats  # [point, 10, 18] measurement, delay apart; a frozen one is a row of zeros
    cut: Ints  # [point, 4] STUCK or NO_EFFECT where an input has no loop, else 0
    phases: "tuple[Linear, ...]" = ()  # of a law of several rates: the models of each tick of its period, from this one


def linearize(plan: FlightPlan, points: Points) -> Linear:
    """Linear models at points of flights. Raises InputError for what has none at the four inputs."""
    check_linear(plan)
    plant = plant_slopes(plan, points)
    plant_A, plant_B = plant.slope[:, :_N_PATH, :10], plant.slope[:, :_N_PATH, 10:]
    held_B = np.zeros_like(plant_B)
    if (points.lane[:, s.SLOW_EFFECTOR : s.SLOW_EFFECTOR + MAX_EFFECTORS] != NEVER).any():
        held_B = plant_slopes(plan, points, held=True).slope[:, :_N_PATH, 10:] - plant_B
    A, B = hold(plan, points.lane, plant_A, plant_B, held_B)
    felt = np.abs(plant_B).max(axis=1) + np.abs(held_B).max(axis=1)
    cut = np.where(felt < _FELT, NO_EFFECT, 0)
    stuck = points.lane[:, s.STUCK_SURFACE : s.STUCK_SURFACE + 3] != NEVER
    cut[:, :3][stuck] = STUCK
    for i, name in enumerate(INPUTS[:3]):
        here = stuck[:, i] & (points.lane[:, s.parameter_row(f"failure.{name}.stuck_at")] == NEVER)
        B[stuck[:, i], :, i] = 0.0
        A[here, :, 11 + 2 * i] = 0.0  # its rate is taken from it at every tick
    m, n = points.memory.shape[1], points.measured.shape[1]
    age = (points.lane[:, s.parameter_row("sensor.delay")] / plan.timing.tick + 0.5).astype(np.int64)
    phases = tuple(
        Linear(
            plan.timing.tick,
            plant_A,
            plant_B,
            A,
            B,
            law.slope[:, :m, n:],
            law.slope[:, :m, :n],
            law.slope[:, m:, n:],
            law.slope[:, m:, :n],
            np.minimum(age, MAX_DELAY_TICKS),
            _sensing(plant.slope[:, _AIR_SIDESLIP + 1 :]),
            cut,
        )
        for law in law_phases(plan, points)
    )
    phases = add_sensors(plan, points, phases)
    return phases[0]._replace(phases=phases if len(phases) > 1 else ())


def _sensing(slope: Floats) -> Floats:
    """Measurement of the plant's 18 states from its slopes [point, measured, 14], cleared of the last digits."""
    whole = np.round(slope)
    clean = np.where(np.abs(slope - whole) < _WHOLE, whole, slope)
    sense = np.zeros((*slope.shape[:2], 18))
    sense[:, :, :10], sense[:, :, 10::2] = clean[:, :, :10], clean[:, :, 10:]
    return sense


def actuator_matrices(plan: FlightPlan, lane: Floats) -> tuple[Floats, Floats]:
    """A [point, 8, 8] and B [point, 8, 4] of surfaces and engine: position and rate of each towards its command.

    ``lane`` [point, row] is the kernel's memory of the points.
    """
    c = drive_axes(plan.vehicle).constants

    def factor(name: str) -> Floats:
        return lane[:, s.parameter_row(name)]

    surface = c.surface_bandwidth * factor("actuator.bandwidth"), c.surface_damping * factor("actuator.damping")
    engine = c.engine_bandwidth * factor("engine.bandwidth"), c.engine_damping * factor("engine.damping")
    A, B = np.zeros((len(lane), 8, 8)), np.zeros((len(lane), 8, 4))
    surface = (np.full(len(lane), _AT_ONCE), np.ones(len(lane))) if c.ideal_surfaces > 0.0 else surface
    engine = (np.full(len(lane), _AT_ONCE), np.ones(len(lane))) if c.ideal_engine > 0.0 else engine
    for i, (bandwidth, damping) in enumerate((surface, surface, surface, engine)):
        A[:, 2 * i, 2 * i + 1] = 1.0
        A[:, 2 * i + 1, 2 * i], A[:, 2 * i + 1, 2 * i + 1] = -(bandwidth**2), -2.0 * damping * bandwidth
        B[:, 2 * i + 1, i] = bandwidth**2
    return A, B


def hold(plan: FlightPlan, lane: Floats, plant_A: Floats, plant_B: Floats, held_B: Floats) -> tuple[Floats, Floats]:
    """Plant and actuators under held commands: discrete A [point, 18, 18] and B [point, 18, 4].

    ``held_B`` [point, 10, 4] is what positions do that are held over the tick as they were at its beginning.
    """
    from scipy.linalg import expm

    actuator_A, actuator_B = actuator_matrices(plan, lane)
    size = 26 if held_B.any() else 22
    together = np.zeros((len(plant_A), size, size))
    together[:, :10, :10] = plant_A
    together[:, :10, 10:18:2] = plant_B
    together[:, 10:18, 10:18] = actuator_A
    together[:, 10:18, 18:22] = actuator_B
    together[:, :10, 22:] = held_B[:, :, : size - 22]
    # Rates in units of the position times their bandwidth: the exponential's argument is then small.
    scale = np.ones((len(plant_A), size))
    scale[:, 11:18:2] = np.sqrt(actuator_B[:, 1::2].sum(axis=-1))
    balanced = together * scale[:, None, :] / scale[:, :, None]
    end = expm(plan.timing.tick * balanced) * scale[:, :, None] / scale[:, None, :]
    end[:, :18, 10:18:2][:, :, : size - 22] += end[:, :18, 22:]
    return np.ascontiguousarray(end[:, :18, :18]), np.ascontiguousarray(end[:, :18, 18:22])


def open_loop(linear: Linear, point: int) -> tuple[Floats, Floats, Floats]:
    """A, B, C of all loops cut at the plant's inputs: from what goes in there to minus what the law commands.

    States are the plant's 18, the law's memory and, newest first, the old measurements that a delay keeps.
    """
    m, d = linear.law_A.shape[1], int(linear.delay[point])
    sense = linear.sense[point]
    measured = len(sense)
    n = 18 + m + measured * d
    seen = np.zeros((measured, n))  # the measurement that the law sees, of the whole state
    if d:
        seen[:, n - measured :] = np.eye(measured)
    else:
        seen[:, :18] = sense
    A, B = np.zeros((n, n)), np.zeros((n, 4))
    A[:18, :18], B[:18] = linear.A[point], linear.B[point]
    A[18 : 18 + m] = linear.law_B[point] @ seen
    A[18 : 18 + m, 18 : 18 + m] += linear.law_A[point]
    if d:
        A[18 + m : 18 + m + measured, :18] = sense
        A[18 + m + measured :, 18 + m : n - measured] = np.eye(measured * (d - 1))
    C = -linear.law_D[point] @ seen
    C[:, 18 : 18 + m] -= linear.law_C[point]
    return A, B, C


def closed_loop(linear: Linear, point: int) -> Floats:
    """The sampled map of one control period with the law in command, on the states of :func:`open_loop`."""
    A, B, C = open_loop(linear, point)
    return A - B @ C


def closed_period(linear: Linear, point: int) -> Floats:
    """The map of a whole period of the law: the product of those of its ticks, the first one rightmost."""
    maps = [closed_loop(each, point) for each in linear.phases or (linear,)]
    return maps[0] if len(maps) == 1 else np.linalg.multi_dot(maps[::-1])
