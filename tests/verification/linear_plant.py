"""How far the whole plant's Jacobian lies from the design model's: a table without a tolerance.

The plant is the compiled flight itself: a few ticks of 0.1 ms with surfaces and engine held, from states a little
apart. What the design model leaves out is then taken away, the damping by the rates and the Earth's rotation and shape,
to see what each is worth.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from verification.loops import Gains, closed_loop, tlc_gains, wanted_loop
from verification.nominals import (
    SPHERE,
    Design,
    Nominal,
    attitude_jacobian,
    draw_nominals,
    inertia_of,
    make_design,
    rate_jacobian,
    velocity_jacobian,
)

from abhv_mc.array_types import Floats
from abhv_mc.control.design.trim_tables import trim_elevator
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.plan import Timing
from abhv_mc.numerics.quaternion import from_euler
from abhv_mc.plant import state as s
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.vehicle.arrays import VARIABLES, BuildUp
from abhv_mc.vehicle.model import Vehicle
from abhv_mc.verification.replay import make_replay_plan
from abhv_mc.world.earth import WGS84, Earth

NOMINALS = 40
_TICK = 1e-4  # s
_COORDINATES = {  # in this order, with the steps of the differences
    "flight_path_angle": 1e-5,
    "heading": 1e-5,
    "speed": 1e-2,
    "angle_of_attack": 1e-5,
    "sideslip": 1e-5,
    "bank": 1e-5,
    "roll_rate": 1e-5,
    "pitch_rate": 1e-5,
    "yaw_rate": 1e-5,
}
_CONTROL_STEP = 1e-4  # rad, and of the equivalence ratio
_RATES_OF_TABLES = ("roll_rate_hat", "pitch_rate_hat", "yaw_rate_hat")
LOOPS = ("2 velocity", "3 attitude", "4 body rates")


class Distance(NamedTuple):
    """The plant against the design model in one sub-loop, over all nominals."""

    loop: str
    plant: str
    entry_median: float  # largest entry of A - A_design, 1/s with the states scaled to radians and speed / V
    entry_worst: float
    pole_median: float  # largest |pole - promised| / |promised|, the design's gains on the plant's A and B
    pole_worst: float


def without_damping(vehicle: Vehicle) -> Vehicle:
    """The same vehicle, whose tables do not feel the body rates."""
    terms = vehicle.build_up
    kept = ~np.isin(terms.variable, [VARIABLES.index(name) for name in _RATES_OF_TABLES])
    return vehicle._replace(build_up=BuildUp(*(column[kept] for column in terms)))


def compare_linear_plant(count: int = NOMINALS) -> Iterator[Distance]:
    """Distances of each sub-loop, for the plant as it flies and without what the design model leaves out."""
    design = make_design()
    nominals = draw_nominals(design, count, seed=4)
    plants = {
        "as flown": (design.vehicle, WGS84),
        "without damping": (without_damping(design.vehicle), WGS84),
        "on a still sphere": (design.vehicle, SPHERE),
        "both": (without_damping(design.vehicle), SPHERE),
    }
    for name, (vehicle, earth) in plants.items():
        found = np.array([_distances(design, nominal, vehicle, earth) for nominal in nominals])
        for loop, (entries, poles) in zip(LOOPS, np.moveaxis(found, 0, -1), strict=True):
            yield Distance(
                loop,
                name,
                float(np.median(entries)),
                float(entries.max()),
                float(np.median(poles)),
                float(poles.max()),
            )


def _distances(design: Design, nominal: Nominal, vehicle: Vehicle, earth: Earth) -> Floats:
    """[loop, 2]: largest entry's difference and largest relative shift of a pole."""
    inertia = inertia_of(design, nominal)
    gains: Gains = tlc_gains(design, nominal, inertia)
    J = plant_jacobian(nominal, vehicle, earth)
    # Guidance flies on the data at trim: in sub-loop 2 the elevator follows speed, angle of attack and the engine.
    trimmed = J[:, [2, 3, 10]] + np.outer(J[:, 9], trim_slopes(design.vehicle, nominal))
    designs = (
        velocity_jacobian(design, nominal)[1:, 1:],
        attitude_jacobian(design, nominal),
        rate_jacobian(inertia, nominal.rates, (0.0, 0.0, 0.0)),
    )
    by_moment = np.linalg.inv(inertia)
    plants = (
        np.column_stack([J[:3, :2], trimmed[:3, :2], J[:3, 5], trimmed[:3, 2]]),
        J[3:6, 3:9],
        np.hstack([J[6:, 6:9], by_moment]),
    )
    speed = nominal.values["speed"]
    result = np.empty((3, 2))
    for i, (K, spectrum) in enumerate(zip(gains[1:4], gains.spectra, strict=True)):
        scale = np.array([1.0, 1.0, speed if i == 0 else 1.0])
        off = (plants[i] - designs[i])[:, :3] * scale / scale[:, None]
        poles = np.linalg.eigvals(closed_loop(plants[i][:, :3], plants[i][:, 3:], K))
        promised = np.linalg.eigvals(wanted_loop(spectrum))
        result[i] = np.abs(off).max(), _shift(poles, promised)
    return result


