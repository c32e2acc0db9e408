"""Counts of stored flights, outcomes and requirement failures; digest; missing flights."""

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from abhv_mc.array_types import Ints, Mask
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.flights.metrics import MARGIN_VALUES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.envelope_states import Collector
from abhv_mc.folder.flights import END_TIME, Digest, FlightRows
from abhv_mc.folder.manifest import ControllerCount, Manifest, RequirementVerdict
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import Verdict, verdict_words

_OK, _FAILED = Outcome.OK.code, Outcome.FAILED_TO_RUN.code


@dataclass
class RequirementCount:
    """Counts for one requirement and controller, without flights that failed to run."""

    requirement: Requirement
    binds: bool  # whether the requirement applies to the controller
    missed: Mask  # [flight] whether the flight violates the requirement
    flights: Ints  # [point] number of flights at each point of the unknowns
    # [point] number of flights that failed only by early termination
    ended_early: Ints
    measured: Ints  # [point] number of flights whose metric violates the limits

    def add(self, values: np.ndarray, early: np.ndarray, flights: np.ndarray) -> None:
        """Count flights by the value of the metric; NaN is a failure."""
        measured = self.requirement.limits.failures(values)
        failed = measured | (early & self.requirement.early_is_failure)
        self.missed[flights] = failed
        points = len(self.flights)
        self.flights += np.bincount(flights % points, minlength=points)
        self.measured += np.bincount(flights[measured] % points, minlength=points)
        self.ended_early += np.bincount(flights[failed & ~measured] % points, minlength=points)


@dataclass
class FlightCounts:
    """Counts of outcomes and missed requirements of one controller."""

    controller: str
    requirements: list[RequirementCount]
    uncomputed: Mask  # [flight] whether the flight failed to run
    digest: Digest = field(default_factory=Digest)
    outcomes: Counter[str] = field(default_factory=Counter)
    # Indices of the flights that terminated early; there may be millions.
    failed: "array[int]" = field(default_factory=lambda: array("q"))

    def add(self, rows: FlightRows, digest: Digest) -> None:
        """Add the flights of a block to the counts."""
        self.digest += digest
        self.outcomes.update(rows.outcome)
        outcome = np.array(rows.outcome)
        flown = outcome != _FAILED
        early = (outcome != _OK) & flown
        self.failed.extend(rows.flights[early].tolist())
        self.uncomputed[rows.flights[~flown]] = True
        for count in self.requirements:
            column = rows.columns.index(count.requirement.metric)
            count.add(rows.values[flown, column], early[flown], rows.flights[flown])

    @property
    def not_computed(self) -> list[int]:
        """Numbers of the flights that failed to run."""
        numbers = np.flatnonzero(self.uncomputed).tolist()
        return numbers


def make_flight_counts(campaign: Experiment) -> dict[str, FlightCounts]:
    """Return counts of zero flights for each controller."""
    all_counts, points = {}, len(campaign.unknowns.points)
    for name in campaign.controllers:
        counts = [
            RequirementCount(
                item,
                name in item.controllers,
                np.zeros(campaign.runs, bool),
                *np.zeros((3, points), np.int64),
            )
            for item in campaign.requirements
        ]
        all_counts[name] = FlightCounts(name, counts, np.zeros(campaign.runs, bool))
    return all_counts


def flight_values(campaign: Experiment) -> tuple[Signal, ...]:
    """Return the columns of the flights table that follow the sampled parameters."""
    return (*campaign.measured, END_TIME, *(MARGIN_VALUES if campaign.margin_flights else ()))


def count_flights(
    manifest: Manifest, all_counts: Mapping[str, FlightCounts], done: Mapping[str, Mask]
) -> tuple[Manifest, int]:
    """Return the manifest with the counts of the flights ``done`` [flight].

    The second result is the number of consecutive flights, from flight 0 on, that are stored for
    all controllers.
    """
    failed = max((counts.outcomes[_FAILED] for counts in all_counts.values()), default=0)
    common = np.logical_and.reduce(list(done.values()))
    counted = replace(
        manifest,
        runs_done=int(common.sum()) - failed,
        runs_failed=failed,
        digest=str(sum((counts.digest for counts in all_counts.values()), Digest())),
        digests={name: str(counts.digest) for name, counts in all_counts.items()},
        controllers={
            name: ControllerCount(
                dict(sorted(counts.outcomes.items())),
                int(done[name].sum()),
                tuple(counts.not_computed) or None,
            )
            for name, counts in all_counts.items()
        },
    )
    return counted, int(np.argmin(np.append(common, False)))


