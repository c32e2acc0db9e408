"""Detection of dispersions of components that a vehicle does not have."""

import re

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.feasibility import refuse_input
from abhv_mc.io.documents import InputError
from abhv_mc_vehicle.kernel.plant.actuator_step import COLUMNS, SLACK
from abhv_mc_vehicle.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, Vehicle
from abhv_mc_vehicle.vehicle.effectors import surface_list


def find_lacking(campaign: Experiment, vehicle: Vehicle) -> list[InputError]:
    """Return errors for dispersions of components that the vehicle does not have."""
    expected = "a dispersion that affects this vehicle"
    return [
        refuse_input(
            campaign,
            name,
            f"'{name}' refers to a component that the vehicle does not have",
            expected,
        )
        for name in campaign.varied
        if not _has(vehicle, name)
    ]


def _has(vehicle: Vehicle, name: str) -> bool:
    """Return whether a parameter can affect the vehicle.

    The only parameters without an effect are factors on components that the vehicle does not have.
    """
    group, _, suffix = name.partition(".")
    if (vehicle.foreign.aerodynamics and group == "aero") or (
        vehicle.foreign.propulsion and group == "propulsion"
    ):
        return True
    if group == "aero" and not suffix.endswith(".increment"):
        coefficient, _, variable = suffix.partition(".")
        if variable:
            return bool(np.any(vehicle.build_up.factor == PARAMETER_INDEX[name]))
        return bool(np.any(vehicle.build_up.coefficient == COEFFICIENTS.index(coefficient)))
    if effector := re.match(r"effector_(\d+)", suffix):
        return int(effector[1]) < len(vehicle.effector_mix)
    if group in ("actuator", "engine") and suffix in SLACK:
        places = surface_list(vehicle)[-1:] if group == "engine" else surface_list(vehicle)[:-1]
        return bool(vehicle.actuators[places, COLUMNS.index(suffix)].any())
    if group == "engine":
        return vehicle.constants.equivalence_ratio_max > 0.0
    thrust = "capture_area_ratio", "thrust_area"
    rows: dict[str, tuple[str, ...]] = {
        "propulsion.thrust": thrust,
        "propulsion.specific_impulse": thrust,
    }
    rows["mass.inertia_13"] = ("inertia_13",)
    return name not in rows or any(np.any(_values(vehicle, row)) for row in rows[name])


def _values(vehicle: Vehicle, row: str) -> np.ndarray:
    """Return the values of one of the FIXED_TABLE_ROWS at all nodes of its table."""
    tables = vehicle.tables
    number = int(tables.fixed_row[FIXED_TABLE_ROWS.index(row)])
    group = int(np.searchsorted(tables.group_row, number, side="right")) - 1
    stop = np.append(tables.group_start, tables.data.size)[group + 1]
    block = tables.data[tables.group_start[group] : stop].reshape(-1, tables.group_width[group])
    values: np.ndarray = block[:, number - tables.group_row[group]]
    return values
