"""Warnings about implausible vehicle data: fuel, drag, and units and signs of derivatives.

A derivative per degree instead of per radian is 57.3 times too small. The accepted ranges are wider
than the ranges of aircraft and hypersonic vehicles (Roskam, "Airplane Flight Dynamics", appendix B;
GHAME; NASA's winged cone). The derivatives are medians over the nodes of the tables.
"""

from typing import Any

import numpy as np

from abhv_mc.io.messages import counted, grouped_digits
from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, Vehicle
from abhv_mc_vehicle.vehicle.actuators import deflection_range, slack_warnings
from abhv_mc_vehicle.vehicle.table_file import nodes_of
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    evaluate_tables,
    make_variables,
    moment_about_center,
)

_STEP = 0.02  # step of numerical derivatives
_SMALL_ANGLES = (
    -0.05,
    0.2,
)  # range of the angles of attack at which derivatives are evaluated, rad
_ALTITUDE = 20_000.0  # altitude at which derivatives are evaluated, m
_BISECTIONS = 30
_SECOND_MINIMUM = 0.05  # minimum depth of a second drag minimum, relative to the least drag

# Each row contains: coefficient, variable, range of usual magnitudes (per radian or per
# dimensionless rate), sign for a stable vehicle, and meaning of the opposite sign.
_USUAL = (
    ("lift", "angle_of_attack", 0.1, 12.0, 1, "lift decreases with the angle of attack"),
    # Either sign is accepted, because instability in pitch is common.
    ("pitching_moment", "angle_of_attack", 0.0, 20.0, 0, ""),
    ("side_force", "sideslip", 0.02, 6.0, -1, "the side force increases the sideslip"),
    ("yawing_moment", "sideslip", 0.002, 1.3, 1, "statically unstable in yaw"),
    ("rolling_moment", "roll_rate_hat", 0.008, 2.0, -1, "roll rate is amplified"),
    ("pitching_moment", "pitch_rate_hat", 0.05, 60.0, -1, "pitch rate is amplified"),
    ("yawing_moment", "yaw_rate_hat", 0.015, 3.0, -1, "yaw rate is amplified"),
    (
        "pitching_moment",
        "elevator",
        0.002,
        5.0,
        -1,
        "a trailing-edge-down deflection raises the nose",
    ),
    ("rolling_moment", "aileron", 0.002, 0.7, 0, ""),
    ("yawing_moment", "rudder", 0.001, 0.7, 0, ""),
)


def find_vehicle_warnings(vehicle: Vehicle) -> list[str]:
    """Return a sentence without a full stop for each implausible property of a vehicle."""
    warnings = slack_warnings(vehicle)
    if vehicle.constants.equivalence_ratio_max > 0.0 and vehicle.constants.burns_fuel == 0.0:
        warnings.append(
            "the vehicle file has no mass.empty, so the engine burns no fuel and the mass is "
            "constant"
        )
    nodes = [nodes_of(vehicle.tables, name) for name in ("mach", "angle_of_attack")]
    machs, angles = (grid if grid.size else np.zeros(1) for grid in nodes)
    angles = angles[(angles >= _SMALL_ANGLES[0]) & (angles <= _SMALL_ANGLES[1])]
    mach, alpha = map(np.ravel, np.meshgrid(machs, angles if angles.size else [0.02]))
    middle_points = {
        "mach": mach,
        "angle_of_attack": alpha,
        "mass": np.full(mach.size, vehicle.constants.mass_start),
        "altitude": np.full(mach.size, _ALTITUDE),
    }
    for coefficient, variable, least, most, sign, meaning in _USUAL:
        values = []
        for step in (_STEP, -_STEP):
            point = middle_points | {variable: middle_points.get(variable, 0.0) + step}
            values.append(evaluate_coefficients(vehicle, make_variables(vehicle, **point)))
        value = float(np.median(values[0] - values[1], axis=1)[COEFFICIENTS.index(coefficient)]) / (
            2.0 * _STEP
        )
        if abs(value) < 1e-12:
            continue
        finding = (
            f"the {coefficient.replace('_', '-')} coefficient changes by {value:.3g} per "
            f"{'unit' if variable.endswith('_hat') else 'radian'} of "
            f"{variable.removesuffix('_hat').replace('_', ' ')} in the middle of the tables"
        )
        if not least <= abs(value) <= most:
            other = np.degrees(value) if abs(value) < least else np.radians(value)
            warnings.append(
                f"{finding}, outside the usual range of {least:g} to {most:g}; with degrees and "
                f"radians exchanged, the value would be {other:.3g}"
            )
        elif sign and np.sign(value) != sign:
            warnings.append(f"{finding}: {meaning}")
    return warnings + _find_drag_warnings(vehicle)