def _shift(poles: NDArray[Any], promised: NDArray[Any]) -> float:
    """Largest distance of a pole from the promised one that it is matched with, relative to that one."""
    from scipy.optimize import linear_sum_assignment

    cost = np.abs(poles[:, None] - promised[None, :]) / np.abs(promised)
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].max())


def plant_jacobian(nominal: Nominal, vehicle: Vehicle, earth: Earth) -> Floats:
    """[9, 11]: rates of _COORDINATES over these, the elevator and the equivalence ratio at a nominal."""
    parameters = nominal_parameters(2 * len(_COORDINATES))
    for i, (name, step) in enumerate(_COORDINATES.items()):
        parameters[2 * i, PARAMETER_INDEX[f"initial.{name}"]] = step
        parameters[2 * i + 1, PARAMETER_INDEX[f"initial.{name}"]] = -step
    controls = np.array([nominal.elevator, nominal.values["equivalence_ratio"]])
    at, rates = _fly(nominal, vehicle, earth, controls, parameters)
    moved, answer = at[::2] - at[1::2], rates[::2] - rates[1::2]
    # An initial error moves more than one coordinate (sideslip turns the bank too): solve for each one alone.
    by_state = np.linalg.solve(moved, answer).T
    by_control = []
    for step in _CONTROL_STEP * np.eye(2):
        ends = [_fly(nominal, vehicle, earth, controls + way, nominal_parameters())[1][0] for way in (step, -step)]
        by_control.append((ends[0] - ends[1]) / (2.0 * _CONTROL_STEP))
    return np.column_stack([by_state, *by_control])


def trim_slopes(vehicle: Vehicle, nominal: Nominal) -> Floats:
    """Slopes of the trimmed elevator over speed, angle of attack and equivalence ratio."""
    at = np.array([nominal.values[name] for name in ("speed", "angle_of_attack", "equivalence_ratio")])
    steps = np.array([1e-2, 1e-5, 1e-4])
    points = np.vstack([at + np.diag(steps), at - np.diag(steps)])
    elevator, _ = trim_elevator(vehicle, nominal.around, *points.T)
    return np.asarray((elevator[:3] - elevator[3:]) / (2.0 * steps))


def _fly(
    nominal: Nominal, vehicle: Vehicle, earth: Earth, controls: Floats, parameters: Floats
) -> tuple[Floats, Floats]:
    """Coordinates and their rates at the start, each [flight, coordinate], with (elevator, eta) held."""
    held = np.tile([0.0, 0.0, *controls], (3, 1))
    plan = make_replay_plan(vehicle, earth, _start(nominal), held, Timing(_TICK, 1, 2))
    states = fly(plan, parameters, record_every=1, keep_states=True).states
    now, next_one, last = (_coordinates(states[:, tick]) for tick in range(3))
    return now, (4.0 * next_one - last - 3.0 * now) / (2.0 * _TICK)


def _start(nominal: Nominal) -> Floats:
    """The nominal as a state, without sideslip."""
    values = nominal.values
    x = np.zeros(s.N_STATES)
    x[s.ALTITUDE], x[s.LATITUDE], x[s.MASS] = values["altitude"], values["latitude"], values["mass"]
    alpha = values["angle_of_attack"]
    x[s.U], x[s.W] = values["speed"] * np.cos(alpha), values["speed"] * np.sin(alpha)
    wind = from_euler(values["heading"], values["flight_path_angle"], values["bank"])
    x[s.Q0 : s.Q3 + 1] = _turned(np.array(wind), alpha)
    x[s.ROLL_RATE : s.YAW_RATE + 1] = nominal.rates
    return x


def _turned(attitude: Floats, pitch: float) -> Floats:
    """A quaternion after the body has pitched up about its own y axis."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_quat(attitude, scalar_first=True) * Rotation.from_euler("y", pitch)
    return np.asarray(turned.as_quat(scalar_first=True))


def _coordinates(states: Floats) -> Floats:
    """[flight, coordinate] from states [flight, state]; angles near the nominal's, so that none wraps."""
    from scipy.spatial.transform import Rotation

    velocity = states[:, s.U : s.W + 1]
    attitude = Rotation.from_quat(states[:, s.Q0 : s.Q3 + 1], scalar_first=True)
    north, east, down = attitude.apply(velocity).T
    speed = np.linalg.norm(velocity, axis=1)
    alpha, beta = np.arctan2(velocity[:, 2], velocity[:, 0]), np.arcsin(velocity[:, 1] / speed)
    wind = attitude * Rotation.from_euler("YZ", np.column_stack([-alpha, beta]))
    bank = wind.as_euler("ZYX")[:, 2]
    rates = states[:, s.ROLL_RATE : s.YAW_RATE + 1].T
    return np.stack([np.arcsin(-down / speed), np.arctan2(east, north), speed, alpha, beta, bank, *rates], axis=1)
