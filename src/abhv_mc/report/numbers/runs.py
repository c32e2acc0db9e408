"""List of the campaigns in a folder and its subfolders, from manifests and reports."""

import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.folder.stores import read_status
from abhv_mc.interfaces import Store
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.summary import parse_summary, read_current_numbers

COMPARISON_FILE = "comparison.json"  # file with the numbers of a comparison, next to its page
_MANIFEST = "manifest.json"


@dataclass(frozen=True, kw_only=True)
class CampaignRun:
    """Campaign in a folder; if it cannot be read, ``problem`` is the reason."""

    folder: str  # path relative to the searched folder
    name: str = ""
    state: str = ""
    started: str = ""
    question: str = ""
    answer: str = ""
    # numbers of binding requirements by verdict, and the controllers that they bind
    verdicts: Mapping[str, int] = field(default_factory=dict)
    controllers: tuple[str, ...] = ()
    flights: int = 0  # flights of each controller
    flights_planned: int = 0
    version: str = ""
    commit: str = ""
    digest: str = ""
    has_page: bool = False
    problem: str = ""


@dataclass(frozen=True)
class CampaignRuns:
    """Campaigns below a folder, latest first, and the pages of comparisons."""

    runs: tuple[CampaignRun, ...]
    # digests of two campaigns, separated by a space -> relative path of their comparison page
    comparisons: Mapping[str, str]


def find_runs(root: Path, store: Store) -> CampaignRuns:
    """Return every campaign below ``root``, the local folder of a store."""
    runs, comparisons = [], {}
    for folder, files in _walk(root):
        name = folder.relative_to(root).as_posix()
        if _MANIFEST in files:
            run = _read_run(folder, name, store)
            runs += [run] if run else []
        elif COMPARISON_FILE in files and "report.html" in files:
            digests = _digests(folder / COMPARISON_FILE)
            if digests is not None:
                comparisons[digests] = f"{name}/report.html"
    runs.sort(key=lambda run: (run.started, run.folder), reverse=True)
    return CampaignRuns(tuple(runs), comparisons)


def _walk(root: Path) -> Iterator[tuple[Path, list[str]]]:
    """Yield folders with their files; skip hidden folders, links and a campaign's subfolders."""
    for path, folders, files in os.walk(root):
        yield Path(path), files
        is_campaign = _MANIFEST in files and Path(path) != root
        folders[:] = [] if is_campaign else sorted(f for f in folders if not f.startswith("."))


def _digests(file: Path) -> str | None:
    try:
        digest_a, digest_b = json.loads(file.read_text("utf-8"))["digests"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return f"{digest_a} {digest_b}"


def _read_run(folder: Path, name: str, store: Store) -> CampaignRun | None:
    """Read a campaign's folder; return None for a search or another program's folder."""
    paths = CampaignFolder(folder)
    try:
        if read_manifest(paths.manifest).search:
            return None
        manifest = read_status(folder, store, name).manifest
    except (InputError, OSError, RecursionError) as error:
        if not _is_ours(paths.manifest):
            return None
        return CampaignRun(
            folder=name, problem=error.found if isinstance(error, InputError) else str(error)
        )
    numbers = read_current_numbers(folder, manifest)
    return CampaignRun(
        folder=name,
        name=manifest.name,
        state=manifest.state,
        started=manifest.started or "",
        question=numbers["provenance"]["question"] or "" if numbers else "",
        answer=parse_summary(numbers["summary"]).records[0].line if numbers else "",
        verdicts=dict(Counter(entry.label for entry in manifest.requirements)),
        controllers=tuple(dict.fromkeys(entry.controller for entry in manifest.requirements)),
        flights=manifest.runs_done,
        flights_planned=manifest.runs_planned,
        version=manifest.versions.get("abhv_mc", ""),
        commit=manifest.commit or "",
        digest=manifest.digest or "",
        has_page=(folder / "report.html").is_file(),
    )


def _is_ours(manifest: Path) -> bool:
    """Return True if an unreadable manifest is damaged or contains the key 'format'."""
    try:
        content = json.loads(manifest.read_bytes())
    except (OSError, ValueError, RecursionError):
        return True
    return isinstance(content, dict) and "format" in content
