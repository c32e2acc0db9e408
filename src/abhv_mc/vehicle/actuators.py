"""A vehicle as the compiled plant sees it: packed tables and constants, nothing about any one vehicle."""

import numpy as np

from abhv_mc.kernel.plant.vehicle import HIGH, LOW, VARIABLES, Effectors, Vehicle

_AXES, _FIRST = VARIABLES.index("aileron") + np.arange(3), VARIABLES.index("effector_0")


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """The names of a vehicle's effectors, in their order, and of the axes that are among them."""
    names = ["".join(map(chr, row[row > 0])) for row in vehicle.effector_names]
    return tuple(names[i - _FIRST] if i >= _FIRST else VARIABLES[i] for i in vehicle.effectors.variable)


def list_actuators(vehicle: Vehicle) -> Effectors:
    """The list of actuators but the engine's: of the three axes, or of the effectors."""
    c = vehicle.constants
    if c.driven:
        return vehicle.effectors
    row = -c.surface_limit, c.surface_limit, c.surface_rate_limit, c.surface_bandwidth, c.surface_damping
    return Effectors(_AXES, np.eye(3), np.tile((*row, c.ideal_surfaces), (3, 1)), np.zeros((3, 3, 3)), np.eye(3))


def drive(vehicle: Vehicle, driven: bool = True) -> Vehicle:
    """The vehicle with an actuator at each effector, or with actuators of the three axes, which effectors follow."""
    return vehicle._replace(constants=vehicle.constants._replace(driven=float(driven)))


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Least and greatest deflection (rad) of aileron, rudder or elevator alone that its effectors can follow."""
    low, high = -vehicle.constants.surface_limit, vehicle.constants.surface_limit
    if vehicle.constants.driven:
        for mix, actuator in zip(vehicle.effectors.mix[:, axis], vehicle.effectors.actuator, strict=True):
            if mix != 0.0:
                ends = sorted((actuator[LOW] / mix, actuator[HIGH] / mix))
                low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