def _find_drag_warnings(vehicle: Vehicle) -> list[str]:
    """Return a sentence for each implausible property of drag and lift.

    Drag and lift are evaluated at the limits of the angle of attack and at the table nodes between
    them. Deflections are zero for the drag, and balance the aerodynamic pitching moment for the
    lift-to-drag ratio.
    """
    limits = vehicle.constants.angle_of_attack_min, vehicle.constants.angle_of_attack_max
    machs, angles = (nodes_of(vehicle.tables, name) for name in ("mach", "angle_of_attack"))
    inside = angles[(angles > limits[0]) & (angles < limits[1])]
    if not machs.size or not inside.size:  # Custom functions have no nodes.
        return []
    angles = np.array([limits[0], *inside, limits[1]])
    mach, alpha = np.meshgrid(machs, angles, indexing="ij")
    point = {"mach": mach, "angle_of_attack": alpha, "altitude": np.full(mach.shape, _ALTITUDE)}
    point["mass"] = np.full(mach.shape, vehicle.constants.mass_start)

    def coefficients(elevator: Any) -> dict[str, Any]:
        variables = make_variables(vehicle, **point, elevator=elevator)
        rows = evaluate_tables(vehicle.tables, variables)
        values = evaluate_coefficients(vehicle, variables, rows=rows)
        coefficient = dict(zip(COEFFICIENTS, values, strict=True))
        fixed = evaluate_fixed(vehicle, variables, rows)
        moment = moment_about_center(vehicle, values, alpha, fixed)
        return coefficient | {"pitching_moment": moment}

    def describe_point(mach: float, alpha: float) -> str:
        return f"at Mach {mach:g} and {np.degrees(alpha):g} deg of angle of attack"

    warnings = []
    undeflected = coefficients(0.0)
    drag = undeflected["drag"]
    if (drag <= 0.0).any():
        worst = np.unravel_index(np.argmin(drag), drag.shape)
        warnings.append(
            f"drag is not positive at {grouped_digits(np.sum(drag <= 0.0))} of "
            f"{counted(drag.size, 'node')} inside the limits: CD is {drag[worst]:.3g} "
            f"{describe_point(mach[worst], alpha[worst])}"
        )
    for number, curve in zip(machs, drag, strict=True):
        # Height of each node above the higher of the lowest nodes to its left and right.
        left = np.minimum.accumulate(curve)
        right = np.minimum.accumulate(curve[::-1])[::-1]
        rise = curve - np.maximum(left, right)
        top = int(np.argmax(rise))
        if rise[top] >= _SECOND_MINIMUM * abs(float(np.min(curve))) and 0 < top < curve.size - 1:
            minima = int(np.argmin(curve[:top])), top + int(np.argmin(curve[top:]))
            angles_text = " and ".join(f"{np.degrees(angles[i]):g}" for i in minima)
            warnings.append(
                f"the drag at Mach {number:g} has two minima, at {angles_text} deg of angle of "
                "attack"
            )
            break

    low, high = (np.full(mach.shape, limit) for limit in deflection_range(vehicle, 2))
    sign = np.sign(coefficients(low)["pitching_moment"])
    trimmed = sign * coefficients(high)["pitching_moment"] <= 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        same = sign * coefficients(middle)["pitching_moment"] > 0.0
        low = np.where(same, middle, low)
        high = np.where(same, high, middle)
    balanced = coefficients(0.5 * (low + high))
    considered = trimmed & (balanced["drag"] > 0.0) & (mach > 2.0)
    ratio = np.where(
        considered, balanced["lift"] / np.where(considered, balanced["drag"], 1.0), 0.0
    )
    excess = ratio / (6.0 * (mach + 2.0) / mach)
    if (excess > 1.0).any():
        worst = np.unravel_index(np.argmax(excess), excess.shape)
        warnings.append(
            f"the trimmed lift-to-drag ratio is {ratio[worst]:.1f} "
            f"{describe_point(mach[worst], alpha[worst])}, where 6 (M + 2) / M = "
            f"{ratio[worst] / excess[worst]:.1f} exceeds that of every known vehicle"
        )
    return warnings
