"""Why flights fail: the map of failures where it was made, and rules of one dispersed parameter or two.

`abhv-mc explain DIR --all` makes the map, which takes flights of the plant; the rules are mined from the table alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.analysis.failure_map import ControllerFailures, read_map
from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.plant.parameters import Parameters
from abhv_mc.statistics.failure_drivers import FALSE_DISCOVERY_RATE, FEWEST_FAILURES, bin_inputs, find_rules
from abhv_mc.statistics.failure_rules import Condition, Rule
from abhv_mc.topics.failed_flights import failure_kinds
from abhv_mc.topics.parameter_words import shown_value, spoken_name
from abhv_mc.topics.words import percent


@dataclass(frozen=True)
class FailureCondition:
    """A parameter above a threshold or not; or that parameter less another, each in its standard deviations."""

    parameter: str
    minus: str | None
    above: bool
    threshold: float


@dataclass(frozen=True)
class FailureRule:
    """A region that failures prefer."""

    where: str  # in words
    rule: str  # the same with its shares
    conditions: tuple[FailureCondition, ...]
    failures_inside: int
    failures: int
    others_inside: int
    others: int
    p_value: float
    q_value: float


@dataclass(frozen=True)
class FailureKind:
    """One way to fail, and where it happens."""

    kind: str
    flights: int
    failures: int
    rules: tuple[FailureRule, ...]


@dataclass(frozen=True)
class Failures:
    """The kinds of failure of each controller; none without dispersions."""

    controllers: Mapping[str, tuple[FailureKind, ...]]
    map: Mapping[str, ControllerFailures] | None = None  # by controller; None where it was not made of these flights
    false_discovery_rate: float = FALSE_DISCOVERY_RATE
    fewest_failures: int = FEWEST_FAILURES  # that tell anything


def compute_failures(results: FlownCampaign) -> Failures:
    """Rules for every kind of failure that occurred."""
    names = results.controllers if results.dispersed else ()
    found = read_map(results.folder, results.manifest.digest)
    return Failures({name: _kinds(results, name) for name in names}, found.controllers if found else None)


def _kinds(results: FlownCampaign, controller: str) -> tuple[FailureKind, ...]:
    names, flown = list(results.dispersed), results.flights[controller].flight
    kinds, known = failure_kinds(results, controller), results.campaign.parameters
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
            tuple(_rule(rule, names, known) for rule in find_rules(binned, failed, column)) if binned else (),
        )
        for kind, failed in kinds
    )


def _rule(rule: Rule, names: list[str], known: Parameters) -> FailureRule:
    words = (" or " if rule.either else " and ").join(_words(each, names, known) for each in rule.conditions)
    inside, outside = rule.failures_inside / rule.failures, rule.others_inside / rule.others
    return FailureRule(
        words,
        f"{words}: {percent(inside, 2)} of the failures, {percent(outside, 2)} of the rest",
        tuple(
            FailureCondition(names[c.input], None if c.minus is None else names[c.minus], c.above, c.threshold)
            for c in rule.conditions
        ),
        rule.failures_inside,
        rule.failures,
        rule.others_inside,
        rule.others,
        rule.p_value,
        rule.q_value,
    )


def _words(condition: Condition, names: list[str], known: Parameters) -> str:
    """'wind north > 25 m/s'; a difference in standard deviations."""
    name, sign = names[condition.input], ">" if condition.above else "\N{LESS-THAN OR EQUAL TO}"
    if condition.minus is None:
        return f"{spoken_name(name)} {sign} {shown_value(name, condition.threshold, known)}"
    other = spoken_name(names[condition.minus])
    return f"{spoken_name(name)} minus {other}, each in standard deviations, {sign} {condition.threshold:.2f}"
