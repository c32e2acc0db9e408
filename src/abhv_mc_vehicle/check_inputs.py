"""Full check of input files of any kind, including the files that they refer to."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.feasibility import find_impossible, find_slips
from abhv_mc.campaign.file.kinds import find_kind
from abhv_mc.campaign.file.systems import is_own
from abhv_mc.custom_code.source import is_in_a_folder, is_trusted
from abhv_mc.entry_points import BLOCKS, find_entry_points
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc.shipped import DEFAULT_VEHICLE, shipped_configs
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.design.profile import make_profile
from abhv_mc_vehicle.control.law_file import UserController
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.user_code.law_source import law_place, read_law_source
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.warnings import find_vehicle_warnings

Pending = list[
    tuple[Path, str | None, tuple[Path, Path] | None]
]  # (file, kind of file, and the campaign's vehicle and mission)


@dataclass(frozen=True)
class CheckedInput:
    """Valid input file with its warnings."""

    path: Path
    kind: str
    warnings: tuple[str, ...] = ()


def check_inputs(path: Path) -> list[CheckedInput]:
    """Check a file and all files that it refers to, each of them once.

    Raise InputErrors with the problems of all files.
    """
    checked = []
    errors: list[InputError] = []
    pending: Pending = [(path, None, None)]
    seen: set[Path] = set()
    while pending:
        file, kind, flown = pending.pop(0)
        if file.resolve() in seen:
            continue
        seen.add(file.resolve())
        try:
            kind = find_kind(file, kind)
            warnings = tuple(_check(file, kind, flown, pending))
            checked.append(CheckedInput(file, kind, warnings))
        except InputErrors as several:
            errors.extend(several.errors)
        except InputError as error:
            errors.append(error)
    if errors:
        raise InputErrors(errors)
    return checked


def _check(
    file: Path, kind: str, flown: tuple[Path, Path] | None, pending: Pending
) -> Iterator[str]:
    """Check one file, yield its warnings and add referenced files to ``pending``."""
    if kind == "campaign":
        data = read_document(file).data
        # An imported table determines the number of flights.
        counts_rows = is_own(data) and not {"simulator", "runs"} & set(data)
        checked = read_campaign(file, runs=1 if counts_rows else None)
        simulator = checked.simulator
        campaign = checked.model
        infeasible = [] if counts_rows else find_impossible(checked)
        if problems := [*infeasible, *simulator.find_lacking()]:
            raise InputErrors(problems)
        yield from simulator.try_out()
        yield from find_slips(checked)
        if simulator.mission is None:
            return
        for name, block in find_entry_points(BLOCKS).items():
            if getattr(campaign, name, None) is not None:
                block.load()(checked)
        flown = campaign.vehicle, campaign.mission
        pending += [(campaign.vehicle, "vehicle", None), (campaign.mission, "mission", None)]
        pending += [
            (controller, "controller", flown) for controller in campaign.controllers.values()
        ]
    elif kind == "vehicle":
        yield from find_vehicle_warnings(load_vehicle(file))
    elif kind == "mission":
        mission = read_mission(file)
        profile = make_profile(mission, np.arange(0.0, mission.duration, 1.0))
        yield from mission.find_air_warnings(profile.altitude)
    else:
        controller = read_controller(file)
        yield from controller.warnings()
        if isinstance(controller, UserController):
            yield from _try_law(file, controller, flown)


def _try_law(
    file: Path, controller: UserController, flown: tuple[Path, Path] | None
) -> Iterator[str]:
    """Compile a controller, simulate its first ticks and yield warnings.

    ``flown`` contains the vehicle and mission of the campaign; if it is None, shipped files are
    used. Code in a results folder is skipped if the user has not run it before. Raise InputError if
    a tick fails.
    """
    location = law_place(controller)
    if is_in_a_folder(location) and not is_trusted(read_law_source(controller)):
        yield (
            "the code was not run, because it is in a results folder and you have not run it before"
        )
        return
    configs = shipped_configs()
    vehicle, mission = flown or (
        configs / f"vehicle/{DEFAULT_VEHICLE}.yaml",
        configs / "mission/level.yaml",
    )
    prepare(vehicle, mission, file, file.stem)
