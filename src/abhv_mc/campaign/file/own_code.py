"""A campaign's own Python code: taken from its user's files, or from a folder's copies where it is trusted."""

import hashlib
from dataclasses import replace
from pathlib import Path

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.documents import InputError
from abhv_mc.own.source import OwnSource, read_source
from abhv_mc.own.trust import check_trusted
from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.plans import read_plan


def read_trusted_plan(folder: CampaignFolder, controller: str, trusted: bool = False) -> FlightPlan:
    """A stored plan with the code that it needs, from the folder's copies.

    Raises InputError where the code is missing, or is not in the user's list of what he has flown.
    """
    plan = read_plan(folder.plan(controller))
    if plan.source_hash:
        place = folder.inputs / "controllers" / controller
        plan = replace(plan, source=_take(place, plan.source_hash, trusted))
    if plan.channels_hash:
        plan = replace(plan, channels_source=_take(folder.inputs / "channels", plan.channels_hash, trusted))
    return plan


def _take(place: Path, digest: str, trusted: bool) -> OwnSource:
    for path in sorted(place.rglob("*.py")):
        if hashlib.sha256(path.read_bytes()).hexdigest() == digest:
            source = read_source(path)
            check_trusted(source, trusted)
            return source
    found = "no copy of the Python code that was flown"
    raise InputError(place, None, None, found, "the file as it was: restore it, or run with --fresh")


def is_folder_copy(campaign: Path) -> bool:
    """Whether a campaign file is one that the program wrote into a campaign's folder: nobody's own file."""
    return (campaign.parent / "manifest.json").exists()
