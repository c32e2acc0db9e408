"""Each requirement on each controller: counts and verdict, what stands jointly, and the flights beside its limit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.binomial import jeffreys, success_lower_bound
from abhv_mc.statistics.estimates import spread
from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import Verdict, advice_words, tolerance_limit, verdict_words
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words
from abhv_mc.topics.words import significant

FAMILY_RISK = 0.10  # at which the report asks which PASSes would stand together
_SHARES = (5.0, 50.0, 95.0)  # percent of the flights


@dataclass(frozen=True, kw_only=True)
class ControllerVerdict(Verdict):
    """A verdict with what its flights stay within; the bounds are None for flights that are no independent draws."""

    words: str
    ended_early: int  # of the failures
    advice: str  # how many flights would show it, where it is not shown
    tolerance_limit: (
        float | None
    )  # what the required share of flights stays within; None where no number does
    room: (
        float | None
    )  # from there to the limit, a share of the limit; of two limits, of half their distance
    beyond_lost: bool  # whether that is so because too many flights were lost
    one_look_bound: (
        float | None
    )  # lower bound on the success probability, for one look at a number fixed before
    failure_rate: tuple[float, float] | None  # 95 % interval (Jeffreys), for one look, too


@dataclass(frozen=True)
class JudgedRequirement:
    """A requirement and its verdict on every controller."""

    asked: Requirement
    words: str
    controllers: Mapping[str, ControllerVerdict]

    @property
    def name(self) -> str:
        """Its id, or its metric."""
        return self.asked.traced.get("id", self.asked.metric)


@dataclass(frozen=True)
class Together:
    """All verdicts as one family: how many PASS would stand at one risk for all."""

    risk: float
    verdicts: int
    stand: int
    dropped: tuple[tuple[int, str], ...]  # requirement and controller


@dataclass(frozen=True)
class GlanceCell:
    """Quantiles of a controller's flights, infinite among lost ones, which are worst; and its verdict."""

    low: float
    median: float
    high: float
    tolerance: float | None = None
    status: str = ""


@dataclass(frozen=True)
class GlanceRow:
    """The flights beside a limit: of a requirement, or of a metric that stands first beside its median."""

    metric: str
    label: str
    unit: str
    text: str  # the limit
    limit: float
    below: bool  # whether values are good below it
    size: float  # unit of the distance from it: its own size, or the first controller's 5 to 95 % where it is 0
    cells: Mapping[str, GlanceCell]


@dataclass(frozen=True)
class Verdicts:
    """Every requirement, judged."""

    requirements: tuple[JudgedRequirement, ...]
    held_together: Together | None  # None where no verdict is given
    family_risk: float | None  # of any false PASS among all verdicts, where the campaign holds it
    glance: tuple[GlanceRow, ...]

    def statuses(self, controller: str) -> list[str]:
        """The verdicts of a controller."""
        return [entry.controllers[controller].status for entry in self.requirements]

    def kept(self, controller: str) -> int:
        """How many requirements a controller met in every flight."""
        return sum(entry.controllers[controller].failures == 0 for entry in self.requirements)


def compute_verdicts(results: FlownCampaign) -> Verdicts:
    """Judge all requirements as the manifest has them: all pairs are one family."""
    names, items, campaign = results.controllers, results.campaign.requirements, results.campaign
    points = len(campaign.unknowns.points)
    counted = [_at_points(results.flights[name], item, points) for item in items for name in names]
    # In the manifest's order: by controller, then requirement.
    order = [k * len(names) + n for n in range(len(names)) for k in range(len(items))]
    judged = campaign.judge(names, [counted[k] for k in order])
    found = dict(zip(order, judged, strict=True))
    requirements = tuple(
        JudgedRequirement(
            item,
            requirement_words(item, campaign.metrics),
            {
                name: _verdict(results, k, name, *found[k * len(names) + n])
                for n, name in enumerate(names)
            },
        )
        for k, item in enumerate(items)
    )
    together = _together(requirements, campaign.family_risk) if campaign.judged else None
    glance = [_glance(results, entry) for entry in requirements] or [
        _unlimited(results, m) for m in results.asked
    ]
    return Verdicts(requirements, together, campaign.family_risk, tuple(glance))


def _at_points(flights: ControllerFlights, requirement: Requirement, points: int) -> list[Verdict]:
    """The verdicts of one requirement on one controller at each point of the unknowns."""
    failed = requirement_failures(flights, requirement)
    numbers = [flights.flight[failed], flights.flight, flights.absent]
    counts = [np.bincount(number % points, minlength=points).tolist() for number in numbers]
    return [
        requirement.judge(missed, flown + absent, absent)
        for missed, flown, absent in zip(*counts, strict=True)
    ]


