"""Report topic: repeatability of a user's simulator, and why its flights failed to run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.formatting import fixed
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Bullets, Cell, Item, Row, Section, Table, Text
from abhv_mc.topics.topic import Topic

_SHOWN = 20  # maximum number of reasons listed per system
_NO_REASON = "no reason is stored"
_EVENTS = {
    "restarts": "process restarted after a crash, a time-out or an invalid answer",
    "surplus": "output without a request",
    "repeated": "flight re-run because its answer could belong to another flight",
}
_PREFIX = "inputs/simulator/"


@dataclass(frozen=True)
class FailureReason:
    """Reason why one or more flights failed to run."""

    reason: str
    flights: int
    first: int  # number of the first flight with this reason


@dataclass(frozen=True)
class SimulatorFacts:
    """Facts about a user's simulator; empty for the built-in simulator."""

    repeatable: str | None
    events: Mapping[str, Mapping[str, int]]  # counts of process events, by system and event
    notes: tuple[str, ...]  # notes on surplus output, undeclared files and the use of noise
    files: tuple[str, ...]  # files of the simulator
    # reasons for failing to run, by system, most frequent first
    reasons: Mapping[str, tuple[FailureReason, ...]]


def compute_simulator(results: FlownCampaign) -> SimulatorFacts:
    """Return the facts about a simulator that the manifest and the flights contain."""
    manifest, can = results.manifest, results.campaign.simulator.capabilities
    reasons = {}
    for name, flights in results.flights.items():
        counts = Counter(flights.reasons.values())
        first = dict[str, int]()
        for flight, reason in sorted(flights.reasons.items()):
            first.setdefault(reason, flight)
        if counts:
            reasons[name] = tuple(
                FailureReason(reason or _NO_REASON, count, first[reason])
                for reason, count in counts.most_common()
            )
    return SimulatorFacts(
        repeatable=manifest.repeatable,
        events=manifest.simulator_events or {},
        notes=manifest.warnings if can.can_rerun and not can.is_repeatable else (),
        files=tuple(
            path.removeprefix(_PREFIX) for path in manifest.inputs if path.startswith(_PREFIX)
        ),
        reasons=reasons,
    )


def _section(facts: SimulatorFacts, names: Names) -> Section | None:
    if names.campaign.simulator.capabilities.is_repeatable and not facts.reasons:
        return None
    items: list[Item] = []
    if facts.repeatable is not None:
        items.append(Text(Repeatability(facts.repeatable).sentence))
    if facts.events:
        rows = tuple(
            (
                Cell(names.label(name), head=True),
                Cell(_EVENTS.get(event, event)),
                Cell(fixed(count, 0)),
            )
            for name, events in facts.events.items()
            for event, count in events.items()
        )
        columns = (names.campaign.kind.capitalize(), "Event", "Count")
        items.append(Table("Events of the simulator's processes", columns, (rows,), numbers=False))
    if facts.notes:
        items.append(Bullets(tuple(f"{note[:1].upper()}{note[1:]}." for note in facts.notes)))
    if facts.files:
        items.append(
            Text(f"Files of the simulator, whose hashes are stored: {', '.join(facts.files)}")
        )
    if facts.reasons:
        groups = tuple(
            tuple(_row(names.label(name), reason) for reason in reasons[:_SHOWN])
            for name, reasons in facts.reasons.items()
        )
        heads = (names.campaign.kind.capitalize(), "Reason", "Flights", "First flight")
        title = "Flights that failed to run, by reason"
        items.append(Table(title, heads, groups, numbers=False))
    return Section("Simulator", tuple(items)) if items else None


def _row(label: str, reason: FailureReason) -> Row:
    return (
        Cell(label, head=True),
        Cell(reason.reason),
        Cell(fixed(reason.flights, 0)),
        Cell(str(reason.first)),
    )


SIMULATOR = Topic("simulator", SimulatorFacts, compute_simulator, _section)
