"""The manifest: what a campaign's folder holds, and where it came from."""

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from abhv_mc.bounds import Bounds
from abhv_mc.flight.repeatability import Repeatability
from abhv_mc.folder.layout import write_text
from abhv_mc.identity import Flyer
from abhv_mc.io.input_error import InputError

Ranges = tuple[tuple[int, int], ...]  # of flights: the first, one after the last
FORMAT = 1  # of the folder: what lies in it, and how
RUNNING, COMPLETE, INTERRUPTED = "running", "complete", "interrupted"
_HASH = "manifest_hash"  # of the other entries
_WISH = "a copy of the manifest as it was, or the campaign flown anew: another folder (-o DIR), or --fresh"


@dataclass(frozen=True)
class ControllerCount:
    """How the flights of one controller ended."""

    outcomes: Mapping[str, int] = field(default_factory=dict)
    flights_done: int = 0
    failed_to_run: tuple[int, ...] | None = None  # flights that could not be computed


@dataclass(frozen=True)
class RequirementVerdict:
    """A requirement as one controller met it; flights that could not be computed are failures of none."""

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

    @property
    def asked(self) -> str:
        """'altitude_error_max_m below 50'."""
        return f"{self.metric} {Bounds(self.above, self.below)}"


@dataclass(frozen=True)
class FlownBy:
    """A process that flew, and its flights."""

    code: str
    versions: str
    processor: str
    features: str
    host: str
    blocks: Mapping[str, Ranges]  # by controller


@dataclass(frozen=True)
class Pooled:
    """Flights of one seed in a campaign that was merged of several."""

    seed: int
    runs: int


@dataclass(frozen=True)
class RequirementSet:
    """A set of requirements by which the flights were judged."""

    file: str  # in the folder
    time: str | None  # when it was set
    flights: int  # of each controller that had been run by then


@dataclass(frozen=True)
class Manifest:
    """What `manifest.json` says; an entry that is None stands there not at all."""

    name: str
    state: str
    seed: int
    campaign_hash: str
    source_hash: str
    runs_planned: int = 0
    runs_done: int = 0
    runs_failed: int = 0
    question: str | None = None  # hash of it; a search asks none
    started: str | None = None
    wall_time_s: float = 0.0
    digest: str | None = None
    digests: Mapping[str, str] = field(default_factory=dict)
    controllers: Mapping[str, ControllerCount] = field(default_factory=dict)
    requirements: tuple[RequirementVerdict, ...] = ()  # that bind
    requirements_shown: tuple[RequirementVerdict, ...] = ()
    requirement_sets: tuple[RequirementSet, ...] = ()  # in their order, if there were several
    versions: Mapping[str, str] = field(default_factory=dict)
    compiler: str | None = None
    commit: str | None = None
    machine: Mapping[str, str | int] = field(default_factory=dict)
    command: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)  # SHA-256 by path
    warnings: tuple[str, ...] = ()
    repeatable: Repeatability | None = None  # of a user's simulator
    not_made: tuple[str, ...] = ()
    shard: tuple[int, int] | None = None  # part i of n
    merged_from: tuple[str, ...] | None = None  # digests
    pooled: tuple[Pooled, ...] | None = None
    file_runs: int | None = None  # flights at each point that the campaign file asks for, if more
    stopped_at: int | None = None  # flights of a campaign that stops when proven
    search: Mapping[str, Any] | None = None  # what a search was asked for
    result: Mapping[str, Any] | None = None  # and what it found
    files: Mapping[str, str] = field(default_factory=dict)  # SHA-256 by path
    flown_by: tuple[FlownBy, ...] = ()
    # Of a user's simulator by system: how often "surplus", "repeated" and "restarts" occurred.
    simulator_events: Mapping[str, Mapping[str, int]] | None = None

    @property
    def complete(self) -> bool:
        """Whether everything was flown."""
        return self.state == COMPLETE

    def as_entries(self) -> dict[str, Any]:
        """As JSON holds it."""
        content: dict[str, Any] = _FILE.dump_python(self, exclude_none=True)
        return {"format": FORMAT} | content


