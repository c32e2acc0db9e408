"""Failure analysis: the failure map, and failure rules on one or two dispersed parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from abhv_mc.analysis.failure_map import ControllerFailures, Dispersed, read_map
from abhv_mc.array_types import Floats, Mask
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.failure_rules import (
    FALSE_DISCOVERY_RATE,
    FEWEST_FAILURES,
    Condition,
    Rule,
    bin_inputs,
    find_rules,
    rule_mask,
)
from abhv_mc.topics.formatting import count_of, percent, shown_value, spoken_name
from abhv_mc.topics.missed_requirements import failure_kinds, requirement_words
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Bullets, Cell, Heading, Item, Row, Section, Table, Text
from abhv_mc.topics.topic import Topic


@dataclass(frozen=True, kw_only=True)
class FailureRule(Rule[str]):
    """Region of the dispersed parameters in which the failure rate is increased."""

    where: str  # description of the region
    rule: str  # description of the region with the shares of failed and other flights in it


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
    map: Mapping[str, ControllerFailures] | None = (
        None  # failure map of each controller; None if not computed from these flights
    )
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
    names, flown = list(results.dispersed), results.flights[controller].flight
    kinds, parameters = failure_kinds(results, controller), results.campaign.parameters
    if not kinds:
        return ()

    def column(index: int) -> Floats:
        return np.asarray(results.samples[names[index]][flown], dtype=np.float64)

    binned = bin_inputs(results.samples[name][flown] for name in names)
    return tuple(
        FailureKind(
            kind,
            int(failed.size),
            int(failed.sum()),
            tuple(
                _rule(rule, names, parameters, failed, column)
                for rule in find_rules(binned, failed, column)
            )
            if binned
            else (),
        )
        for kind, failed in kinds
    )


def _rule(
    rule: Rule[int],
    names: list[str],
    parameters: Parameters,
    failed: Mask,
    column: Callable[[int], Floats],
) -> FailureRule:
    inside, outside = rule.failures_inside / rule.failures, rule.others_inside / rule.others
    if rule.conditions[0].minus is None:
        description = _parameter_words(rule, names, parameters)
    else:
        description = _difference_words(rule, names, parameters, failed, column)
    conditions = tuple(
        Condition(
            names[c.parameter], c.above, c.threshold, None if c.minus is None else names[c.minus]
        )
        for c in rule.conditions
    )
    text = f"{percent(inside, 2)} of failures ({percent(outside, 2)} of other flights):"
    named = {**vars(rule), "conditions": conditions}
    return FailureRule(**named, where=description, rule=f"{text} {description}")


def _parameter_words(rule: Rule[int], names: list[str], parameters: Parameters) -> str:
    """Describe the conditions of a rule.

    Examples are 'wind north above 25 m/s and lift at most -5 %' and, for two thresholds, 'density
    at most -7 % or above +7 %'.
    """

    def side(condition: Condition[int]) -> str:
        value = shown_value(names[condition.parameter], condition.threshold, parameters)
        return f"{'above' if condition.above else 'at most'} {value}"

    first, *further = rule.conditions
    description = f"{spoken_name(names[first.parameter])} {side(first)}"
    for condition in further:
        word = "or" if rule.either else f"and {spoken_name(names[condition.parameter])}"
        description += f" {word} {side(condition)}"
    return description


def _difference_words(
    rule: Rule[int],
    names: list[str],
    parameters: Parameters,
    failed: Mask,
    column: Callable[[int], Floats],
) -> str:
    """Describe how far apart two inputs are, with their medians over the failures on one side.

    An example is 'density minus drag, each relative to its range: low (such as density -7 %, drag
    +9 %)'.
    """
    condition = rule.conditions[0]
    inputs = condition.parameter, condition.minus or 0
    side = failed & rule_mask(replace(rule, conditions=(condition,)), column)
    texts = [
        f"{spoken_name(names[i])} "
        f"{shown_value(names[i], float(np.median(column(i)[side])), parameters)}"
        for i in inputs
        if side.any()
    ]
    difference = " minus ".join(spoken_name(names[i]) for i in inputs)
    level = "high or low" if rule.either else "high" if condition.above else "low"
    example = f" (such as {', '.join(texts)})" if texts else ""
    return f"{difference}, each relative to its range: {level}{example}"


TITLE = "Failure analysis"
_LISTED = 2  # maximum number of rules listed per failure mode


def failure_section(failures: Failures, names: Names) -> Section:
    """Return the section with the failure map, or with rules if there is no map."""
    if failures.map is None:
        return _rules_section(failures, names)
    text = Text(
        "The table lists the smallest sets of at most three dispersions with which a flight still "
        "fails if all other dispersions are nominal. A flight with several such sets is counted "
        "with the set that explains most flights. Values are given as median (smallest to "
        "largest). Re-run a flight with "
        + ", ".join(
            f"`abhv-mc replay {names.folder} --controller {name} --flight NUMBER`"
            for name in failures.map
        )
    )
    items = Heading("Dispersions that cause the failures"), text, map_table(failures.map, names)
    return Section(TITLE, items)


def map_table(failure_maps: Mapping[str, ControllerFailures], names: Names) -> Table:
    """Return a table of each controller's failure groups and unexplained failures."""
    heads = (
        names.campaign.kind.capitalize(),
        "Failed",
        "Dispersions",
        "Values",
        "Flights",
        "Example",
    )
    groups = tuple(
        _map_group(name, failure_map, names)
        for name, failure_map in failure_maps.items()
        if failure_map.failed
    )
    return Table("Map of failures", heads, groups, numbers=False)


