"""Stored assessment of a campaign, which is read from `report.json` if it is up to date."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from abhv_mc.folder.manifest import Manifest, hash_entries
from abhv_mc.topics.section import Lead

HASH = "hash"  # entry of `report.json` with the hash of all other entries
Met: TypeAlias = Literal["yes", "no", "not shown", "nothing required"]


@dataclass(frozen=True)
class NextStep:
    """Recommended next step."""

    why: str
    command: str = ""  # command with DIR for the results folder; '' if no command is recommended


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
        following = f"Next: {judgement.next.why}{f': `{command}`' if command else '.'}"
    return Lead(judgement.answer, judgement.because, judgement.sure, following)


def parse_judgement(entry: Mapping[str, Any]) -> Judgement:
    """Return the assessment stored as `judgement` in a `report.json`."""
    next_step = NextStep(**entry["next"]) if entry["next"] else None
    return Judgement(**{**entry, "because": tuple(entry["because"]), "next": next_step})


def read_numbers(folder: Path) -> dict[str, Any] | None:
    """Read a folder's `report.json` without its hash; None if missing or damaged."""
    try:
        content: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
        return content if content.pop(HASH) == hash_entries(content) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def read_current_numbers(folder: Path, manifest: Manifest) -> dict[str, Any] | None:
    """Read a folder's `report.json`; None if missing, damaged or outdated."""
    content = read_numbers(folder) or {}
    state = manifest.digest, manifest.state, len(manifest.requirement_sets)
    stored = *map(content.get, ("digest", "state")), content.get("requirement_sets", 0)
    return content if stored == state else None


def read_judgement(folder: Path, manifest: Manifest) -> Judgement | None:
    """Read the assessment from a folder's `report.json`; None if missing or outdated."""
    content = read_current_numbers(folder, manifest)
    return parse_judgement(content["judgement"]) if content else None
