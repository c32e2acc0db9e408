"""Report topic: repeatability of a user's simulator, and why its flights failed to run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.messages import grouped_digits
from abhv_mc.topics.topic import Item, Names, Section, Table, Topic, make_records, make_row

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
    events = tuple(
        make_row(names.label(name), _EVENTS.get(event, event), grouped_digits(count))
        for name, events in facts.events.items()
        for event, count in events.items()
    )
    reasons = tuple(
        tuple(
            make_row(names.label(name), item.reason, grouped_digits(item.flights), str(item.first))
            for item in listed[:_SHOWN]
        )
        for name, listed in facts.reasons.items()
    )
    tables = (
        Table("Events of the simulator's processes", (names.kind, "Event", "Count"), (events,),
              numbers=False),
        Table("Flights that failed to run, by reason",
              (names.kind, "Reason", "Flights", "First flight"), reasons, numbers=False),
    )  # fmt: skip
    repeatable = facts.repeatable
    records = make_records(
        [
            ("Repeatable", Repeatability(repeatable).sentence if repeatable else ""),
            *(("Note", note) for note in facts.notes),
            ("Files with stored hashes", ", ".join(facts.files)),
        ]
    )
    items: list[Item] = [records] if records.records else []
    items += [table for table in tables if any(table.groups)]
    return Section("Simulator", tuple(items)) if items else None


SIMULATOR = Topic("simulator", SimulatorFacts, compute_simulator, _section)
