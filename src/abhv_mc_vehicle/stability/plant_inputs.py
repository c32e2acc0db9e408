"""Inputs of the plant in a linear model: surfaces or effectors, and the engine."""

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.arguments import SavedFlights
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight.interface import O_ROWS, Z_ROWS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH, LOW
from abhv_mc_vehicle.kernel.plant.actuators import MOVES, N_EFFECTOR_ROWS, POSITION
from abhv_mc_vehicle.kernel.plant.vehicle import EFFECTORS, NEVER, Vehicle
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.user_code.effector_commands import commands_effectors
from abhv_mc_vehicle.user_code.vehicle_functions import find_code
from abhv_mc_vehicle.vehicle.actuators import name_effectors, surface_list, surface_mix
from abhv_mc_vehicle.vehicle.vehicle_code import name_states

INPUTS = ("aileron", "rudder", "elevator", "equivalence_ratio")


def name_inputs(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the plant's inputs, with the engine last."""
    return (*name_effectors(vehicle), INPUTS[3]) if vehicle.constants.driven else INPUTS


def plant_states(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the plant's states.

    The states are path coordinates, position and rate of each input, and custom states.
    """
    return (
        *path.COORDINATES,
        *(f"{name}{suffix}" for name in name_inputs(vehicle) for suffix in ("", "_rate")),
        *(f"state.{name}" for name, *_ in name_states(find_code(vehicle))),
    )


def plant_units(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the units of the plant's states."""
    surfaces = len(name_inputs(vehicle)) - 1
    own = (unit for _, unit, _ in name_states(find_code(vehicle)))
    return (*path.UNITS, *["rad", "rad/s"] * surfaces, "-", "1/s", *own)


def solved_states(plan: FlightPlan) -> Ints:
    """Return the indices of the custom states whose values a trim determines.

    A trim determines the custom states that have no initial value.
    """
    states = plan.vehicle_code.states if plan.vehicle_code else ()
    return np.array([i for i, state in enumerate(states) if state.start is None], np.int64)


def custom_of(vehicle: Vehicle, lane: Floats) -> Floats:
    """Return the custom states [point, state] in the kernel's memory `lane` [point, row]."""
    return np.ascontiguousarray(lane[:, s.CUSTOM_STATE : s.CUSTOM_STATE + vehicle.foreign.states])


def mixes(plan: FlightPlan) -> bool:
    """Return whether the controller commands axes that are mixed into effector commands."""
    own = plan.law in USER_LAWS and plan.source is not None and commands_effectors(plan.source)
    return bool(plan.vehicle.constants.driven) and not own


def mix_matrix(vehicle: Vehicle) -> Floats:
    """Return the matrix [input, 4] that maps the three axes and the engine to the inputs."""
    mix = np.pad(surface_mix(vehicle), ((0, 1), (0, 1)))
    mix[-1, -1] = 1.0
    return mix


def from_axes(vehicle: Vehicle, axes: Floats) -> Floats:
    """Convert positions or commands of axes and engine [point, 4] to inputs [point, input]."""
    return axes @ mix_matrix(vehicle).T if vehicle.constants.driven else axes


def as_axes(vehicle: Vehicle, inputs: Floats) -> Floats:
    """Convert positions or commands of inputs [point, input] to axes and engine [point, 4]."""
    return inputs @ np.linalg.pinv(mix_matrix(vehicle)).T if vehicle.constants.driven else inputs


def range_of(vehicle: Vehicle) -> tuple[Floats, Floats]:
    """Return the lowest and highest nominal position of each input [input]."""
    actuators = vehicle.actuators[surface_list(vehicle)]
    return actuators[:, LOW].copy(), actuators[:, HIGH].copy()


def held_at(vehicle: Vehicle, lane: Floats) -> Floats:
    """Return the deflections [point, input - 1] of stuck inputs; NEVER for all others."""
    first = s.STUCK_EFFECTOR if vehicle.constants.driven else s.STUCK_SURFACE
    return lane[:, first : first + len(surface_mix(vehicle))]


def sticks_here(vehicle: Vehicle, lane: Floats) -> Mask:
    """Return a mask [point, input - 1] of inputs that are stuck at their present position."""
    stuck = held_at(vehicle, lane) != NEVER
    names = EFFECTORS[: len(vehicle.effector_mix)] if vehicle.constants.driven else INPUTS[:3]
    for i, name in enumerate(names):
        stuck[:, i] &= lane[:, s.parameter_row(f"failure.{name}.stuck_at")] == NEVER
    return stuck


def moving_of(plan: FlightPlan, saved: SavedFlights) -> Floats:
    """Return the memory [flight, row] of the effector actuators; no rows if none exist."""
    return np.ascontiguousarray(
        saved.rows[:, Z_ROWS + O_ROWS :] if plan.vehicle.constants.driven else saved.rows[:, :0]
    )


def actuator_columns(vehicle: Vehicle) -> list[int]:
    """Return the columns of saved flights with each input's position and rate, alternating."""
    first = s.X + s.AILERON, s.X + s.AILERON_RATE
    pairs = [(first[0] + i, first[1] + i) for i in range(3)]
    if vehicle.constants.driven:
        starts = (Z_ROWS + O_ROWS + e * N_EFFECTOR_ROWS for e in range(len(vehicle.effectors.mix)))
        pairs = [(start + POSITION, start + MOVES) for start in starts]
    return [column for pair in (*pairs, (s.X + s.ETA, s.X + s.ETA_RATE)) for column in pair]
