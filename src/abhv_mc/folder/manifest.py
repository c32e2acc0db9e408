"""Manifest of a results folder: content, state and provenance."""

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from abhv_mc.bounds import Bounds
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.layout import write_text
from abhv_mc.identity import Flyer
from abhv_mc.io.messages import InputError
from abhv_mc.statistics.verdicts import label_status

Ranges = tuple[tuple[int, int], ...]  # (first, stop) of each range of flights
# Version of the folder's format, which increases when the meaning of a file changes.
FORMAT = 4
RUNNING, COMPLETE, INTERRUPTED = "running", "complete", "interrupted"
_HASH = "manifest_hash"  # entry with the hash of all other entries
_REMEDY = "the original manifest, or a new run with --fresh or in another folder (-o DIR)"


@dataclass(frozen=True)
class ControllerCount:
    """Numbers of flights of one controller by outcome."""

    outcomes: Mapping[str, int] = field(default_factory=dict)
    flights_done: int = 0
    failed_to_run: tuple[int, ...] | None = None  # numbers of the flights that failed to run


@dataclass(frozen=True)
class RequirementVerdict:
    """Verdict on a requirement for one controller.

    The number ``failures`` includes flights that failed to run; ``failures_not_computed`` is the
    number of these flights.
    """

    metric: str
    probability: float
    controller: str
    verdict: str
    words: str
    id: str | None = None
    text: str | None = None
    source: str | None = None
    rationale: str | None = None
    above: float | None = None
    below: float | None = None
    consumer_risk: float = 0.0
    producer_risk: float = 0.0
    flights: int = 0
    failures: int = 0
    failures_ended_early: int = 0
    failures_measured: int = 0
    failures_not_computed: int = 0
    set_later: bool = False  # whether the requirement was set after results were known

    @property
    def label(self) -> str:
        """Verdict, marked if the requirement was set after results were known."""
        return label_status(self.verdict, self.set_later)

    @property
    def asked(self) -> str:
        """Requirement as text, such as 'altitude_error_max_m below 50'."""
        return f"{self.metric} {Bounds(self.above, self.below)}"


@dataclass(frozen=True)
class FlownBy:
    """Process that computed flights, and the numbers of these flights."""

    code: str
    versions: str
    processor: str
    features: str
    host: str
    blocks: Mapping[str, Ranges]  # ranges of flights by controller


@dataclass(frozen=True)
class Pooled:
    """Flights of one seed in a campaign merged from several campaigns."""

    seed: int
    runs: int


@dataclass(frozen=True)
class RequirementSet:
    """Set of requirements by which the flights were judged."""

    file: str  # name of the file in the folder
    time: str | None  # time when the set of requirements was defined
    flights: int  # number of flights per controller that were run before that time


@dataclass(frozen=True)
class Manifest:
    """Content of ``manifest.json``; entries that are None are omitted."""

    name: str
    state: str
    seed: int
    campaign_hash: str
    source_hash: str
    runs_planned: int = 0
    runs_done: int = 0
    runs_failed: int = 0
    question: str | None = None  # hash of the campaign without its seed; None for a search
    started: str | None = None
    wall_time_s: float = 0.0
    digest: str | None = None
    digests: Mapping[str, str] = field(default_factory=dict)
    earlier_digests: tuple[str, ...] | None = None  # digests before metrics were added
    controllers: Mapping[str, ControllerCount] = field(default_factory=dict)
    requirements: tuple[
        RequirementVerdict, ...
    ] = ()  # verdicts for controllers that must meet the requirements
    # verdicts for controllers that need not meet the requirements
    requirements_shown: tuple[RequirementVerdict, ...] = ()
    requirement_sets: tuple[RequirementSet, ...] = ()  # sets of requirements in chronological order
    versions: Mapping[str, str] = field(default_factory=dict)
    compiler: str | None = None
    commit: str | None = None
    machine: Mapping[str, str | int] = field(default_factory=dict)
    command: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of each input file by path
    warnings: tuple[str, ...] = ()
    repeatable: Repeatability | None = None  # repeatability of a custom simulator
    not_made: tuple[str, ...] = ()
    shard: tuple[int, int] | None = None  # (i, n) if the folder contains shard i of n
    merged_from: tuple[str, ...] | None = None  # digests of the merged campaigns
    pooled: tuple[Pooled, ...] | None = None
    # number of flights per point in the campaign file, if it exceeds the simulated number
    file_runs: int | None = None
    stopped_at: int | None = None  # number of flights at which a campaign stopped when proven
    search: Mapping[str, Any] | None = None  # settings of a search
    result: Mapping[str, Any] | None = None  # result of a search
    files: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of each stored file by path
    flown_by: tuple[FlownBy, ...] = ()
    # Events of a custom simulator by system: "surplus", "repeated" and "restarts".
    simulator_events: Mapping[str, Mapping[str, int]] | None = None

    @property
    def complete(self) -> bool:
        """True if all flights are computed."""
        return self.state == COMPLETE

    def as_entries(self) -> dict[str, Any]:
        """Return the entries of the manifest for JSON."""
        content: dict[str, Any] = _FILE.dump_python(self, exclude_none=True)
        return {"format": FORMAT} | content


