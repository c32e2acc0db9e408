"""How far the whole plant's Jacobian lies from the design model's: a table without a tolerance.

The plant is the compiled one, asked at states a little apart. What the design model leaves out is then taken away, the
damping by the rates and the Earth's rotation and shape, to see what each is worth.
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
from abhv_mc.flight.fly import fly_until, nominal_parameters
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.kernel.plant.vehicle import VARIABLES, BuildUp, Vehicle
from abhv_mc.kernel.world.earth import WGS84, Earth
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.probe import ask_plant, begin
from abhv_mc.verification.fly_recording import make_replay_plan

NOMINALS = 40
_COORDINATES = [path.GAMMA, path.CHI, path.SPEED, path.ALPHA, path.BETA, path.BANK, path.P, path.Q, path.R]
_MOVED = [*_COORDINATES, len(path.COORDINATES) + 2, len(path.COORDINATES) + 3]  # and the elevator and the engine
_STEPS = np.eye(len(path.COORDINATES) + 4)[_MOVED] * np.where(np.array(_MOVED) == path.SPEED, 1e-2, 1e-5)[:, np.newaxis]
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
            numbers = np.median(entries), entries.max(), np.median(poles), poles.max()
            yield Distance(loop, name, *(float(number) for number in numbers))


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
    values = nominal.values | dict(zip(("roll_rate", "pitch_rate", "yaw_rate"), nominal.rates, strict=True))
    at = [values.get(name, 0.0) for name in path.COORDINATES]  # without sideslip
    controls = [0.0, 0.0, nominal.elevator, values["equivalence_ratio"]]
    points = np.array([*at, *controls]) + np.concatenate([_STEPS, -_STEPS])
    latitude, mass = (np.full(len(points), values[name]) for name in ("latitude", "mass"))
    states = path.make_states(points[:, : len(at)], points[:, len(at) :], latitude, mass)
    plan = make_replay_plan(vehicle, earth, states[0], np.tile(controls, (2, 1)), Timing(0.01, 1, 1))
    lane, _ = begin(plan, fly_until(plan, nominal_parameters(), 0))
    rates = path.path_rates(states, ask_plant(plan, lane, 0, np.zeros(len(states), np.int64), states).rates)
    upward, downward = np.split(rates[:, _COORDINATES], 2)
    return ((upward - downward) / (2.0 * _STEPS.sum(axis=1)[:, np.newaxis])).T


def trim_slopes(vehicle: Vehicle, nominal: Nominal) -> Floats:
    """Slopes of the trimmed elevator over speed, angle of attack and equivalence ratio."""
    at = np.array([nominal.values[name] for name in ("speed", "angle_of_attack", "equivalence_ratio")])
    steps = np.array([1e-2, 1e-5, 1e-4])
    points = np.vstack([at + np.diag(steps), at - np.diag(steps)])
    elevator, _ = trim_elevator(vehicle, nominal.around, *points.T)
    return np.asarray((elevator[:3] - elevator[3:]) / (2.0 * steps))
