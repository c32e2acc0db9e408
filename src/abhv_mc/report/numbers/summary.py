"""Summary of a campaign as labelled records, stored numbers, and statistical confidence."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from abhv_mc.flights.metrics import GAIN_MARGIN, PHASE_MARGIN
from abhv_mc.folder.manifest import Manifest, hash_entries
from abhv_mc.folder.merge import suggest_merge
from abhv_mc.io.messages import grouped_digits
from abhv_mc.report.numbers.next_step import find_next_step
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import label_status
from abhv_mc.statistics.winner import RISK
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.model import make_standings
from abhv_mc.topics.drivers import DRIVERS, driver_text
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import ended_words
from abhv_mc.topics.formatting import count_of, percent, shown_value, significant, spoken_name
from abhv_mc.topics.margins import MARGINS, corners_unstable, least_margins, missing_margins
from abhv_mc.topics.metrics import METRICS
from abhv_mc.topics.topic import Entry, Models, Record, Records, make_records
from abhv_mc.topics.verdicts import VERDICTS

_LATER = label_status("PASS", set_later=True)
_DETAILED = 4  # largest number of controllers for which missed requirements are named


def summarize(models: Models) -> Records:
    """Return the summary of a campaign; DIR in its commands is the results folder."""
    known = f"{grouped_digits(models.results.changed_after)} flights known: "
    changes = tuple(Entry((), f"{known}{item}") for item in models.results.requirement_changes)
    next_step = ""
    if step := find_next_step(models):
        next_step = f"`{step.command}`: " * bool(step.command) + step.why
        next_step += f" ({step.assumption})" * bool(step.assumption)
    records = (
        *_answers(models),
        *_verdict_records(models),
        *_comparison_records(models),
        Record("Early terminations", _grouped(_early_terminations(models))),
        Record("Margins", _grouped(_least_margins(models, only_poor=True))),
        Record("Changed after results", changes),
        Record("Risk", tuple(_risk_entries(models))),
        Record("Missing", tuple(_missing_entries(models))),
        Record("Next", (Entry((), next_step),) if step else ()),
    )
    labels = list(_labels(models).values())

    def shorten(entry: Entry) -> Entry:
        """Return an entry on most of many controllers with the names of exceptions instead."""
        exceptions = [label for label in labels if label not in entry.names]
        if len(entry.names) <= max(_DETAILED, len(exceptions)):
            return entry
        names = f"all but {', '.join(exceptions)}" if exceptions else "all"
        return Entry((names,), entry.text)

    return Records(
        tuple(Record(x.label, tuple(map(shorten, x.entries))) for x in records if x.entries)
    )


def parse_summary(entry: Any) -> Records:
    """Return the summary stored as `summary` in a `report.json`."""
    return TypeAdapter(Records).validate_python(entry)


def read_summary(folder: Path, manifest: Manifest) -> Records | None:
    """Read the summary from a folder's `report.json`; None if missing or outdated."""
    content = read_current_numbers(folder, manifest)
    return parse_summary(content["summary"]) if content else None


def _labels(models: Models) -> Mapping[str, str]:
    """Return the labels of the controllers, sorted by name."""
    return dict(sorted(models.names.controllers.items()))


def _grouped(texts: Mapping[str, str]) -> tuple[Entry, ...]:
    """Return one entry for all labels with the same text."""
    labels: dict[str, list[str]] = {}
    for label, text in texts.items():
        labels.setdefault(text, []).append(label)
    return tuple(Entry(tuple(equal), text) for text, equal in labels.items())


def _answers(models: Models) -> Iterator[Record]:
    """Yield the record that answers a question on drivers, margins or the worst flight."""
    asks = models.results.campaign.model.asks
    if asks == "drivers":
        drivers = models[DRIVERS].controllers
        texts = {
            label: driver_text(drivers[name], models.names)
            for name, label in _labels(models).items()
            if name in drivers
        }
        yield Record("Drivers", _grouped(texts))
    elif asks == "margins":
        yield Record("Least margins", _grouped(_least_margins(models, only_poor=False)))
    elif asks == "worst":
        labels = _labels(models).items()
        yield Record("Worst flight", tuple(_worst(models, name, label) for name, label in labels))


def _worst(models: Models, name: str, label: str) -> Entry:
    """Return a controller's worst flight with its metric and its largest dispersions."""
    names, worst = models.names, models[FLIGHTS].worst[name][0]
    text = ended_words(worst.outcome, worst.missed, len(names.requirements))
    if worst.by is not None:
        record = names.metrics[worst.by]
        text = f"{record.phrase} {record.with_unit(significant(worst.metrics[worst.by]))}"
    dispersions = ", ".join(
        f"{spoken_name(item.parameter)} "
        f"{shown_value(item.parameter, item.value, names.campaign.parameters)}"
        for item in worst.largest
    )
    return Entry((label,), f"flight {worst.flight}, {text} ({dispersions})")


