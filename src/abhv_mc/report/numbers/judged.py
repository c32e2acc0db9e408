"""A judgement as it is kept and said: a run with nothing new reads it without what it was made of."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from abhv_mc.folder.manifest import Manifest
from abhv_mc.topics.section import Lead

Met: TypeAlias = Literal["yes", "no", "not shown", "nothing required"]


@dataclass(frozen=True)
class Next:
    """What to do next; no command where nothing that can be run would help. DIR in it is the results folder."""

    why: str
    command: str = ""


@dataclass(frozen=True)
class Judgement:
    """Two answers and what they rest on."""

    met: Met  # of the binding controllers
    better: str  # a controller, MIXED, NO_DIFFERENCE or ALONE
    because: tuple[str, ...]  # those first that would change a decision
    sure: str
    next: Next | None
    answer: str  # both answers in words


def judgement_lead(found: Judgement, folder: str) -> Lead:
    """The judgement in words; ``folder`` as a command names it."""
    told = ""
    if found.next:
        command = f": `{found.next.command.replace('DIR', folder)}`" if found.next.command else ""
        told = f"Next: {found.next.why}{command}."
    return Lead(found.answer, found.because, found.sure, told)


def read_judgement(folder: Path, manifest: Manifest) -> Judgement | None:
    """The judgement that a folder's `report.json` holds; None where that is not of its flights, or is not there."""
    try:
        held = json.loads((folder / "report.json").read_text("utf-8"))
        flown = manifest.digest, manifest.state, len(manifest.requirement_sets)
        if (held["digest"], held["state"], held.get("requirement_sets", 0)) != flown:
            return None
        found = held["judgement"]
        following = Next(**found["next"]) if found["next"] else None
        return Judgement(**{**found, "because": tuple(found["because"]), "next": following})
    except (OSError, ValueError, KeyError, TypeError):
        return None
