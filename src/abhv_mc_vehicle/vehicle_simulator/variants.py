"""Variants of controllers for studies over parameters: controller files with changed entries."""

import re
from dataclasses import replace
from itertools import product
from typing import Any

from abhv_mc.io.documents import Document, Problems, validate
from abhv_mc.io.messages import InputError, InputErrors, one_of
from abhv_mc_vehicle.control.controller_file import read_controller_document
from abhv_mc_vehicle.vehicle_simulator.campaign_file import VehicleCampaign
from abhv_mc_vehicle.vehicle_simulator.references import temporary_folder, write_input
from abhv_mc_vehicle.vehicle_simulator.stored_plans import check_user_law


def add_variants(document: Document) -> Document:
    """Return the campaign with each of its ``variants`` as a controller.

    The files of the variants are in a temporary folder. A name states the base and the changed
    entries, as in ``tlc+altitude.bandwidth=0.02``. Raise InputErrors for invalid variants.
    """
    data, errors = document.entries, Problems(document)
    if "variants" not in data:
        return document
    model = validate(document, VehicleCampaign)
    controllers = {**data["controllers"]}
    for number, study in enumerate(model.variants):
        place = ("variants", number)[: 1 + isinstance(data["variants"], list)]
        grids: dict[str, dict[str, list[Any]]] = {}
        for key, values in study.items():
            name, _, entry = key.partition(".")
            grids.setdefault(name, {})[entry] = values
            for i, value in enumerate(values):
                try:
                    read_controller_document(_change(model, name, {entry: value}))
                except InputError as error:
                    errors.add((*place, key, i), error.found, error.expected)
        for name, grid in {} if errors else grids.items():
            for chosen in product(*grid.values()):
                changed = _change(model, name, dict(zip(grid, chosen, strict=True)))
                texts = (re.sub("[^A-Za-z0-9.-]+", "_", str(value)) for value in chosen)
                variant = "+".join((name, *map("{}={}".format, grid, texts)))
                folder = temporary_folder() / f"{hash(repr(changed)):x}" / variant
                controllers[variant] = str(write_input(changed, folder, "control"))
    if errors:  # An unknown key is one problem, not one for each value.
        raise InputErrors([*{error.found: error for error in reversed(errors)}.values()])
    others = {key: value for key, value in data.items() if key != "variants"}
    return replace(document, data={**others, "controllers": controllers})


def _change(model: VehicleCampaign, name: str, entries: dict[str, Any]) -> Document:
    """Return a controller file with changed entries.

    Raise InputError for an unknown controller, untrusted code, or an entry that cannot be changed.
    """
    if name not in model.controllers:
        hint = f"; vary({name}=...) in Python makes a campaign with another {name}"
        expected = one_of(model.controllers, name) + hint * (name in ("vehicle", "mission"))
        raise InputError(name, f"unknown controller '{name}'", expected)
    document, law = read_controller_document(model.controllers[name])
    check_user_law(law, trusted=False)  # The copy will not be in a results folder.
    return document.with_entries(entries)
