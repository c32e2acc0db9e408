"""The four kinds of input file: which one a file is, its model, and its full check without flying."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.feasibility import find_impossible
from abhv_mc.control.controller_file import CONTROLLERS, ControllerFile, read_controller
from abhv_mc.control.law_file import UserController
from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.io.documents import InputError, InputErrors, describe, one_of, read_document
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.document import VehicleDocument
from abhv_mc.vehicle.warnings import find_vehicle_warnings

MODELS: dict[str, type[BaseModel]] = {
    "campaign": Campaign,
    "vehicle": VehicleDocument,
    "mission": Mission,
    "controller": ControllerFile,
}
_KEYS: dict[str, set[str]] = {
    **{kind: set(model.model_fields) for kind, model in MODELS.items()},
    "controller": {key for model in CONTROLLERS.values() for key in model.model_fields},
}

Pending = list[tuple[Path, str | None, tuple[Path, Path] | None]]  # file, kind, vehicle and mission of its campaign


@dataclass(frozen=True)
class CheckedInput:
    """A file that is right, and what deserves a second look nevertheless."""

    path: Path
    kind: str
    warnings: tuple[str, ...] = ()


def find_kind(path: Path) -> str:
    """The kind of a file by its keys. Raises :class:`InputError` where they fit none."""
    document = read_document(path)
    keys = set(document.data) if isinstance(document.data, dict) else set()
    shared = {kind: len(keys & known) for kind, known in _KEYS.items()}
    kind = max(shared, key=lambda name: shared[name])
    if not shared[kind]:
        raise document.error((), describe(document.data), f"the keys of {one_of(MODELS)}")
    return kind


def check_inputs(path: Path) -> list[CheckedInput]:
    """Check a file of any kind and every file that it names, once each.

    Raises :class:`InputErrors` with everything that is wrong in all of them.
    """
    checked: list[CheckedInput] = []
    errors: list[InputError] = []
    pending: Pending = [(path, None, None)]
    seen: set[Path] = set()
    while pending:
        file, kind, flown = pending.pop(0)
        if file.resolve() in seen:
            continue
        seen.add(file.resolve())
        try:
            kind = kind or find_kind(file)
            warnings = tuple(_check(file, kind, flown, pending))
            checked.append(CheckedInput(file, kind, warnings))
        except InputErrors as several:
            errors.extend(several.errors)
        except InputError as error:
            errors.append(error)
    if errors:
        raise InputErrors(errors)
    return checked


def _check(file: Path, kind: str, flown: tuple[Path, Path] | None, pending: Pending) -> Iterator[str]:
    """Check one file, yield its warnings and add the files that it names to ``pending``."""
    if kind == "campaign":
        try:
            checked = read_campaign(file)
        except InputError:
            pending += _files_named(file)  # what is wrong with them is said in the same breath
            raise
        campaign = checked.model
        problems = find_impossible(checked, load_vehicle(campaign.vehicle))
        if problems:
            raise InputErrors(problems)
        flown = campaign.vehicle, campaign.mission
        pending += [(campaign.vehicle, "vehicle", None), (campaign.mission, "mission", None)]
        pending += [(controller, "controller", flown) for controller in campaign.controllers.values()]
    elif kind == "vehicle":
        yield from find_vehicle_warnings(load_vehicle(file))
    elif kind == "mission":
        read_mission(file)
    else:
        controller = read_controller(file)
        yield from controller.warnings()
        if isinstance(controller, UserController):
            from abhv_mc.campaign.file.try_law import try_law

            yield from try_law(file, controller, *(flown or (None, None)))


def _files_named(campaign: Path) -> Pending:
    """The files that a campaign names, where they are there, whatever else is wrong with it."""
    document = read_document(campaign)
    data: dict[str, Any] = document.data if isinstance(document.data, dict) else {}
    controllers = data.get("controllers")
    named = [(data.get(kind), kind) for kind in ("vehicle", "mission")]
    named += [(name, "controller") for name in (controllers.values() if isinstance(controllers, dict) else ())]
    paths = [(document.resolve(name), kind) for name, kind in named if isinstance(name, str)]
    return [(path, kind, None) for path, kind in paths if path.is_file()]
