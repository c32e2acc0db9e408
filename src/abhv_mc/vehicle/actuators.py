"""The list of a vehicle's actuators: packed from its file, and asked of the packed vehicle."""

import math
from collections.abc import Mapping

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.plant.vehicle import HIGH, LOW, VARIABLES, Constants, Effectors, Vehicle
from abhv_mc.vehicle.actuator_keys import AXIS_DEFLECTIONS, Effector

_AXES, _FIRST = VARIABLES.index("aileron") + np.arange(3), VARIABLES.index("effector_0")


def pack_effectors(
    effectors: Mapping[str, Effector], constants: Constants, named: set[str]
) -> tuple[Floats, Effectors, Ints]:
    """The file's effectors and axes that the aerodynamics name: mix of the former, the list of actuators, names.

    What an effector does not say is as the surfaces have it.
    """
    axes = [i for i, axis in enumerate(AXIS_DEFLECTIONS) if axis in named]
    variables = np.array(
        [*(_FIRST + e for e in range(len(effectors))), *_AXES[axes]], dtype=np.int64
    )
    own = np.array(
        [[getattr(each, axis) for axis in AXIS_DEFLECTIONS] for each in effectors.values()],
        np.float64,
    )
    mix = np.vstack([own.reshape(-1, 3), np.eye(3)[axes]])
    rows, c = np.zeros((len(mix), 6)), constants
    for row, each in zip(rows, [*effectors.values(), *[Effector()] * len(axes)], strict=True):
        low, high = each.limits or (-c.surface_limit, c.surface_limit)
        moves = each.rate is not None or each.bandwidth is not None
        rate, bandwidth = (
            each.rate or c.surface_rate_limit or math.inf,
            each.bandwidth or c.surface_bandwidth,
        )
        ideal = each.ideal or (c.ideal_surfaces > 0.0 and not moves)
        row[:] = low, high, rate, bandwidth, each.damping or c.surface_damping, ideal
    letters = np.zeros((len(effectors), max(map(len, effectors), default=0)), dtype=np.int64)
    for i, name in enumerate(effectors):
        letters[i, : len(name)] = [ord(letter) for letter in name]
    actuators = Effectors(variables, mix, rows, _axis_shares(mix), np.linalg.pinv(mix))
    return mix[: len(effectors)].copy(), actuators, letters


def _axis_shares(mix: Floats) -> Floats:
    """What of the effectors' deflections an axis makes [axis, effector, effector], within sets of equal |mix|.

    In the file's order each joins the first set in which its row of the mix is independent of the others', or begins
    one: over all of them at once, pairs with unlike limits would count as commands of other axes.
    """
    sets: list[list[int]] = []
    for e, row in enumerate(mix):
        alike = [s for s in sets if (abs(mix[s[0]]) == abs(row)).all()]
        joined = next((s for s in alike if np.linalg.matrix_rank(mix[[*s, e]]) == len(s) + 1), None)
        if joined is None:
            sets.append([e])
        else:
            joined.append(e)
    shares = np.zeros((3, len(mix), len(mix)))
    for members in sets:
        part = mix[members]
        shares[np.ix_(range(3), members, members)] = (
            part.T[:, :, None] * np.linalg.pinv(part)[:, None, :]
        )
    return shares


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """The names of a vehicle's effectors, in their order, and of the axes that are among them."""
    names = ["".join(map(chr, row[row > 0])) for row in vehicle.effector_names]
    return tuple(
        names[i - _FIRST] if i >= _FIRST else VARIABLES[i] for i in vehicle.effectors.variable
    )


def list_actuators(vehicle: Vehicle) -> Effectors:
    """The list of actuators but the engine's: of the three axes, or of the effectors."""
    c = vehicle.constants
    if c.driven:
        return vehicle.effectors
    row = (
        -c.surface_limit,
        c.surface_limit,
        c.surface_rate_limit,
        c.surface_bandwidth,
        c.surface_damping,
    )
    return Effectors(
        _AXES, np.eye(3), np.tile((*row, c.ideal_surfaces), (3, 1)), np.zeros((3, 3, 3)), np.eye(3)
    )


def drive(vehicle: Vehicle, driven: bool = True) -> Vehicle:
    """The vehicle with an actuator at each effector, or with actuators of the three axes, which effectors follow."""
    return vehicle._replace(constants=vehicle.constants._replace(driven=float(driven)))


def axis_limits(vehicle: Vehicle) -> Floats:
    """Return the least and greatest deflection (rad) of aileron, rudder and elevator, one after another [6]."""
    return np.array([deflection_range(vehicle, axis) for axis in range(3)]).ravel()


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Least and greatest deflection (rad) of aileron, rudder or elevator alone that its effectors can follow."""
    low, high = -vehicle.constants.surface_limit, vehicle.constants.surface_limit
    if vehicle.constants.driven:
        for mix, actuator in zip(
            vehicle.effectors.mix[:, axis], vehicle.effectors.actuator, strict=True
        ):
            if mix != 0.0:
                ends = sorted((actuator[LOW] / mix, actuator[HIGH] / mix))
                low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
