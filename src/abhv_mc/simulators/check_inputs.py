"""The full check of a file of any kind, and of what it names, without flying."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.kinds import files_named, find_kind
from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.law_file import UserController
from abhv_mc.control.mission import read_mission
from abhv_mc.io.documents import InputError, InputErrors, read_document
from abhv_mc.simulators.campaign_code import check_user_code
from abhv_mc.simulators.feasibility import find_impossible
from abhv_mc.simulators.user_simulator.process import LostFlightError, Process
from abhv_mc.simulators.user_simulator.user_plan import make_user_plans
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.warnings import find_vehicle_warnings

_NAMED = 3  # dispersions of a warning
Pending = list[tuple[Path, str | None, tuple[Path, Path] | None]]  # file, kind, vehicle and mission of its campaign


@dataclass(frozen=True)
class CheckedInput:
    """A file that is right, and what deserves a second look nevertheless."""

    path: Path
    kind: str
    warnings: tuple[str, ...] = ()


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


def _check(file: Path, kind: str, flown: tuple[Path, Path] | None, pending: Pending) -> Iterator[str]:
    """Check one file, yield its warnings and add the files that it names to ``pending``."""
    if kind == "campaign":
        try:
            checked = read_campaign(file)
        except InputError:
            # What is wrong with the files that it names is said in the same breath.
            pending += [(path, kind, None) for _, kind, path in files_named(read_document(file))]
            raise
        campaign = checked.model
        problems = find_impossible(checked, None if checked.user_model else load_vehicle(campaign.vehicle))
        if problems:
            raise InputErrors(problems)
        drawn = [name for name in checked.names if name.startswith("aero.") or name.endswith("_effectiveness")]
        if drawn:
            more = f" and {len(drawn) - _NAMED} more" if len(drawn) > _NAMED else ""
            yield f"{', '.join(drawn[:_NAMED])}{more}: is this one value for the whole programme? Then 'unknowns'"
        if checked.user_model and checked.adopted:
            return
        if checked.user_model:
            check_user_code(checked)
            try:
                Process(next(iter(make_user_plans(checked, checked.controllers).values()))).end()
            except (LostFlightError, OSError) as error:
                place = checked.document.key_error(("simulator",), str(error), "a simulator that starts")
                raise InputErrors([place]) from None
            return
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
            from abhv_mc.simulators.try_law import try_law

            yield from try_law(file, controller, *(flown or (None, None)))
