"""Functions that rebuild stored plans, and access to the custom code of a campaign.

Plans are stored in results folders or sent to workers. Channels, control laws and vehicle functions
may be custom code.
"""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder, read_source
from abhv_mc.interfaces import REMEDY, Arrays, StoredPlans
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import Controller, read_controller
from abhv_mc_vehicle.control.design.trim_tables import rebuild_trim_tables
from abhv_mc_vehicle.control.law_file import USER_LAWS, UserController
from abhv_mc_vehicle.flight.arguments import COLUMNS
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.plan_arrays import flatten, is_stored, rebuild
from abhv_mc_vehicle.kernel.laws.columns import (
    REFERENCE,
)
from abhv_mc_vehicle.kernel.plant.air_data import PROFILE
from abhv_mc_vehicle.kernel.plant.state import N_STATES
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.stability.fly_with_margins import MarginPlan
from abhv_mc_vehicle.user_code.law_source import law_place, read_law_source, with_library
from abhv_mc_vehicle.user_code.vehicle_functions import (
    check_vehicle_trusted,
    find_code,
    load_vehicle,
)
from abhv_mc_vehicle.vehicle.file import read_vehicle_file
from abhv_mc_vehicle.vehicle_simulator.make_plans import declare_metrics

Code = dict[str, Any]  # fields of a plan that are not stored, such as custom code


def rebuild_plan(stored: Arrays, vehicle: Vehicle) -> FlightPlan:
    """Rebuild a bit-identical plan from stored arrays and the campaign's vehicle.

    Raise KeyError, ValueError or TypeError if arrays are missing or belong to another vehicle.
    """
    flat = {
        name: value for name, value in stored.items() if value.ndim == 0 or value.dtype.kind in "fU"
    }
    flat.setdefault("period", np.array(0))  # Folders of earlier versions have no period.
    for name, value in flatten(vehicle, "vehicle").items():
        if value.dtype.kind == "f":
            _check_shape(name, flat[name], value.shape)
        else:
            flat[name] = value
    numbers = (flat[f"trim_tables.{name}"] for name in ("grid", "inverse_step", "data"))
    flat |= flatten(rebuild_trim_tables(*numbers), "trim_tables")
    flat |= flatten(make_effectiveness(rebuild(Vehicle, flat, "vehicle")), "effectiveness")
    plan = rebuild(FlightPlan, flat)
    own = plan.gain_names.size, plan.settings.size  # Custom control laws determine these sizes.
    gains, settings = COLUMNS.get(plan.commanding_law, own)
    rows = plan.timing.ticks + 1
    shapes = {
        "initial_state": (N_STATES + vehicle.foreign.states,),
        "reference": (rows, len(REFERENCE)),
        "gains": (rows, gains),
        "settings": (settings,),
        "profile": (len(plan.profile), len(PROFILE)),
    }
    for name, shape in shapes.items():
        _check_shape(name, getattr(plan, name), shape)
    return plan


def _check_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: shape {array.shape} instead of {shape}")


def read_trusted_plan(
    stored: StoredPlans, campaign: Experiment, controller: str, trusted: bool
) -> FlightPlan:
    """Return the stored plan of a controller, with the custom code stored in the folder.

    Raise InputError if the code is missing or untrusted.
    """
    check_vehicle_trusted(campaign.model.vehicle, trusted)
    vehicle = load_vehicle(campaign.model.vehicle)
    plan = stored.read(controller, lambda arrays: rebuild_plan(arrays, vehicle))
    if plan.source_hash:
        code_folder = stored.root / "inputs/controllers" / controller
        laws = map(read_controller, sorted(code_folder.rglob("*.y*ml")))
        sources = (read_law_source(law) for law in laws if isinstance(law, UserController))
        plan = dataclasses.replace(
            plan, source=_take(sources, code_folder, plan.source_hash, trusted)
        )
    if plan.channels_hash:
        code_folder = stored.root / "inputs/channels"
        files = map(read_source, sorted(code_folder.rglob("*.py")))
        plan = dataclasses.replace(
            plan, channels_source=_take(files, code_folder, plan.channels_hash, trusted)
        )
    return declare_metrics(
        campaign, dataclasses.replace(plan, vehicle_code=find_code(plan.vehicle))
    )


def _take(sources: Iterable[UserSource], folder: Path, digest: str, trusted: bool) -> UserSource:
    for source in sources:
        if source.hash == digest:
            check_trusted(source, trusted)
            return with_library(source)
    raise InputError(folder, "the folder has no copy of the code that was used", REMEDY)


def code_of(plan: FlightPlan) -> Code:
    """Return the fields that are sent to workers together with the arrays of a plan."""
    fields = (field for field in dataclasses.fields(plan) if not is_stored(field))
    code = {field.name: getattr(plan, field.name) for field in fields}
    return code | ({"steady": code_of(plan.steady)} if isinstance(plan, MarginPlan) else {})


def rebuild_sent(arrays: Arrays, code: Code) -> FlightPlan:
    """Rebuild a plan that was sent to a worker as code and arrays.

    The functions :func:`code_of` and :func:`abhv_mc_vehicle.flight.plan_arrays.flatten` make them.
    """
    plan = rebuild(MarginPlan if "margin_times" in arrays else FlightPlan, arrays)
    if isinstance(plan, MarginPlan):
        code = code | {"steady": dataclasses.replace(plan.steady, **code["steady"])}
    return dataclasses.replace(plan, **code)


def find_campaign_code(model: Any) -> list[tuple[Path, UserSource]]:
    """Return the files and code of the channels, control laws and vehicle."""
    code = [(model.channels, read_source(model.channels))] if model.channels is not None else []
    for path in model.controllers.values():
        data = read_document(path).data
        if isinstance(data, dict) and data.get("law") in USER_LAWS:
            controller = read_controller(path)
            if isinstance(controller, UserController):
                code.append((law_place(controller), read_law_source(controller)))
    vehicle = read_vehicle_file(model.vehicle).code
    if vehicle is not None:
        code += [
            (Path(function.file), UserSource(function.text, function.file))
            for function in vehicle.functions()
        ]
    return code


def check_user_law(controller: Controller, trusted: bool) -> None:
    """Raise InputError if a controller in a results folder has untrusted code."""
    if isinstance(controller, UserController) and is_in_a_folder(law_place(controller)):
        check_trusted(read_law_source(controller), trusted)
