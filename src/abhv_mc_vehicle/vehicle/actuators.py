"""Conversion of effectors and actuators to arrays, and queries of the arrays."""

from collections.abc import Mapping

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.plant.actuator_step import (
    AXES,
    COLUMNS,
    DEAD_ZONE,
    ENGINE,
    FIRST_EFFECTOR,
    FIRST_ORDER,
    HIGH,
    KIND,
    KINDS,
    LOW,
    SLACK,
)
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


def has_slack(vehicle: Vehicle) -> bool:
    """Return whether any active actuator is first-order or has a dead zone or backlash."""
    actuators = vehicle.actuators[surface_list(vehicle)]
    return bool((actuators[:, KIND] == FIRST_ORDER).any() or actuators[:, DEAD_ZONE:].any())


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of a vehicle's effectors, including axes that count as effectors."""
    names = ["".join(map(chr, row[row > 0])) for row in vehicle.effector_names]
    return tuple(
        names[i - _FIRST] if i >= _FIRST else VARIABLES[i] for i in vehicle.effectors.variable
    )


def surface_list(vehicle: Vehicle) -> Ints:
    """Return the indices of the active actuators: first surfaces, then the engine."""
    first = FIRST_EFFECTOR + np.arange(len(vehicle.effectors.mix))
    return np.append(first if vehicle.constants.driven else np.arange(AXES), ENGINE)


def surface_mix(vehicle: Vehicle) -> Floats:
    """Return the deflections [surface, 3] of actuated surfaces per unit of axis deflection."""
    return vehicle.effectors.mix if vehicle.constants.driven else np.eye(AXES)


def drive(vehicle: Vehicle, driven: bool = True) -> Vehicle:
    """Return the vehicle with actuators at the effectors if ``driven``, else at the axes."""
    return vehicle._replace(constants=vehicle.constants._replace(driven=float(driven)))


def axis_limits(vehicle: Vehicle) -> Floats:
    """Return the minimum and maximum deflections (rad) of aileron, rudder and elevator [6]."""
    return np.array([deflection_range(vehicle, axis) for axis in range(3)]).ravel()


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Return the range (rad) of an axis deflection that the effectors of the axis can reach."""
    limit = min(vehicle.constants.surface_limit, vehicle.actuators[axis, HIGH])
    low = -limit
    high = limit
    if vehicle.constants.driven:
        actuators = vehicle.actuators[FIRST_EFFECTOR:]
        for mix, actuator in zip(vehicle.effectors.mix[:, axis], actuators, strict=True):
            if mix != 0.0:
                ends = sorted((actuator[LOW] / mix, actuator[HIGH] / mix))
                low = max(low, ends[0])
                high = min(high, ends[1])
    return float(low), float(high)


_AXES = VARIABLES.index("aileron") + np.arange(3)
_FIRST = VARIABLES.index("effector_0")


def pack_effectors(
    effectors: Mapping[str, Effector], named_axes: set[str]
) -> tuple[Floats, Effectors, Ints]:
    """Return the mix of the file's effectors, a record of all effectors, and the names.

    The names are those of the file's effectors, as arrays of character codes. The record also
    contains the axes that the aerodynamics use.
    """
    axes = [i for i, axis in enumerate(AXIS_DEFLECTIONS) if axis in named_axes]
    variables = np.array([*(_FIRST + e for e in range(len(effectors))), *_AXES[axes]], np.int64)
    file_mix = np.array(
        [[getattr(effector, axis) for axis in AXIS_DEFLECTIONS] for effector in effectors.values()],
        np.float64,
    )
    mix = np.vstack([file_mix.reshape(-1, 3), np.eye(3)[axes]])
    letters = np.zeros((len(effectors), max(map(len, effectors), default=0)), np.int64)
    for i, name in enumerate(effectors):
        letters[i, : len(name)] = [ord(letter) for letter in name]
    packed = Effectors(variables, mix, _axis_shares(mix), np.linalg.pinv(mix))
    return mix[: len(effectors)].copy(), packed, letters


def pack_actuators(content: VehicleDocument, mix: Floats) -> Floats:
    """Return the array of actuators [actuator, column]: axes, engine, then effectors.

    ``mix`` [effector, 3] is that of all effectors. The key ``surfaces`` supplies omitted values of
    effectors, and all values of axes that count as effectors.
    """
    surfaces = content.surfaces
    engine = content.propulsion
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
