"""What is known of a user's simulator: whether it is repeatable, and why flights failed to run."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from abhv_mc.flight.repeatability import Repeatability
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Bullets, Cell, Item, Row, Section, Table, Text
from abhv_mc.topics.topic import Topic
from abhv_mc.topics.words import fixed

_SHOWN = 20  # reasons of a system
_NO_REASON = "no reason is stored"
_EVENTS = {
    "restarts": "process started anew after a crash, a time-out or an answer that is none",
    "surplus": "output that answers no request",
    "repeated": "flight computed again, as its answer could belong to another one",
}
_PREFIX = "inputs/simulator/"


@dataclass(frozen=True)
class FailureReason:
    """A reason why flights failed to run."""

    reason: str
    flights: int
    first: int  # number of the first of these flights


@dataclass(frozen=True)
class SimulatorFacts:
    """What is known of a user's simulator; nothing of the program's own."""

    repeatable: str | None
    events: Mapping[str, Mapping[str, int]]  # of its processes, how often, by system
    notes: tuple[str, ...]  # of its runs: surplus output, undeclared files, noise
    files: tuple[str, ...]  # that it consists of and reads
    reasons: Mapping[str, tuple[FailureReason, ...]]  # by system, the most frequent first


def compute_simulator(results: FlownCampaign) -> SimulatorFacts:
    """Return what the manifest and the flights say of the simulator."""
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


def _sentences(facts: SimulatorFacts, _names: Names) -> Sequence[str]:
    if facts.repeatable in (None, Repeatability.EXACT):
        return []
    return [Repeatability(facts.repeatable).sentence]


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
        columns = (names.campaign.kind.capitalize(), "Event", "How often")
        items.append(Table("Events of its processes", columns, (rows,), numbers=False))
    if facts.notes:
        items.append(Bullets(tuple(f"{note[:1].upper()}{note[1:]}." for note in facts.notes)))
    if facts.files:
        items.append(
            Text(f"It consists of these files, whose hashes are stored: {', '.join(facts.files)}.")
        )
    if facts.reasons:
        groups = tuple(
            tuple(_row(names.label(name), each) for each in found[:_SHOWN])
            for name, found in facts.reasons.items()
        )
        heads = (names.campaign.kind.capitalize(), "Reason", "Flights", "First of them")
        title = "Flights that failed to run, by reason"
        items.append(Table(title, heads, groups, numbers=False))
    return Section("Simulator", tuple(items)) if items else None


def _row(label: str, found: FailureReason) -> Row:
    return (
        Cell(label, head=True),
        Cell(found.reason),
        Cell(fixed(found.flights, 0)),
        Cell(str(found.first)),
    )


SIMULATOR = Topic("simulator", SimulatorFacts, compute_simulator, _section, _sentences)
