"""What a board has to know of each controller's flights beside its errors: saturation, limit cycles, early ends."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.results import Results
from abhv_mc.plant.parameters import DISTURBANCES
from abhv_mc.topics.failed_flights import EARLY
from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.failures.model import Failures
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.sentences import margin_words
from abhv_mc.topics.topic import Models
from abhv_mc.topics.words import count_of, joined, percent
from abhv_mc.vehicle.sensing import IN_WIND

_CYCLES = 5.0  # deg, from side to side: ripple from which a flight is said to cycle
_LIMITS = {"saturates": 0.0, "leaves_tables": 0.0, "cycles": _CYCLES}  # of a record's finding: what is more is said


def finding_numbers(results: Results) -> dict[str, Any]:
    """Flights [count] of each controller whose surfaces saturate, that cycle by channel, that leave the tables."""
    disturbed = not set(DISTURBANCES).isdisjoint(results.samples)
    return {name: _of(results.flights[name]) | {"disturbed": disturbed} for name in results.controllers}


def left_out(results: Results) -> dict[str, int]:
    """Flights of each controller that a report has nothing of, because the machine computed none of them."""
    listed = (results.manifest.get("controllers") or {}).items()
    lost = {name: facts.get("outcomes", {}).get("failed_to_run", 0) for name, facts in listed}
    return {name: count for name, count in lost.items() if count and name not in results.controllers}


def _of(flights: ControllerFlights) -> dict[str, Any]:
    records = {name: record for name, record in flights.records.items() if record.finding and name in flights.metrics}

    def above(finding: str) -> dict[str, int]:
        return {
            record.label.removesuffix(" ripple").lower().replace(" ", "_"): int(
                np.sum(flights.metrics[name] > _LIMITS[finding])
            )
            for name, record in records.items()
            if record.finding == finding
        }

    return {
        "flown": int(flights.flight.size),
        "saturated": max(above("saturates").values(), default=None),
        "outside_tables": max(above("leaves_tables").values(), default=None),
        "cycling": above("cycles"),
        "ripple_deg": _CYCLES,
    }


def finding_sentences(models: Models, numbers: Mapping[str, Any]) -> Iterator[str]:
    """One of each controller: flights not computed, its loops, flights that cycle or end early, saturated surfaces,
    tables left."""
    yield from (f"{words[:1].upper()}{words[1:]}." for words in numbers["warnings"] if words.startswith(IN_WIND))
    for name, count in numbers["left_out"].items():
        yield f"{name}: the machine could compute none of {count} flights, so it is not in this report; it met nothing."
    margins = models[MARGINS]
    for name, part in numbers["findings"].items():
        absent = numbers["flights"][name]["not_computed"]
        known = (
            _in("the machine could not compute", absent, part["flown"] + absent),
            margin_words(margins, name), _cycles(part), _early(models[FAILURES], numbers, name),
            _in("surfaces reach a limit of deflection or rate in", part["saturated"], part["flown"]),
            _in("the vehicle's tables are left in", part["outside_tables"], part["flown"]),
        )  # fmt: skip
        words = [text for text in known if text]
        if words:
            yield f"{numbers['campaign']['labels'][name]}: {'; '.join(words)}."


def _in(words: str, count: int | None, flown: int) -> str:
    return f"{words} {count_of(count, flown, 'flights')}" if count else ""


def _cycles(part: Mapping[str, Any]) -> str:
    found = [
        f"{channel.replace('_', ' ')} in {count_of(count, part['flown'], 'flights')}"
        for channel, count in part["cycling"].items()
        if count
    ]
    what = "swings, in gusts, turbulence or noise," if part.get("disturbed") else "limit cycle"
    return f"{what} (> {part['ripple_deg']:g} deg) in {joined(found)}" if found else ""


def _early(failures: Failures, numbers: Mapping[str, Any], name: str) -> str:
    """'3 of 40 flights ended early, 70 % of them where lift > +8 % (and 3 % of the others)'."""
    counts = numbers["flights"][name]
    if not counts["failed"]:
        return ""
    text = f"{count_of(counts['failed'], counts['flown'], 'flights')} ended early"
    rules = next((kind.rules for kind in failures.controllers.get(name, ()) if kind.kind == EARLY), ())
    if not rules:
        return text
    first = rules[0]
    inside, others = first.failures_inside / first.failures, first.others_inside / first.others
    return f"{text}, {percent(inside, 2)} of them where {first.where} (and {percent(others, 2)} of the others)"
