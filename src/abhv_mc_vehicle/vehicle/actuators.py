"""Conversion of a vehicle file's effectors and actuators to arrays."""

from collections.abc import Mapping

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.plant.actuator_step import COLUMNS, DEAD_ZONE, KINDS, SLACK
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Effectors, Vehicle
from abhv_mc_vehicle.vehicle.actuator_keys import (
    AXIS_DEFLECTIONS,
    DYNAMICS,
    ActuatorKind,
    Effector,
    EngineActuator,
    SurfaceActuator,
    throttle_range,
)
from abhv_mc_vehicle.vehicle.document import VehicleDocument
from abhv_mc_vehicle.vehicle.effectors import name_effectors, surface_list

_AXES, _FIRST = VARIABLES.index("aileron") + np.arange(3), VARIABLES.index("effector_0")


def pack_effectors(
    effectors: Mapping[str, Effector], named_axes: set[str]
) -> tuple[Floats, Effectors, Ints]:
    """Return the mix of the file's effectors, a record of all effectors, and the names.

    The names are those of the file's effectors, as arrays of character codes. The record also
    contains the axes that the aerodynamics use.
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
    letters = np.zeros((len(effectors), max(map(len, effectors), default=0)), dtype=np.int64)
    for i, name in enumerate(effectors):
        letters[i, : len(name)] = [ord(letter) for letter in name]
    packed = Effectors(variables, mix, _axis_shares(mix), np.linalg.pinv(mix))
    return mix[: len(effectors)].copy(), packed, letters


def pack_actuators(content: VehicleDocument, mix: Floats) -> Floats:
    """Return the array of actuators [actuator, column]: axes, engine, then effectors.

    ``mix`` [effector, 3] is that of all effectors. The key ``surfaces`` supplies omitted values of
    effectors, and all values of axes that count as effectors.
    """
    surfaces, engine = content.surfaces, content.propulsion
    limit = surfaces.limit if surfaces else 0.0
    axis = _make_row(surfaces, (-limit, limit), surfaces.response if surfaces else None)
    throttle = _make_row(engine, throttle_range(engine), engine.response if engine else None)
    limits = surfaces.limits if surfaces else {}
    own = [limits.get(name, limit) for name in AXIS_DEFLECTIONS]
    axes = [axis | {"low": -high, "high": high} for high in own]
    rows = [*axes, throttle]
    for effector in content.effectors.values():
        row = axis
        if surfaces:
            kind, dynamics = effector.complete(surfaces)
            row = axis | _make_row(effector, effector.limits or (-limit, limit), kind, dynamics)
            row |= {name: axis[name] for name in SLACK if getattr(effector, name) is None}
        rows.append(row)
    rows += [axes[int(np.argmax(row))] for row in mix[len(content.effectors) :]]
    return np.array([[row[name] for name in COLUMNS] for row in rows])


def _make_row(
    keys: EngineActuator | SurfaceActuator | None,
    limits: tuple[float, float],
    kind: ActuatorKind | None,
    dynamics: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return one row of the array of actuators; values of missing keys are neutral."""
    row = {"low": limits[0], "high": limits[1], "rate_limit": 0.0, "bandwidth": 1.0, "damping": 1.0}
    names = (*DYNAMICS["second_order"], *SLACK)
    row |= dict.fromkeys(SLACK, 0.0)
    row |= {name: x for name in names if (x := getattr(keys, name, None)) is not None}
    row |= dynamics or {}
    row["kind"] = KINDS.index(kind or "second_order")
    if kind == "first_order":
        row["damping"] = 0.5
    return row


def slack_warnings(vehicle: Vehicle) -> list[str]:
    """Return a warning if the vehicle has dead zones or backlash, which margins neglect.

    The warning is a sentence without a full stop.
    """
    names = [*(name_effectors(vehicle) if vehicle.constants.driven else AXIS_DEFLECTIONS), "engine"]
    actuators = vehicle.actuators[surface_list(vehicle)]
    phrases = []
    for column, slack in enumerate(SLACK, DEAD_ZONE):
        affected = [name for name, row in zip(names, actuators, strict=True) if row[column] > 0.0]
        if affected:
            phrases.append(f"the {slack.replace('_', ' ')} of {', '.join(affected)}")
    if not phrases:
        return []
    return [
        f"stability margins and linear models neglect {' and '.join(phrases)}: they are valid for "
        "commands much larger than the neglected width, not for oscillations of this size"
    ]


def _axis_shares(mix: Floats) -> Floats:
    """Return matrices [axis, effector, effector] that project deflections onto each axis.

    Effectors whose mixes have equal magnitudes are grouped into sets in the order of the file: each
    effector joins the first set in which its row of the mix is linearly independent, or starts a
    new set. With a single set, deflections of pairs with different limits would count as commands
    on other axes.
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
