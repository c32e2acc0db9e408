"""Verdict on each requirement for each controller, joint verdicts, and margins to limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.folder.controller_flights import ControllerFlights, pooled_values
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.binomial import jeffreys, success_lower_bound
from abhv_mc.statistics.estimates import spread
from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import Verdict, advice_words, tolerance_limit, verdict_words
from abhv_mc.topics.formatting import significant
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words

FAMILY_RISK = 0.10  # risk of at least one false PASS among the verdicts that hold jointly
_SHARES = (5.0, 50.0, 95.0)  # quantiles in percent in the overview


@dataclass(frozen=True, kw_only=True)
class ControllerVerdict(Verdict):
    """Verdict with a tolerance limit; bounds are None if the flights are not independent."""

    words: str
    ended_early: int  # number of early terminations among the failures
    advice: str  # advice on the number of flights if the verdict is NOT SHOWN
    # limit met by the required share of all flights; None if there is no such limit
    tolerance_limit: float | None
    # margin to the limit, as a share of the limit or of half the distance between two limits
    room: float | None
    beyond_lost: bool  # whether too many early terminations make a tolerance limit impossible
    # lower bound on the success probability, valid for a single check
    one_look_bound: float | None
    # 95 % Jeffreys interval of the failure rate, valid for a single check
    failure_rate: tuple[float, float] | None


@dataclass(frozen=True)
class JudgedRequirement:
    """Requirement with its verdict for every controller."""

    asked: Requirement
    words: str
    controllers: Mapping[str, ControllerVerdict]

    @property
    def name(self) -> str:
        """ID of the requirement, or else the name of its metric."""
        return self.asked.traced.get("id", self.asked.metric)


@dataclass(frozen=True)
class Together:
    """Verdicts that hold jointly at a common risk."""

    risk: float
    verdicts: int
    stand: int
    # index of the requirement, and controller, of each verdict that does not hold jointly
    dropped: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class GlanceCell:
    """Quantiles and verdict for one controller; early terminations count as infinite values."""

    low: float
    median: float
    high: float
    worst: float | None  # worst completed flight; None if no flight was completed
    tolerance: float | None = None
    status: str = ""


@dataclass(frozen=True)
class GlanceRow:
    """Distribution of a metric relative to a limit or, without a limit, to its median."""

    metric: str
    label: str
    unit: str
    text: str  # description of the limit
    limit: float
    below: bool  # whether values below the limit are good
    # unit of distances: size of the limit or, if this is 0, the 5 to 95 % range
    size: float
    cells: Mapping[str, GlanceCell]


@dataclass(frozen=True)
class Verdicts:
    """All requirements with their verdicts."""

    requirements: tuple[JudgedRequirement, ...]
    held_together: Together | None  # joint verdicts; None if there are no verdicts
    # risk of at least one false PASS among all verdicts; None without a joint risk
    family_risk: float | None
    glance: tuple[GlanceRow, ...]

    @property
    def binding(self) -> list[tuple[JudgedRequirement, str, ControllerVerdict | None]]:
        """Requirements with each controller that must meet them, and its verdict.

        The verdict is None if none of the controller's flights could be computed.
        """
        return [
            (entry, name, entry.controllers.get(name))
            for entry in self.requirements
            for name in entry.asked.controllers
        ]

    def statuses(self, controller: str) -> list[str]:
        """Return the statuses of all verdicts on a controller."""
        return [entry.controllers[controller].status for entry in self.requirements]

    def verdicts_of(self, controller: str) -> list[tuple[Requirement, ControllerVerdict]]:
        """Return the requirements on a controller, or else all, with its verdicts."""
        entries = [
            entry for entry in self.requirements if controller in entry.asked.controllers
        ] or self.requirements
        return [(entry.asked, entry.controllers[controller]) for entry in entries]


def compute_verdicts(results: FlownCampaign) -> Verdicts:
    """Return the verdicts on all requirements of the manifest, as one family of tests."""
    names, items, campaign = results.controllers, results.campaign.requirements, results.campaign
    points = len(campaign.unknowns.points)
    counted = [_at_points(results.flights[name], item, points) for item in items for name in names]
    # The manifest orders verdicts by controller, then by requirement.
    order = [k * len(names) + n for n in range(len(names)) for k in range(len(items))]
    judged = campaign.judge(names, [counted[k] for k in order])
    judgements = dict(zip(order, judged, strict=True))
    requirements = tuple(
        JudgedRequirement(
            item,
            requirement_words(item, campaign.metrics),
            {
                name: _verdict(results, k, name, *judgements[k * len(names) + n])
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
    """Return the verdict on a requirement for a controller at each point of the unknowns."""
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
    is_judged, early = results.campaign.judged, requirement_failures(flights, item) & flights.failed
    tolerance, room, beyond = (
        find_tolerance(flights, item, points, unknowns.judged(number))
        if is_judged
        else (None, None, False)
    )
    flies = results.campaign.can_rerun
    return ControllerVerdict(
        **vars(verdict),
        words=verdict_words(verdict, flies),
        ended_early=early[flights.flight % points == point].sum(),
        advice=advice_words(verdict, flies) if verdict.status == "NOT SHOWN" else "",
        tolerance_limit=tolerance,
        room=room,
        beyond_lost=beyond,
        one_look_bound=success_lower_bound(verdict.failures, verdict.flights, item.consumer_risk)
        if is_judged
        else None,
        failure_rate=jeffreys(verdict.failures, verdict.flights) if is_judged else None,
    )


def find_tolerance(
    flights: ControllerFlights,
    requirement: Requirement,
    points: int,
    judged: Sequence[int],
) -> tuple[float | None, float | None, bool]:
    """Return the tolerance limit, its margin, and whether too many flights terminated early.

    Limit and margin are the worst over the points of the unknown parameters at which the
    requirement is ``judged``. Both are None if there are too few flights or too many early
    terminations. The margin is a share of the limit. With two limits, the first value is the
    distance outside the limits (negative inside), and the margin is a share of half the distance
    between the limits.
    """
    limits = requirement.limits
    worse = limits.worse(flights.metrics[requirement.metric])
    worse[np.isnan(worse) | (flights.failed & requirement.early_is_failure)] = np.inf
    point_index, absent = flights.flight % points, flights.absent % points
    risks = requirement.probability, requirement.consumer_risk
    point_limits = [
        tolerance_limit(worse[point_index == k], np.sum(absent == k), *risks) for k in judged
    ]
    worst_limit = (
        None if None in point_limits else max(limit for limit in point_limits if limit is not None)
    )
    if worst_limit is None or not np.isfinite(worst_limit):
        return None, None, worst_limit is not None
    return (
        limits.sign * worst_limit,
        (limits.limit - worst_limit) / limits.size if limits.size else None,
        False,
    )


def _together(
    requirements: Sequence[JudgedRequirement], family_risk: float | None
) -> Together | None:
    pairs = [
        ((i, name), verdict)
        for i, entry in enumerate(requirements)
        for name, verdict in sorted(entry.controllers.items())
        if not verdict.set_later
    ]
    if not pairs:
        return None
    names, verdicts = zip(*pairs, strict=True)
    risk = family_risk or FAMILY_RISK
    jointly_held = hold_family(verdicts, risk)
    dropped = [
        requirement_pair
        for requirement_pair, alone, verdict in zip(names, verdicts, jointly_held, strict=True)
        if alone.status == "PASS" and verdict.status != "PASS"
    ]
    return Together(
        risk,
        len(verdicts),
        sum(verdict.status == "PASS" for verdict in jointly_held),
        tuple(dropped),
    )


def _glance(results: FlownCampaign, entry: JudgedRequirement) -> GlanceRow:
    item, record = entry.asked, results.campaign.metrics[entry.asked.metric]
    limits = item.limits
    return GlanceRow(
        metric=item.metric,
        label=record.label,
        unit=f"{record.unit} outside the limits" if limits.both else record.unit,
        text=record.with_unit(limits.symbols),
        limit=limits.sign * limits.limit,
        below=limits.sign > 0.0,
        size=_size(limits, results, item.metric),
        cells={
            name: GlanceCell(
                *_quantiles(results, name, item.metric, limits),
                tolerance=verdict.tolerance_limit,
                status=verdict.label,
            )
            for name, verdict in entry.controllers.items()
        },
    )


def _unlimited(results: FlownCampaign, metric: str) -> GlanceRow:
    """Return the row of a metric without a requirement, scaled by the median of all controllers."""
    record = results.campaign.metrics[metric]
    side = Bounds(low=0.0) if record.bad == "low" else Bounds(high=0.0)
    values = pooled_values(results.flights, metric)
    middle = float(np.nanmedian(values)) if values.size and not np.isnan(values[0]) else 0.0
    return GlanceRow(
        metric=metric,
        label=record.label,
        unit=record.unit,
        text=f"median {record.with_unit(significant(middle, 3))}",
        limit=middle,
        below=side.sign > 0.0,
        size=abs(middle) or _size(side, results, metric),
        cells={
            name: GlanceCell(*_quantiles(results, name, metric, side))
            for name in results.controllers
        },
    )


def _size(limits: Bounds, results: FlownCampaign, metric: str) -> float:
    return limits.size or spread(pooled_values(results.flights, metric))


def _quantiles(
    results: FlownCampaign, name: str, metric: str, limits: Bounds
) -> tuple[float, float, float, float | None]:
    """Return the quantiles and worst value of a metric, or of its distance outside two limits.

    The distance is negative inside the limits. With several points of the unknowns, the result is
    the lowest and the highest quantiles over the points (a probability box).
    """
    flights = results.flights[name]
    worse = limits.worse(flights.metrics[metric])
    values = limits.sign * np.where(flights.failed | np.isnan(worse), np.inf, worse)
    point_index = flights.flight % len(results.campaign.unknowns.points)
    with np.errstate(invalid="ignore"):
        point_quantiles = np.array(
            [
                np.percentile(values[point_index == k], _SHARES, method="nearest")
                for k in np.unique(point_index)
            ]
        )
    lows, medians, highs = point_quantiles.T
    finite = values[np.isfinite(values)]
    worst = limits.sign * float(np.max(limits.sign * finite)) if finite.size else None
    return lows.min(), float(np.median(medians)), highs.max(), worst