def _verdict_records(models: Models) -> Iterator[Record]:
    verdicts, labels = models[VERDICTS], _labels(models)
    if not verdicts.requirements:
        yield Record("No requirements")
        return
    meeting: dict[int, list[str]] = {}
    shortfalls: dict[str, dict[str, str]] = {
        status: {} for status in ("FAIL", "NOT SHOWN", "ESTIMATE", _LATER)
    }
    for name, label in labels.items():
        own = verdicts.verdicts_of(name)
        if {verdict.label for _, verdict in own} == {"PASS"}:
            meeting.setdefault(len(own), []).append(label)
        for status, texts in shortfalls.items():
            listed = [
                (item, verdict)
                for item, verdict in own
                if status in (verdict.label, verdict.status)
            ]
            if not listed:
                continue
            item, worst = max(
                listed,
                key=lambda entry: (
                    entry[1].failures / (entry[1].flights * (1.0 - entry[1].probability))
                ),
            )
            text = count_of(len(listed), len(own))
            if len(labels) <= _DETAILED:
                failures = count_of(worst.failures, worst.flights)
                text += f", {models.names.metrics[item.metric].phrase} {failures}"
            texts[label] = text
    needed = [
        flights_to_pass(verdict.failures, verdict.probability, verdict.consumer_risk)
        for _, _, verdict in verdicts.binding
        if verdict and verdict.status == "NOT SHOWN"
    ]
    for number, controllers in sorted(meeting.items()):
        yield Record(f"Meets all {number} requirements", (Entry(tuple(controllers)),))
    yield Record("Misses", _grouped(shortfalls["FAIL"]))
    yield Record("Not shown", _grouped(shortfalls["NOT SHOWN"]))
    yield Record(_LATER, _grouped(shortfalls[_LATER]))
    if estimates := _grouped(shortfalls["ESTIMATE"]):
        reason = (Entry((), models.names.campaign.dependence),)
        yield Record("Estimates, no verdicts", (*estimates, *reason))
    yield Record("Flights needed", (Entry((), grouped_digits(max(needed))),) if needed else ())


def _comparison_records(models: Models) -> Iterator[Record]:
    """Yield the leading metrics in which a controller is better, and those without a winner."""
    comparison, names = models[COMPARISON], models.names
    selected = sorted(names.campaign.compared or names.controllers)
    pairs = [pair for pair in comparison.pairs.values() if {pair.a, pair.b} <= set(selected)]
    if not pairs:
        return
    if not names.campaign.judged:
        yield Record("No comparison", (Entry((), names.campaign.dependence),))
        return
    better: dict[str, list[str]] = {}
    not_beaten: dict[tuple[str, ...], list[str]] = {}
    for metric, standing in make_standings(pairs, selected).items():
        if metric not in names.asked:
            continue
        phrase = names.metrics[metric].phrase
        if standing.winner:
            detail = _advantage(models, metric, standing.winner, selected)
            better.setdefault(standing.winner, []).append(phrase + detail)
        else:
            not_beaten.setdefault(standing.not_beaten, []).append(phrase)
    winners = (Entry((names.label(x),), ", ".join(better[x])) for x in sorted(better))
    yield Record("Better in", tuple(winners))
    entries = []
    for controllers, phrases in sorted(not_beaten.items()):
        text = ", ".join(phrases)
        if len(controllers) == len(selected):
            entries.append(Entry((), f"no difference shown: {text}"))
        elif controllers:
            entries.append(Entry(tuple(map(names.label, controllers)), text))
        else:
            cycle = ", ".join(map(names.label, selected))
            entries.append(Entry((), f"no order: {cycle} ({text})"))
    yield Record("Not beaten", tuple(entries))


def _advantage(models: Models, metric: str, winner: str, selected: Sequence[str]) -> str:
    """Return the medians of the winner and its nearest rival, their paired difference, and wins.

    The text is empty without requirements and for many controllers, which have the table.
    """
    names, comparison = models.names, models[COMPARISON]
    if not names.requirements or len(names.controllers) > _DETAILED:
        return ""
    medians = {
        name: models[METRICS].table[metric].controllers[name].quantiles["q50"].value
        for name in selected
    }
    rival = min(
        (name for name in selected if name != winner),
        key=lambda name: abs(medians[name] - medians[winner]),
    )
    pair = comparison.pairs[" - ".join(sorted((winner, rival)))]
    entry = pair.metrics[metric]
    wins, sign = (entry.a_better, 1.0) if pair.a == winner else (entry.b_better, -1.0)
    unit = names.metrics[metric].with_unit
    values = f"{unit(significant(medians[winner]))}; {names.label(rival)} "
    values += f"{unit(significant(medians[rival]))}; paired "
    values += unit(significant(sign * entry.median_difference.value))
    return f" ({values}; on {percent(wins / pair.pairs, 2)} of flights)"


