"""Failure analysis: the failure map, and failure rules on one or two dispersed parameters."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.analysis.failure_map import ControllerFailures, Dispersed, read_map
from abhv_mc.array_types import Floats, Mask
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.failure_rules import (
    FALSE_DISCOVERY_RATE,
    FEWEST_FAILURES,
    Rule,
    bin_inputs,
    condition_mask,
    find_rules,
)
from abhv_mc.topics.formatting import count_of, percent, shown_value, spoken_name
from abhv_mc.topics.missed_requirements import failure_kinds, requirement_words
from abhv_mc.topics.topic import Cell, Heading, Names, Row, Section, Table, Text, Topic, grouped


@dataclass(frozen=True, kw_only=True)
class FailureRule(Rule):
    """Region of the dispersed parameters in which the failure rate is increased."""

    where: str  # description of the region


@dataclass(frozen=True)
class FailureKind:
    """Failure mode with the rules that describe when it occurs."""

    kind: str
    flights: int
    failures: int
    rules: tuple[FailureRule, ...]


@dataclass(frozen=True)
class Failures:
    """Failure modes of each controller; empty without dispersions."""

    controllers: Mapping[str, tuple[FailureKind, ...]]
    # failure map of each controller; None if not computed from these flights
    map: Mapping[str, ControllerFailures] | None = None
    false_discovery_rate: float = FALSE_DISCOVERY_RATE
    fewest_failures: int = FEWEST_FAILURES  # minimum number of failures needed for a rule


def compute_failures(results: FlownCampaign) -> Failures:
    """Return the rules for every failure mode that occurred."""
    names = results.controllers if results.dispersed else ()
    failure_map = read_map(results.folder, results.manifest.digest)
    return Failures(
        {name: _kinds(results, name) for name in names},
        failure_map.controllers if failure_map else None,
    )


def _kinds(results: FlownCampaign, controller: str) -> tuple[FailureKind, ...]:
    kinds, flown = failure_kinds(results, controller), results.flights[controller].flight
    if not kinds:
        return ()
    inputs = bin_inputs(
        results.dispersed, lambda name: np.asarray(results.samples[name][flown], dtype=np.float64)
    )
    return tuple(
        FailureKind(
            kind,
            failed.size,
            failed.sum(),
            tuple(
                FailureRule(**vars(rule), where=_region(rule, results, failed, inputs.column))
                for rule in find_rules(inputs, failed)
            ),
        )
        for kind, failed in kinds
    )


def _region(
    rule: Rule, results: FlownCampaign, failed: Mask, column: Callable[[str], Floats]
) -> str:
    """Describe the conditions of a rule.

    Examples are 'wind north above 25 m/s and lift at most -5 %' and, for two thresholds, 'density
    at most -7 % or above +7 %'. The difference of two inputs is described with their medians over
    the failures on one side: 'density minus drag, each relative to its range: low (such as density
    -7 %, drag +9 %)'.
    """

    def shown(name: str, value: float) -> str:
        return shown_value(name, value, results.campaign.parameters)

    first = rule.conditions[0]
    if first.minus is not None:
        side = failed & condition_mask(first, column)
        pair = first.parameter, first.minus
        medians = [f"{spoken_name(x)} {shown(x, float(np.median(column(x)[side])))}" for x in pair]
        level = "high or low" if rule.either else "high" if first.above else "low"
        difference = " minus ".join(map(spoken_name, pair))
        return f"{difference}, each relative to its range: {level} (such as {', '.join(medians)})"
    sides = [
        f"{'above' if c.above else 'at most'} {shown(c.parameter, c.threshold)}"
        for c in rule.conditions
    ]
    if rule.either:
        return f"{spoken_name(first.parameter)} {' or '.join(sides)}"
    names = (spoken_name(c.parameter) for c in rule.conditions)
    return " and ".join(map(" ".join, zip(names, sides, strict=True)))


TITLE = "Failure analysis"
_LISTED = 2  # maximum number of rules listed per failure mode


def failure_section(failures: Failures, names: Names) -> Section:
    """Return the section with the failure map, or with rules if there is no map."""
    if failures.map is None:
        return _rules_section(failures, names)
    commands = ", ".join(
        f"`abhv-mc replay {names.folder} --controller {name} --flight NUMBER`"
        for name in failures.map
    )
    text = (
        "The table lists the smallest sets of at most three dispersions with which a flight still "
        "fails if all other dispersions are nominal. A flight with several such sets is counted "
        "with the set that explains most flights. Values are given as median (smallest to "
        f"largest). Re-run a flight with {commands}"
    )
    heading = Heading("Dispersions that cause the failures")
    return Section(TITLE, (heading, Text(text), map_table(failures.map, names)))


def map_table(failure_maps: Mapping[str, ControllerFailures], names: Names) -> Table:
    """Return a table of each controller's failure groups and unexplained failures."""
    heads = (names.kind, "Failed", "Dispersions", "Values", "Flights",
             "Example")  # fmt: skip
    groups = tuple(
        grouped(list(_map_rows(name, failure_map, names)), Cell(names.label(name), head=True))
        for name, failure_map in failure_maps.items()
        if failure_map.failed
    )
    return Table("Map of failures", heads, groups, numbers=False)


