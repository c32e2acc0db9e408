"""Stored assessment of a campaign, which is read from `report.json` if it is up to date."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from abhv_mc.folder.manifest import Manifest
from abhv_mc.topics.section import Lead

Met: TypeAlias = Literal["yes", "no", "not shown", "nothing required"]


@dataclass(frozen=True)
class NextStep:
    """Recommended next step."""

    why: str
    command: str = ""  # command with DIR for the results folder; '' if no command is recommended
    assumption: str = ""  # assumption of a chance in ``why``


@dataclass(frozen=True)
class Judgement:
    """Assessment of a campaign: requirements, controller comparison, reasons and next step."""

    met: Met  # whether the controllers to which requirements apply meet them
    better: str  # name of the better controller, or MIXED, NO_DIFFERENCE or ALONE
    because: tuple[str, ...]  # reasons, most important first
    sure: str  # statement on statistical confidence
    next: NextStep | None
    answer: str  # sentences on requirements and on the better controller


def judgement_lead(judgement: Judgement, folder: str) -> Lead:
    """Return the assessment as sentences; commands contain the results ``folder``."""
    following = ""
    if judgement.next:
        command = judgement.next.command.replace("DIR", folder)
        note = f" ({judgement.next.assumption})" if judgement.next.assumption else ""
        following = f"Next: {judgement.next.why}{note}{f': `{command}`' if command else '.'}"
    return Lead(judgement.answer, judgement.because, judgement.sure, following)


def parse_judgement(entry: Mapping[str, Any]) -> Judgement:
    """Return the assessment stored as `judgement` in a `report.json`."""
    next_step = NextStep(**entry["next"]) if entry["next"] else None
    return Judgement(**{**entry, "because": tuple(entry["because"]), "next": next_step})


def read_judgement(folder: Path, manifest: Manifest) -> Judgement | None:
    """Read the assessment from a folder's `report.json`; None if missing or outdated."""
    try:
        content = json.loads((folder / "report.json").read_text("utf-8"))
        state = manifest.digest, manifest.state, len(manifest.requirement_sets)
        if (content["digest"], content["state"], content.get("requirement_sets", 0)) != state:
            return None
        return parse_judgement(content["judgement"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
