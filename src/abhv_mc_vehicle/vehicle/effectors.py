"""Queries of the effectors and actuators in a vehicle's arrays."""

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.plant.actuator_step import (
    AXES,
    DEAD_ZONE,
    ENGINE,
    FIRST_EFFECTOR,
    FIRST_ORDER,
    HIGH,
    KIND,
    LOW,
)
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Vehicle

_FIRST = VARIABLES.index("effector_0")


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
    low, high = -limit, limit
    if vehicle.constants.driven:
        actuators = vehicle.actuators[FIRST_EFFECTOR:]
        for mix, actuator in zip(vehicle.effectors.mix[:, axis], actuators, strict=True):
            if mix != 0.0:
                ends = sorted((actuator[LOW] / mix, actuator[HIGH] / mix))
                low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
