"""Stored assessment of a campaign, which a run without new flights reads from `report.json`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from abhv_mc.folder.manifest import Manifest
from abhv_mc.topics.section import Lead

Met: TypeAlias = Literal["yes", "no", "not shown", "nothing required"]


@dataclass(frozen=True)
class NextStep:
    """Recommended next step."""

    why: str
    command: str = ""  # with DIR for the results folder; '' if no command helps


@dataclass(frozen=True)
class Judgement:
    """Assessment of a campaign: requirements, controller comparison, reasons and next step."""

    met: Met  # by the binding controllers
    better: str  # a controller, MIXED, NO_DIFFERENCE or ALONE
    because: tuple[str, ...]  # the most important reason first
    sure: str  # confidence
    next: NextStep | None
    answer: str  # both answers in words


def judgement_lead(judgement: Judgement, folder: str) -> Lead:
    """Return the assessment in words; ``folder`` is the results folder in commands."""
    following = ""
    if judgement.next:
        command = judgement.next.command.replace("DIR", folder)
        following = f"Next: {judgement.next.why}{f': `{command}`' if command else '.'}"
    return Lead(judgement.answer, judgement.because, judgement.sure, following)


def read_judgement(folder: Path, manifest: Manifest) -> Judgement | None:
    """Read the assessment in a folder's `report.json`; None if it is missing or out of date."""
    try:
        content = json.loads((folder / "report.json").read_text("utf-8"))
        state = manifest.digest, manifest.state, len(manifest.requirement_sets)
        if (content["digest"], content["state"], content.get("requirement_sets", 0)) != state:
            return None
        entry = content["judgement"]
        next_step = NextStep(**entry["next"]) if entry["next"] else None
        return Judgement(**{**entry, "because": tuple(entry["because"]), "next": next_step})
    except (OSError, ValueError, KeyError, TypeError):
        return None