def _map_rows(controller: str, failure_map: ControllerFailures, names: Names) -> Iterator[Row]:
    """Yield a row for each failure group, and the counts of failures outside all groups."""
    total = failure_map.looked_at
    required = {
        f"missed {item.metric} {item.limits}": f"missed: {requirement_words(item, names.metrics)}"
        for item in names.requirements
    }
    for group in failure_map.groups:
        sides = [
            f"{spoken_name(dispersion.parameter)} {'high' if dispersion.high else 'low'}"
            for dispersion in group.dispersions
        ]
        count = len(group.flights)
        yield (
            Cell(required.get(group.failure, group.failure)),
            Cell(", ".join(sides), head=True),
            Cell("; ".join(_typical(dispersion, names) for dispersion in group.dispersions)),
            Cell(f"{count_of(count, total)} ({percent(count / total, 2)})"),
            Cell(str(group.flights[0]), flight=(controller, group.flights[0])),
        )
    counts = {
        "not explained by any tested set": count_of(len(failure_map.unexplained), total),
        "failed without dispersions": str(len(failure_map.nominal) or ""),
        "analysed": count_of(total, failure_map.failed) if failure_map.failed > total else "",
    }
    for label, text in counts.items():
        if text:
            yield (Cell(""), Cell(label, head=True), Cell(""), Cell(text), Cell(""))


def _typical(dispersion: Dispersed, names: Names) -> str:
    """Return a dispersion's typical value and range, such as '-35 % (-40 % to -31 %)'."""
    values = dispersion.least, dispersion.median, dispersion.largest
    low, middle, high = (
        shown_value(dispersion.parameter, value, names.campaign.parameters) for value in values
    )
    return f"{middle} ({low} to {high})" if low != high else middle


def _rules_section(failures: Failures, names: Names) -> Section:
    """Return the section on failure modes and their rules, most frequent mode first."""
    ranked = sorted(
        failures.controllers.items(), key=lambda entry: -sum(kind.failures for kind in entry[1])
    )
    groups = tuple(
        grouped(
            [row for kind in kinds for row in _rule_rows(kind, failures.fewest_failures)],
            Cell(names.label(name), head=True),
        )
        for name, kinds in ranked
        if kinds
    )
    if not groups:
        return Section(TITLE, (Text("No flight failed."),))
    heads = (names.kind, "Failure", "Failed", "Region", "Of failures",
             "Of other flights")  # fmt: skip
    caption = (
        "Regions in which failures are more frequent, with one or two parameters and thresholds "
        "at deciles of the samples, significant in an exact test at a false-discovery rate of "
        f"{percent(failures.false_discovery_rate, 1)}"
    )
    command = (
        f"`abhv-mc explain {names.folder} --all` finds the smallest sets of dispersions with which "
        "the flights still fail; this page then shows them."
    )
    table = Table("Failure modes", heads, groups, caption, numbers=False)
    return Section(TITLE, (table, *[Text(command)] * names.campaign.can_rerun))


def _rule_rows(kind: FailureKind, fewest: int) -> tuple[Row, ...]:
    few = f" (fewer than {fewest} flights)" if kind.failures < fewest else ""
    rows = [
        (
            Cell(rule.where),
            Cell(percent(rule.failures_inside / rule.failures, 2)),
            Cell(percent(rule.others_inside / rule.others, 2)),
        )
        for rule in kind.rules[:_LISTED]
    ] or [(Cell(f"no significant rule{few}"), Cell(""), Cell(""))]
    return grouped(rows, Cell(kind.kind), Cell(count_of(kind.failures, kind.flights)))


FAILURES = Topic("failures", Failures, compute_failures, failure_section)
