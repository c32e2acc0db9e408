"""What a valid vehicle file probably does not mean: an engine without fuel, a derivative in another unit or sign.

A derivative per degree where one per radian is wanted is 57.3 times too small. The ranges are wider than what aircraft
and hypersonic vehicles have (Roskam, "Airplane Flight Dynamics", appendix B; GHAME; NASA's winged cone), so that a
vehicle within them is not doubted. The middle of the tables stands for the vehicle.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, VARIABLES, Vehicle
from abhv_mc.vehicle.evaluate import evaluate_coefficients, make_variables

_STEP = 0.02  # rad, and of a dimensionless rate
_SMALL_ANGLES = (-0.05, 0.2)  # rad of angle of attack
_ALTITUDE = 20_000.0  # m
_DEGREES = 180.0 / np.pi


class _Expected(NamedTuple):
    coefficient: str
    variable: str
    least: float  # of the size, per radian or per dimensionless rate
    most: float
    sign: int  # of a stable vehicle in the conventions of a vehicle file
    meaning: str  # of the other sign


_EXPECTED = (
    _Expected("lift", "angle_of_attack", 0.1, 12.0, 1, "lift falls with the angle of attack"),
    _Expected("pitching_moment", "angle_of_attack", 0.0, 20.0, -1, "statically unstable in pitch"),
    _Expected("side_force", "sideslip", 0.02, 6.0, -1, "a sideslip pushes the vehicle further aside"),
    _Expected("yawing_moment", "sideslip", 0.002, 1.3, 1, "statically unstable in yaw"),
    _Expected("rolling_moment", "roll_rate_hat", 0.008, 2.0, -1, "rolling drives itself"),
    _Expected("pitching_moment", "pitch_rate_hat", 0.05, 60.0, -1, "pitching drives itself"),
    _Expected("yawing_moment", "yaw_rate_hat", 0.015, 3.0, -1, "yawing drives itself"),
    _Expected("pitching_moment", "elevator", 0.002, 5.0, -1, "a trailing edge down raises the nose"),
    _Expected("rolling_moment", "aileron", 0.002, 0.7, 0, ""),
    _Expected("yawing_moment", "rudder", 0.001, 0.7, 0, ""),
)


def find_vehicle_warnings(vehicle: Vehicle) -> list[str]:
    """A sentence (without its full stop) for each thing that a user should know before flying the vehicle."""
    warnings = []
    if vehicle.constants.equivalence_ratio_max > 0.0 and vehicle.constants.burns_fuel == 0.0:
        warnings.append("the vehicle file has no mass.empty, so the engine burns no fuel and the mass stays as it is")
    return [*warnings, *_doubtful_derivatives(vehicle)]


def _doubtful_derivatives(vehicle: Vehicle) -> Iterator[str]:
    """Derivatives whose size or sign is unusual, with their values."""
    points = {"mach": _nodes(vehicle, "mach"), "angle_of_attack": _nodes(vehicle, "angle_of_attack")}
    low, high = _SMALL_ANGLES
    angles = points["angle_of_attack"]
    angles = angles[(angles >= low) & (angles <= high)]
    mach, alpha = np.meshgrid(points["mach"], angles if angles.size else [0.02])
    where = {"mach": mach.ravel(), "angle_of_attack": alpha.ravel()}
    where |= {"mass": np.full(mach.size, vehicle.constants.mass_start), "altitude": np.full(mach.size, _ALTITUDE)}
    for expected in _EXPECTED:
        value = float(np.median(_derivative(vehicle, where, expected)))
        if value == 0.0:
            continue
        per = "per unit of its rate" if expected.variable.endswith("_hat") else "per radian"
        words = (
            f"the {expected.coefficient.replace('_', '-')} coefficient changes by {value:.3g} {per} of "
            f"{expected.variable.removesuffix('_hat').replace('_', ' ')} in the middle of the tables"
        )
        if not expected.least <= abs(value) <= expected.most:
            other = value * _DEGREES if abs(value) < expected.least else value / _DEGREES
            units = "degree and radian mistaken for each other would make it" if "rate" not in per else "a factor of"
            last = f"{units} {other:.3g}" if "rate" not in per else f"{units} 57.3 would make it {other:.3g}"
            yield f"{words}, where {expected.least:g} to {expected.most:g} is usual; {last}"
        elif expected.sign and np.sign(value) != expected.sign:
            yield f"{words}: {expected.meaning}"


def _derivative(vehicle: Vehicle, where: dict[str, Floats], expected: _Expected) -> Floats:
    """Central difference ``[point]``."""
    row = COEFFICIENTS.index(expected.coefficient)
    ends = []
    for step in (_STEP, -_STEP):
        moved = {**where, expected.variable: where.get(expected.variable, 0.0) + step}
        ends.append(evaluate_coefficients(vehicle, make_variables(vehicle, **moved))[row])
    difference: Floats = (ends[0] - ends[1]) / (2.0 * _STEP)
    return np.where(np.abs(difference) < 1e-12, 0.0, difference)


def _nodes(vehicle: Vehicle, variable: str) -> Floats:
    """All nodes of the tables over a variable."""
    tables, number = vehicle.tables, VARIABLES.index(variable)
    grids = [
        tables.grid[first : first + length]
        for first, length, over in zip(tables.axis_start, tables.axis_length, tables.axis_variable, strict=True)
        if over == number
    ]
    return np.unique(np.concatenate(grids)) if grids else np.zeros(1)