def _map_group(controller: str, failure_map: ControllerFailures, names: Names) -> tuple[Row, ...]:
    label, total = names.label(controller), failure_map.looked_at
    required = {f"missed {item.metric} {item.limits}": item for item in names.requirements}
    rows: list[Row] = []
    for group in failure_map.groups:
        item = required.get(group.failure)
        requirement_text = requirement_words(item, names.metrics) if item else ""
        sides = [
            f"{spoken_name(dispersion.parameter)} {'high' if dispersion.high else 'low'}"
            for dispersion in group.dispersions
        ]
        flights = (
            f"{count_of(len(group.flights), total)} ({percent(len(group.flights) / total, 2)})"
        )
        cells = (
            Cell(
                f"missed {requirement_text[:1].lower()}{requirement_text[1:]}"
                if requirement_text
                else group.failure
            ),
            Cell(", ".join(sides), head=True),
            Cell("; ".join(_typical(dispersion, names) for dispersion in group.dispersions)),
            Cell(flights),
            Cell(str(group.flights[0]), flight=(controller, group.flights[0])),
        )
        rows.append(
            cells if rows else (Cell(label, rows=len(failure_map.groups), head=True), *cells)
        )
    return (*rows, (Cell(label, head=True), Cell(_rest(failure_map), columns=5)))


def _typical(dispersion: Dispersed, names: Names) -> str:
    """Return a dispersion's typical value and range, such as '-35 % (-40 % to -31 %)'."""
    values = dispersion.least, dispersion.median, dispersion.largest
    low, middle, high = (
        shown_value(dispersion.parameter, value, names.campaign.parameters) for value in values
    )
    return f"{middle} ({low} to {high})" if low != high else middle


def _rest(failure_map: ControllerFailures) -> str:
    """Return the counts of failures outside all groups."""
    total = failure_map.looked_at
    counts = {
        "not explained by any tested set": count_of(len(failure_map.unexplained), total),
        "failed without dispersions": str(len(failure_map.nominal) or ""),
        "analysed": count_of(total, failure_map.failed) if failure_map.failed > total else "",
    }
    return "; ".join(f"{label}: {count}" for label, count in counts.items() if count)


def _rules_section(failures: Failures, names: Names) -> Section:
    """Return the section on failure modes and their rules, most frequent mode first."""
    items: list[Item] = []
    ranked = sorted(
        failures.controllers.items(), key=lambda entry: -sum(kind.failures for kind in entry[1])
    )
    for name, kinds in ranked:
        if kinds:
            lines = tuple(_rule_line(kind, failures.fewest_failures) for kind in kinds)
            items += [Heading(names.label(name)), Bullets(lines)]
    if not items:
        return Section(TITLE, (Text("No flight failed."),))
    command = (
        f"`abhv-mc explain {names.folder} --all` finds the smallest sets of dispersions with which "
        "the flights still fail; this page then shows them."
    )
    rate = percent(failures.false_discovery_rate, 1)
    note = (
        "Each rule has one or two parameters with thresholds at deciles of the samples, and is "
        f"significant in an exact test at a false-discovery rate of {rate}"
    )
    return Section(
        TITLE, (*items, *([Text(command)] if names.campaign.can_rerun else []), Text(f"{note}."))
    )


def _rule_line(kind: FailureKind, fewest: int) -> str:
    rules = "; ".join(rule.rule for rule in kind.rules[:_LISTED]) or "no significant rule"
    few = f" (fewer than {fewest} flights)" if kind.failures < fewest else ""
    return f"{kind.kind}, {count_of(kind.failures, kind.flights)}: {rules}{few}"


FAILURES = Topic("failures", Failures, compute_failures, failure_section)