def _verdict(
    results: FlownCampaign, number: int, name: str, verdict: Verdict, point: int
) -> ControllerVerdict:
    flights, unknowns = results.flights[name], results.campaign.unknowns
    item, points = results.campaign.requirements[number], len(unknowns.points)
    given, early = results.campaign.judged, requirement_failures(flights, item) & flights.failed
    tolerance, room, beyond = (
        find_tolerance(flights, item, points, unknowns.judged(number))
        if given
        else (None, None, False)
    )
    flies = results.campaign.can_rerun
    return ControllerVerdict(
        **vars(verdict),
        words=verdict_words(verdict, flies),
        ended_early=int(early[flights.flight % points == point].sum()),
        advice=advice_words(verdict, flies) if verdict.status == "NOT SHOWN" else "",
        tolerance_limit=tolerance,
        room=room,
        beyond_lost=beyond,
        one_look_bound=success_lower_bound(verdict.failures, verdict.flights, item.consumer_risk)
        if given
        else None,
        failure_rate=jeffreys(verdict.failures, verdict.flights) if given else None,
    )


def find_tolerance(
    flights: ControllerFlights,
    requirement: Requirement,
    points: int = 1,
    judged: Sequence[int] = (0,),
) -> tuple[float | None, float | None, bool]:
    """What the required share of flights stays within, by the rule of the verdict, and the room to the limit: the worst
    over the points of the unknowns at which the requirement is ``judged``.

    Both are None where the flights are too few, or too many were lost (the third); the room is a share of the limit.
    Of two limits the first is the distance outside them, negative inside, and the room a share of half their distance.
    """
    limits = requirement.limits
    worse = limits.worse(flights.metrics[requirement.metric])
    worse[np.isnan(worse) | (flights.failed & requirement.early_is_failure)] = np.inf
    at, absent = flights.flight % points, flights.absent % points
    asked = requirement.probability, requirement.consumer_risk
    each = [tolerance_limit(worse[at == k], int(np.sum(absent == k)), *asked) for k in judged]
    found = None if None in each else max(limit for limit in each if limit is not None)
    if found is None or not np.isfinite(found):
        return None, None, found is not None
    return limits.sign * found, (limits.limit - found) / limits.size if limits.size else None, False


def _together(
    requirements: Sequence[JudgedRequirement], family_risk: float | None
) -> Together | None:
    verdicts = [verdict for entry in requirements for verdict in entry.controllers.values()]
    if not verdicts:
        return None
    risk = family_risk or FAMILY_RISK
    held = hold_family(verdicts, risk)
    names = [(i, name) for i, entry in enumerate(requirements) for name in entry.controllers]
    dropped = [
        place
        for place, alone, verdict in zip(names, verdicts, held, strict=True)
        if alone.status == "PASS" and verdict.status != "PASS"
    ]
    return Together(
        risk, len(verdicts), sum(verdict.status == "PASS" for verdict in held), tuple(dropped)
    )


def _glance(results: FlownCampaign, entry: JudgedRequirement) -> GlanceRow:
    item, record, limits = (
        entry.asked,
        results.campaign.metrics[entry.asked.metric],
        entry.asked.limits,
    )
    cells = {
        name: GlanceCell(
            *_quantiles(results, name, item.metric, limits),
            tolerance=verdict.tolerance_limit,
            status=verdict.status,
        )
        for name, verdict in entry.controllers.items()
    }
    unit = f"{record.unit} outside the limits" if limits.both else record.unit
    size = _size(limits, results, item.metric)
    text, limit = record.with_unit(limits.symbols), limits.sign * limits.limit
    return GlanceRow(item.metric, record.label, unit, text, limit, limits.sign > 0.0, size, cells)


def _unlimited(results: FlownCampaign, metric: str) -> GlanceRow:
    """A metric without a requirement: the first controller's median stands where a limit would."""
    record = results.campaign.metrics[metric]
    side = Bounds(low=0.0) if record.bad == "low" else Bounds(high=0.0)
    cells = {
        name: GlanceCell(*_quantiles(results, name, metric, side)) for name in results.controllers
    }
    middle = next((cell.median for cell in cells.values() if np.isfinite(cell.median)), 0.0)
    text = f"median {significant(middle, 3)} {'' if record.unit == '-' else record.unit}".strip()
    size = abs(middle) or _size(side, results, metric)
    return GlanceRow(metric, record.label, record.unit, text, middle, side.sign > 0.0, size, cells)


def _size(limits: Bounds, results: FlownCampaign, metric: str) -> float:
    first = results.flights[results.controllers[0]]
    return limits.size or float(spread(first.metrics[metric][~first.failed]))


def _quantiles(
    results: FlownCampaign, name: str, metric: str, limits: Bounds
) -> tuple[float, float, float]:
    """Of the metric; of two limits, of the distance outside them, negative inside. Of several points of unknowns the
    least and the most: a probability box."""
    flights = results.flights[name]
    worse = limits.worse(flights.metrics[metric])
    values: Floats = limits.sign * np.where(flights.failed | np.isnan(worse), np.inf, worse)
    at = flights.flight % len(results.campaign.unknowns.points)
    with np.errstate(invalid="ignore"):
        each = np.array(
            [np.percentile(values[at == k], _SHARES, method="nearest") for k in np.unique(at)]
        )
    low, median, high = each[:, 0].min(), np.median(each[:, 1]), each[:, 2].max()
    return float(low), float(median), float(high)