def judge_counts(
    all_counts: Mapping[str, FlightCounts], campaign: Experiment, flights: int | None = None
) -> list[tuple[FlightCounts, RequirementCount, Verdict, int]]:
    """Return each controller's verdict on each requirement, with its point of the unknowns.

    If ``flights`` is given, only the first ``flights`` flights are assessed. All pairs of
    requirement and controller form one family of tests.
    """
    counted = [(counts, count) for counts in all_counts.values() for count in counts.requirements]
    points, groups = len(campaign.unknowns.points), []
    for counts, count in counted:
        group = []
        for point in range(points):
            rows = slice(point, flights, points)
            failures, uncomputed = int(count.missed[rows].sum()), int(counts.uncomputed[rows].sum())
            number = len(range(point, flights or 0, points))
            if flights is None:
                number = int(count.flights[point]) + uncomputed
            group.append(count.requirement.judge(failures, number, uncomputed))
        groups.append(group)
    judged = campaign.judge(tuple(all_counts), groups)
    return [(*pair, *verdict) for pair, verdict in zip(counted, judged, strict=True)]


def judge_requirements(
    manifest: Manifest, all_counts: Mapping[str, FlightCounts], campaign: Experiment
) -> Manifest:
    """Return the manifest with the failure counts and verdicts of all requirements."""
    judged: dict[bool, list[RequirementVerdict]] = {True: [], False: []}
    for counts, count, verdict, point in judge_counts(all_counts, campaign):
        requirement = count.requirement
        entry = RequirementVerdict(
            above=requirement.limits.low,
            below=requirement.limits.high,
            metric=requirement.metric,
            probability=requirement.probability,
            consumer_risk=requirement.consumer_risk,
            producer_risk=verdict.producer_risk,
            controller=counts.controller,
            flights=verdict.flights,
            failures=verdict.failures,
            failures_ended_early=int(count.ended_early[point]),
            failures_measured=int(count.measured[point]),
            failures_not_computed=verdict.uncomputed,
            verdict=verdict.status,
            set_later=verdict.set_later,
            words=verdict_words(verdict, campaign.can_rerun),
            **requirement.traced,
        )
        judged[count.binds].append(entry)
    return replace(
        manifest, requirements=tuple(judged[True]), requirements_shown=tuple(judged[False])
    )


_FIRST_JUDGED = 64  # number of flights before the first assessment in a campaign with 'stop'


class Completion:
    """Counts of the stored flights of each controller."""

    def __init__(
        self, campaign: Experiment, shard: tuple[int, int], requested: tuple[str, ...]
    ) -> None:
        """Initialize the counts to zero.

        ``shard`` is the range of flights in the folder; ``requested`` lists the controllers to run.
        """
        self.campaign, self.requested = campaign, requested
        self.first, self.stop = shard
        self.all_counts = make_flight_counts(campaign)
        self.done = {name: np.zeros(campaign.runs, bool) for name in self.all_counts}

    def add(self, rows: FlightRows, digest: Digest) -> None:
        """Add the flights of a block to the counts."""
        self.all_counts[rows.controller].add(rows, digest)
        self.done[rows.controller][rows.first : rows.stop] = True

    def goal(self) -> int:
        """Return the number of flights to run.

        A campaign that stops as soon as all verdicts are PASS or FAIL needs only the flights up to
        this point. The numbers of flights at which verdicts are assessed depend only on the flights
        themselves, not on workers or interruptions.
        """
        if self.campaign.model.stop is None:
            return self.stop
        points = len(self.campaign.unknowns.points)
        gapless = int(min(np.argmin(np.append(mask, False)) for mask in self.done.values()))
        goal = min(points * _FIRST_JUDGED, self.stop)
        while goal <= gapless and goal < self.stop:
            unproven = [
                v
                for _, count, v, _ in judge_counts(self.all_counts, self.campaign, goal)
                if count.binds and v.status == "NOT SHOWN"
            ]
            if not unproven:
                return max(goal, gapless)
            next_pass = min(
                points * flights_to_pass(v.failures, v.probability, v.consumer_risk)
                for v in unproven
            )
            goal = min(max(next_pass, goal + goal // (10 * points) * points), 2 * goal, self.stop)
        return goal

    def is_complete(self) -> bool:
        """Return whether all flights up to the number returned by :meth:`goal` are stored."""
        goal = self.goal()
        return all(mask[self.first : goal].all() for mask in self.done.values())

    def find_missing(self, collectors: dict[str, Collector]) -> dict[str, tuple[Mask, Mask]]:
        """Return masks [flight] of missing rows and envelope contributions, by controller.

        Only flights up to the number returned by :meth:`goal` are considered. The result is an
        empty dictionary if no data is missing.
        """
        missing = {}
        numbers = np.arange(self.campaign.runs)
        below = (numbers >= self.first) & (numbers < self.goal())
        for name, done in self.done.items():
            # Envelopes include completed flights of all controllers.
            expected = ~done & below & (name in self.requested)
            # Flights that were not computed do not contribute to envelopes.
            computed = ~self.all_counts[name].uncomputed
            uncovered = (
                ~collectors[name].covered if name in collectors else np.zeros(len(done), bool)
            )
            missing[name] = expected, uncovered & (done & computed | expected)
        return missing if any(mask.any() for masks in missing.values() for mask in masks) else {}
