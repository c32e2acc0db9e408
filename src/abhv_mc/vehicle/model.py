"""A vehicle as the compiled plant sees it: packed tables and constants, nothing about any one vehicle."""

from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.plant.vehicle import (
    BANDWIDTH,
    DRIVEN,
    HIGH,
    IDEAL,
    LOW,
    VARIABLES,
    Vehicle,
)


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """The names of a vehicle's effectors, in their order."""
    return tuple("".join(map(chr, row[row > 0])) for row in vehicle.effector_names)


def follow_axes(vehicle: Vehicle) -> Vehicle:
    """The vehicle with effectors that follow the axes' deflections."""
    effectors = vehicle.effectors.copy()
    effectors[:, DRIVEN] = 0.0
    return vehicle._replace(effectors=effectors)


def drive_all(vehicle: Vehicle) -> Vehicle:
    """The vehicle with an actuator at each effector: what is not given is the surfaces'."""
    effectors = vehicle.effectors.copy()
    effectors[:, DRIVEN] = 1.0
    return vehicle._replace(effectors=effectors)


def drive_axes(vehicle: Vehicle) -> Vehicle:
    """The vehicle with actuators of the three axis deflections, which move all as its effectors' move, limits apart.

    The effectors follow by their mix. Raises InputError where actuators differ, those of an axis deflection that acts
    itself among them.
    """
    c = vehicle.constants
    driven = vehicle.effectors[:, DRIVEN] > 0.0
    if not driven.any():
        return vehicle
    kinds = vehicle.effectors[driven][:, BANDWIDTH : IDEAL + 1].tolist()
    names = [name for name, own in zip(name_effectors(vehicle), driven, strict=True) if own]
    used = {VARIABLES[i] for i in (*vehicle.build_up.variable, *vehicle.tables.axis_variable)}
    if not driven.all() or used & {"aileron", "rudder", "elevator"}:
        kinds.append([c.surface_bandwidth, c.surface_damping, c.ideal_surfaces])
        names.append("surfaces")
    other = next((i for i, kind in enumerate(kinds) if kind != kinds[0]), None)
    if other is not None:
        found = f"actuators that differ: {names[0]} ({_lag(kinds[0])}), {names[other]} ({_lag(kinds[other])})"
        raise InputError("vehicle", found, "one bandwidth and damping of all surfaces, for a linear model")
    bandwidth, damping, ideal = kinds[0]
    constants = c._replace(surface_bandwidth=bandwidth, surface_damping=damping, ideal_surfaces=ideal)
    return follow_axes(vehicle)._replace(constants=constants)


def _lag(kind: list[float]) -> str:
    bandwidth, damping, ideal = kind
    return "ideal" if ideal else f"{bandwidth:g} rad/s, damping {damping:g}"


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Least and greatest deflection (rad) of aileron, rudder or elevator alone that its effectors can follow."""
    low, high = -vehicle.constants.surface_limit, vehicle.constants.surface_limit
    for mix, effector in zip(vehicle.effector_mix[:, axis], vehicle.effectors, strict=True):
        if effector[DRIVEN] > 0.0 and mix != 0.0:
            ends = sorted((effector[LOW] / mix, effector[HIGH] / mix))
            low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