_FILE = TypeAdapter(Manifest)


def manifest_schema() -> dict[str, Any]:
    """The JSON Schema of `manifest.json`."""
    return _FILE.json_schema()


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write it whole, with the folder's format number and its own hash."""
    content = manifest.as_entries()
    write_text(path, json.dumps(content | {_HASH: _hash(content)}, indent=2) + "\n")


def read_manifest(path: Path) -> Manifest:
    """Read it. Raises InputError where there is none, one of another format, or one that is not as it was written."""
    if not path.is_file():
        raise InputError(path, "no such file", "the folder of a campaign")
    try:
        manifest = json.loads(path.read_bytes())
    except ValueError as error:
        raise InputError(path, f"a damaged manifest ({error})", _WISH) from None
    held = manifest.get("format") if isinstance(manifest, dict) else None
    if held != FORMAT:
        found = "a folder without a format number" if held is None else f"a folder of format {held}"
        raise InputError(
            path, found, f"format {FORMAT}: the version that wrote it, or the campaign anew"
        )
    if manifest.pop(_HASH, None) != _hash(manifest):
        raise InputError(path, "a damaged manifest (its entries have another hash)", _WISH)
    try:
        return _FILE.validate_python(manifest)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            path, f"{'.'.join(map(str, first['loc']))}: {first['msg']}", _WISH
        ) from None


def _hash(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def note_flyers(
    entries: Iterable[FlownBy], flyers: tuple[Flyer, ...], controller: str, first: int, stop: int
) -> tuple[FlownBy, ...]:
    """The entries with the flights ``first`` .. ``stop - 1`` as theirs, and no longer anybody else's."""
    kept = []
    for entry in entries:
        ranges = entry.blocks.get(controller, ())
        others = [(a, min(b, first)) for a, b in ranges if a < first] + [
            (max(a, stop), b) for a, b in ranges if b > stop
        ]
        kept.append(replace(entry, blocks={**entry.blocks, controller: tuple(others)}))
    theirs = [FlownBy(*flyer[:5], blocks={controller: ((first, stop),)}) for flyer in flyers]
    return tuple(entry for entry in join_flyers([*kept, *theirs]) if any(entry.blocks.values()))


def add_events(
    parts: Iterable[Mapping[str, Mapping[str, int]] | None],
) -> dict[str, dict[str, int]] | None:
    """Return the sums of simulators' events by system; None without any."""
    sums = defaultdict[str, Counter[str]](Counter)
    for part in parts:
        for name, events in (part or {}).items():
            sums[name].update(events)
    return {name: dict(events) for name, events in sums.items()} or None


def shift_flyers(entries: Iterable[FlownBy], flights: int) -> list[FlownBy]:
    """The entries with so much higher numbers of flights."""
    return [
        replace(
            entry,
            blocks={
                name: tuple((a + flights, b + flights) for a, b in part)
                for name, part in entry.blocks.items()
            },
        )
        for entry in entries
    ]


def join_flyers(entries: Iterable[FlownBy]) -> tuple[FlownBy, ...]:
    """The entries of each process as one."""
    joined: dict[tuple[str, str, str, str, str], dict[str, Ranges]] = {}
    for entry in entries:
        blocks = joined.setdefault(
            (entry.code, entry.versions, entry.processor, entry.features, entry.host), {}
        )
        for controller, ranges in entry.blocks.items():
            blocks[controller] = _join((*blocks.get(controller, ()), *ranges))
    return tuple(FlownBy(*who, blocks=blocks) for who, blocks in joined.items())


def _join(ranges: Ranges) -> Ranges:
    """Ranges in order, those that touch as one."""
    joined: list[tuple[int, int]] = []
    for first, stop in sorted(ranges):
        if joined and first <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(stop, joined[-1][1])
        else:
            joined.append((first, stop))
    return tuple(joined)
