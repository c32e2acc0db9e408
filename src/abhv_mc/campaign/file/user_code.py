"""A campaign's own code: taken from its user's files, or from a folder's copies where it is trusted."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.control.controller_file import Controller, read_controller
from abhv_mc.control.law_file import USER_LAWS, UserController
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.plans import read_plan
from abhv_mc.io.documents import InputError, read_document
from abhv_mc.user_code.law_source import law_place, read_law_source
from abhv_mc.user_code.source import OwnSource, read_source
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder


def read_trusted_plan(folder: CampaignFolder, controller: str, trusted: bool = False) -> FlightPlan:
    """A stored plan with the code that it needs, from the folder's copies.

    Raises InputError where the code is missing, or is not in the user's list of what he has flown.
    """
    plan = read_plan(folder.plan(controller))
    if plan.source_hash:
        place = folder.inputs / "controllers" / controller
        plan = replace(plan, source=_take(_read_laws(place), place, plan.source_hash, trusted))
    if plan.channels_hash:
        place = folder.inputs / "channels"
        sources = map(read_source, sorted(place.rglob("*.py")))
        plan = replace(plan, channels_source=_take(sources, place, plan.channels_hash, trusted))
    return plan


def _read_laws(place: Path) -> Iterator[OwnSource]:
    """The code of every controller file in a folder."""
    for path in sorted(place.rglob("*.y*ml")):
        controller = read_controller(path)
        if isinstance(controller, UserController):
            yield read_law_source(controller)


def _take(sources: Iterable[OwnSource], place: Path, digest: str, trusted: bool) -> OwnSource:
    for source in sources:
        if source.hash == digest:
            check_trusted(source, trusted)
            return source
    found = "no copy of the code that was flown"
    raise InputError(place, None, None, found, "the files as they were: restore them, or run with --fresh")


def check_own_code(campaign: CheckedCampaign, trusted: bool = False) -> list[OwnSource]:
    """The campaign's own code, where this user may run them: his own, and those of a folder that he has flown.

    Not run here. Raises InputError for others, unless he says that he trusts them.
    """
    model, foreign = campaign.model, is_in_a_folder(campaign.document.path)
    code = [(model.channels, read_source(model.channels))] if model.channels is not None else []
    for path in model.controllers.values():
        data = read_document(path).data
        if isinstance(data, dict) and data.get("law") in USER_LAWS:
            controller = read_controller(path)
            if isinstance(controller, UserController):
                code.append((law_place(controller), read_law_source(controller)))
    own = []
    for file, source in code:
        if foreign or is_in_a_folder(file):
            check_trusted(source, trusted)
        else:
            own.append(source)
    return own


def check_own_law(controller: Controller, trusted: bool = False) -> None:
    """Raise InputError for a controller whose code is a folder's copy that this user has not flown, nor trusts."""
    if isinstance(controller, UserController) and is_in_a_folder(law_place(controller)):
        check_trusted(read_law_source(controller), trusted)