_FILE = TypeAdapter(Manifest)


def manifest_schema() -> dict[str, Any]:
    """Return the JSON Schema of ``manifest.json``."""
    return _FILE.json_schema()


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write the manifest with its format number and a hash of its entries."""
    content = manifest.as_entries()
    write_text(path, json.dumps(content | {_HASH: hash_entries(content)}, indent=2) + "\n")


def read_manifest(path: Path) -> Manifest:
    """Read a manifest. Raise InputError if the file is missing, damaged or of another format."""
    if not path.is_file():
        if path.parent.is_file():
            raise InputError(
                path.parent, "the path is a file", "a results folder written by `abhv-mc run`"
            )
        raise InputError(path, "no such file", "the folder of a campaign")
    try:
        manifest = json.loads(path.read_bytes())
    except ValueError as error:
        raise InputError(path, f"the manifest is damaged ({error})", _REMEDY) from None
    version = manifest.get("format") if isinstance(manifest, dict) else None
    if version != FORMAT:
        problem = "the format number is missing"
        if version is not None:
            problem = f"the folder was written by another version of abhv-mc (format {version})"
        expected = f"format {FORMAT} (use the version that wrote the folder, or run it again)"
        raise InputError(path, problem, expected)
    if manifest.pop(_HASH, None) != hash_entries(manifest):
        raise InputError(path, "the manifest is damaged (its hash differs)", _REMEDY)
    try:
        return _FILE.validate_python(manifest)
    except ValidationError as error:
        raise entry_error(path, error, _REMEDY) from None


def entry_error(path: Path, error: ValidationError, expected: str) -> InputError:
    """Return the InputError for the first invalid entry of a JSON file."""
    first = error.errors()[0]
    return InputError(
        path, f"invalid entry '{'.'.join(map(str, first['loc']))}' ({first['msg']})", expected
    )


def hash_entries(content: dict[str, Any]) -> str:
    """Return the hash of entries that is stored beside them."""
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def note_flyers(
    entries: Iterable[FlownBy], flyers: tuple[Flyer, ...], controller: str, first: int, stop: int
) -> tuple[FlownBy, ...]:
    """Return the entries with flights ``first`` to ``stop - 1`` recorded for ``flyers``.

    These flights are removed from the entries of other processes.
    """
    updated = []
    for entry in entries:
        ranges = entry.blocks.get(controller, ())
        remaining = [(a, min(b, first)) for a, b in ranges if a < first] + [
            (max(a, stop), b) for a, b in ranges if b > stop
        ]
        updated.append(replace(entry, blocks={**entry.blocks, controller: tuple(remaining)}))
    added = [FlownBy(*flyer[:5], blocks={controller: ((first, stop),)}) for flyer in flyers]
    return tuple(entry for entry in join_flyers([*updated, *added]) if any(entry.blocks.values()))


def add_events(
    events_by_process: Iterable[Mapping[str, Mapping[str, int]] | None],
) -> dict[str, dict[str, int]] | None:
    """Return the total numbers of simulator events by system, or None if there are none."""
    sums = defaultdict[str, Counter[str]](Counter)
    for counts in events_by_process:
        for name, events in (counts or {}).items():
            sums[name].update(events)
    return {name: dict(events) for name, events in sums.items()} or None


def shift_flyers(entries: Iterable[FlownBy], flights: int) -> list[FlownBy]:
    """Return the entries with all flight numbers increased by ``flights``."""
    return [
        replace(
            entry,
            blocks={
                name: tuple((a + flights, b + flights) for a, b in ranges)
                for name, ranges in entry.blocks.items()
            },
        )
        for entry in entries
    ]


def join_flyers(entries: Iterable[FlownBy]) -> tuple[FlownBy, ...]:
    """Merge the entries of the same process, and return one entry per process."""
    joined: dict[tuple[str, str, str, str, str], dict[str, Ranges]] = {}
    for entry in entries:
        blocks = joined.setdefault(
            (entry.code, entry.versions, entry.processor, entry.features, entry.host), {}
        )
        for controller, ranges in entry.blocks.items():
            blocks[controller] = _join((*blocks.get(controller, ()), *ranges))
    return tuple(FlownBy(*process, blocks=blocks) for process, blocks in joined.items())


def _join(ranges: Ranges) -> Ranges:
    """Return ascending ranges, with adjacent ranges merged."""
    joined: list[tuple[int, int]] = []
    for first, stop in sorted(ranges):
        if joined and first <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(stop, joined[-1][1])
        else:
            joined.append((first, stop))
    return tuple(joined)