def _early_terminations(models: Models) -> dict[str, str]:
    """Return the early terminations of each controller that has any, by label."""
    counts, texts = models[FLIGHTS].counts, {}
    for name, label in _labels(models).items():
        if counts[name].failed:
            fewer = [
                models.names.label(pair.b if pair.a == name else pair.a)
                for pair in models[COMPARISON].pairs.values()
                if pair.losing == name
            ]
            text = count_of(counts[name].failed, counts[name].flown)
            texts[label] = text + (f", more than {', '.join(fewer)}" if fewer else "")
    return texts


def _least_margins(models: Models, *, only_poor: bool) -> dict[str, str]:
    """Return the least nominal margins, or only those below customary values, by label."""
    texts = {}
    customary = f"customary {GAIN_MARGIN.customary:g} dB, {PHASE_MARGIN.customary:g} deg"
    for name, label in _labels(models).items():
        least = least_margins(models[MARGINS], name)
        corners, steady = corners_unstable(models[MARGINS], name)
        if least is None or (only_poor and least.stable and not (least.little or corners)):
            continue
        margins = ", ".join(filter(None, least.words)) or "no limit"
        texts[label] = f"{margins} ({customary})" if least.stable else "unstable"
        if least.stable and corners:
            texts[label] += f", unstable at {count_of(corners, steady)} corners"
    return texts


def _risk_entries(models: Models) -> Iterator[Entry]:
    """Yield the consumer's risk of a PASS and the number of PASS verdicts that hold jointly."""
    joint = models[VERDICTS].held_together
    passed = joint.stand + len(joint.dropped) if joint else 0
    if joint and passed:
        jointly = count_of(joint.stand, passed)
        yield Entry((), f"{_consumer_risk(models)} for each PASS; {jointly} PASS hold jointly")


def _missing_entries(models: Models) -> Iterator[Entry]:
    """Yield the flights that were not yet computed, failed to run or are absent."""
    flights, manifest = models[FLIGHTS], models.results.manifest
    planned, runs = manifest.file_runs or 0, models.results.campaign.runs_at_point
    if manifest.state != "complete":
        done = count_of(manifest.runs_done, manifest.runs_planned)
        yield Entry((), f"{done} flights computed, {manifest.state}")
    elif planned > runs:
        yield Entry((), f"{count_of(runs, planned)} flights computed")
    for name, count in sorted(flights.left_out.items()):
        yield Entry((name,), f"{count_of(count, count)} failed to run")
    for name, label in _labels(models).items():
        counts = flights.counts[name]
        if counts.not_computed:
            total = counts.not_computed + counts.flown
            yield Entry((label,), f"{count_of(counts.not_computed, total)} failed to run")


def warnings_of(models: Models) -> list[str]:
    """Return the warnings from the run of a campaign and from its topics."""
    manifest = models.results.manifest
    warnings = (*manifest.warnings, *manifest.not_made)
    return [*warnings, *missing_margins(models[MARGINS], models.names)]


def confidence_records(models: Models, warnings: Sequence[str] = ()) -> Records:
    """Return the basis of intervals and verdicts, with ``warnings`` as notes."""
    campaign, unknowns = models.results.campaign, models.results.campaign.unknowns
    numbers = sorted({counts.flown for counts in models[FLIGHTS].counts.values()})
    texts = [("Flights", f"{', '.join(map(grouped_digits, numbers))} of each {campaign.kind}")]
    if unknowns.names:
        count = len(unknowns.points)
        judged = count if unknowns.shared is None else unknowns.shared
        text = f"{grouped_digits(campaign.runs_at_point)} flights at each of {count} values; "
        text += f"each verdict covers {count_of(judged, count)} values"
        text += ", and those with the most failures of its requirement" * (judged < count)
        texts += [("Unknowns", text), ("Unknowns", _BETWEEN)]
    if campaign.independent:
        risk = percent(RISK, 2)
        text = f"{risk} for any wrong winner, {risk} for any wrong order of early terminations"
        texts += [
            ("Intervals", "95 % confidence at a single check"),
            ("Risk of the comparison", text * campaign.judged),
        ]
    else:
        texts.append(("Estimates", campaign.dependence))
    if models[VERDICTS].held_together:
        text = "for a system that just misses a requirement, at any number of checks"
        texts.append(("Risk of a PASS", f"{_consumer_risk(models)} {text}"))
    if campaign.model.stop:
        text = f"every verdict PASS or FAIL, or {grouped_digits(campaign.runs)} flights"
        texts.append(("Stops at", text))
    siblings, command = suggest_merge(models.results.folder, models.results.manifest)
    if siblings:
        texts += [("Other seeds", siblings), ("Other seeds", f"`{command}`")]
    texts += [("Note", note) for note in dict.fromkeys((*warnings_of(models), *warnings))]
    return make_records(texts)


def _consumer_risk(models: Models) -> str:
    """Return the largest consumer's risk of the requirements."""
    requirements = models[VERDICTS].requirements
    return percent(max(entry.asked.consumer_risk for entry in requirements), 2)


_BETWEEN = (
    "quantiles, envelopes and differences combine all values; a winner wins at every value; "
    "nothing is proven for values in between"
)


HASH = "hash"  # entry of `report.json` with the hash of all other entries


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
