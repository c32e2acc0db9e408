"""Actuators of a vehicle: packing from the file, and queries of the packed vehicle."""

import math
from collections.abc import Mapping

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.plant.vehicle import HIGH, LOW, VARIABLES, Constants, Effectors, Vehicle
from abhv_mc.vehicle.actuator_keys import AXIS_DEFLECTIONS, Effector

_AXES, _FIRST = VARIABLES.index("aileron") + np.arange(3), VARIABLES.index("effector_0")


def pack_effectors(
    effectors: Mapping[str, Effector], constants: Constants, named_axes: set[str]
) -> tuple[Floats, Effectors, Ints]:
    """Return the mix of the file's effectors, the list of actuators and the effectors' names.

    Axes that the aerodynamics name are actuators, too. Values that an effector does not give are
    those of the surfaces.
    """
    axes = [i for i, axis in enumerate(AXIS_DEFLECTIONS) if axis in named_axes]
    variables = np.array(
        [*(_FIRST + e for e in range(len(effectors))), *_AXES[axes]], dtype=np.int64
    )
    file_mix = np.array(
        [[getattr(effector, axis) for axis in AXIS_DEFLECTIONS] for effector in effectors.values()],
        np.float64,
    )
    mix = np.vstack([file_mix.reshape(-1, 3), np.eye(3)[axes]])
    rows, c = np.zeros((len(mix), 6)), constants
    for row, effector in zip(rows, [*effectors.values(), *[Effector()] * len(axes)], strict=True):
        low, high = effector.limits or (-c.surface_limit, c.surface_limit)
        has_dynamics = effector.rate is not None or effector.bandwidth is not None
        rate, bandwidth = (
            effector.rate or c.surface_rate_limit or math.inf,
            effector.bandwidth or c.surface_bandwidth,
        )
        ideal = effector.ideal or (c.ideal_surfaces > 0.0 and not has_dynamics)
        row[:] = low, high, rate, bandwidth, effector.damping or c.surface_damping, ideal
    letters = np.zeros((len(effectors), max(map(len, effectors), default=0)), dtype=np.int64)
    for i, name in enumerate(effectors):
        letters[i, : len(name)] = [ord(letter) for letter in name]
    actuators = Effectors(variables, mix, rows, _axis_shares(mix), np.linalg.pinv(mix))
    return mix[: len(effectors)].copy(), actuators, letters


def _axis_shares(mix: Floats) -> Floats:
    """Return the projection of deflections onto each axis [axis, effector, effector].

    Effectors are grouped into sets of equal |mix|, in the file's order: each joins the first set in
    which its row of the mix is linearly independent, or starts a new one. In a single set, pairs with
    different limits would count as commands of other axes.
    """
    sets: list[list[int]] = []
    for e, row in enumerate(mix):
        equal_sets = [s for s in sets if (abs(mix[s[0]]) == abs(row)).all()]
        joined_set = next(
            (s for s in equal_sets if np.linalg.matrix_rank(mix[[*s, e]]) == len(s) + 1), None
        )
        if joined_set is None:
            sets.append([e])
        else:
            joined_set.append(e)
    shares = np.zeros((3, len(mix), len(mix)))
    for members in sets:
        block = mix[members]
        shares[np.ix_(range(3), members, members)] = (
            block.T[:, :, None] * np.linalg.pinv(block)[:, None, :]
        )
    return shares


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of a vehicle's effectors in order, including axes among them."""
    names = ["".join(map(chr, row[row > 0])) for row in vehicle.effector_names]
    return tuple(
        names[i - _FIRST] if i >= _FIRST else VARIABLES[i] for i in vehicle.effectors.variable
    )


def list_actuators(vehicle: Vehicle) -> Effectors:
    """Return the actuators of the three axes or of the effectors, without the engine's."""
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
    """Return the vehicle with actuators at the effectors, or at the three axes."""
    return vehicle._replace(constants=vehicle.constants._replace(driven=float(driven)))


def axis_limits(vehicle: Vehicle) -> Floats:
    """Return the least and greatest deflection (rad) of aileron, rudder and elevator [6]."""
    return np.array([deflection_range(vehicle, axis) for axis in range(3)]).ravel()


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Return the range of deflections (rad) of an axis alone that its effectors can follow."""
    low, high = -vehicle.constants.surface_limit, vehicle.constants.surface_limit
    if vehicle.constants.driven:
        for mix, actuator in zip(
            vehicle.effectors.mix[:, axis], vehicle.effectors.actuator, strict=True
        ):
            if mix != 0.0:
                ends = sorted((actuator[LOW] / mix, actuator[HIGH] / mix))
                low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
