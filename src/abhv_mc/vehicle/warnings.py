"""What a valid vehicle file probably does not mean: an engine without fuel, a derivative in another unit or sign.

A derivative per degree where one per radian is wanted is 57.3 times too small. The ranges are wider than what aircraft
and hypersonic vehicles have (Roskam, "Airplane Flight Dynamics", appendix B; GHAME; NASA's winged cone), so that a
vehicle within them is not doubted. The middle of the tables stands for the vehicle.
"""

import numpy as np

from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, Vehicle
from abhv_mc.vehicle.evaluate import evaluate_coefficients, make_variables
from abhv_mc.vehicle.pack import nodes_of

_STEP = 0.02  # rad, and of a dimensionless rate
_SMALL_ANGLES = (-0.05, 0.2)  # rad of angle of attack
_ALTITUDE = 20_000.0  # m

# Coefficient, variable, least and greatest usual size (per radian or per dimensionless rate), sign of a stable vehicle
# in the conventions of a vehicle file, and what the other sign means.
_USUAL = (
    ("lift", "angle_of_attack", 0.1, 12.0, 1, "lift falls with the angle of attack"),
    ("pitching_moment", "angle_of_attack", 0.0, 20.0, -1, "statically unstable in pitch"),
    ("side_force", "sideslip", 0.02, 6.0, -1, "a sideslip pushes the vehicle further aside"),
    ("yawing_moment", "sideslip", 0.002, 1.3, 1, "statically unstable in yaw"),
    ("rolling_moment", "roll_rate_hat", 0.008, 2.0, -1, "rolling drives itself"),
    ("pitching_moment", "pitch_rate_hat", 0.05, 60.0, -1, "pitching drives itself"),
    ("yawing_moment", "yaw_rate_hat", 0.015, 3.0, -1, "yawing drives itself"),
    ("pitching_moment", "elevator", 0.002, 5.0, -1, "a trailing edge down raises the nose"),
    ("rolling_moment", "aileron", 0.002, 0.7, 0, ""),
    ("yawing_moment", "rudder", 0.001, 0.7, 0, ""),
)


def find_vehicle_warnings(vehicle: Vehicle) -> list[str]:
    """A sentence (without its full stop) for each thing that a user should know before flying the vehicle."""
    warnings = []
    if vehicle.constants.equivalence_ratio_max > 0.0 and vehicle.constants.burns_fuel == 0.0:
        warnings.append(
            "the vehicle file has no mass.empty, so the engine burns no fuel and the mass stays as it is"
        )
    nodes = [nodes_of(vehicle.tables, name) for name in ("mach", "angle_of_attack")]
    machs, angles = (found if found.size else np.zeros(1) for found in nodes)
    angles = angles[(angles >= _SMALL_ANGLES[0]) & (angles <= _SMALL_ANGLES[1])]
    mach, alpha = map(np.ravel, np.meshgrid(machs, angles if angles.size else [0.02]))
    where = {
        "mach": mach,
        "angle_of_attack": alpha,
        "mass": np.full(mach.size, vehicle.constants.mass_start),
    }
    where["altitude"] = np.full(mach.size, _ALTITUDE)
    for coefficient, variable, least, most, sign, meaning in _USUAL:
        ends = []
        for step in (_STEP, -_STEP):
            moved = where | {variable: where.get(variable, 0.0) + step}
            ends.append(evaluate_coefficients(vehicle, make_variables(vehicle, **moved)))
        value = float(np.median(ends[0] - ends[1], axis=1)[COEFFICIENTS.index(coefficient)]) / (
            2.0 * _STEP
        )
        if abs(value) < 1e-12:
            continue
        words = (
            f"the {coefficient.replace('_', '-')} coefficient changes by {value:.3g} per "
            f"{'unit' if variable.endswith('_hat') else 'radian'} of {variable.removesuffix('_hat').replace('_', ' ')} "
            "in the middle of the tables"
        )
        if not least <= abs(value) <= most:
            other = np.degrees(value) if abs(value) < least else np.radians(value)
            usual = f"where {least:g} to {most:g} is usual; degrees taken for radians, or radians for degrees, would"
            warnings.append(f"{words}, {usual} make it {other:.3g}")
        elif sign and np.sign(value) != sign:
            warnings.append(f"{words}: {meaning}")
    return warnings
