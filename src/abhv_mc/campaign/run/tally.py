"""What is counted of finished blocks, in any order: outcomes, the digest, failures, the worst flights."""

from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.campaign.file.config import Requirement
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.statistics.requirement import measured_failures, requirement_failures
from abhv_mc.statistics.sequential import SequentialVerdict, make_sequential_plan, sequential_verdict
from abhv_mc.statistics.verdicts import Verdict, judge
from abhv_mc.store.digest import Digest
from abhv_mc.store.flights import FlightRows

_OK, _FAILED = Outcome.OK.code, Outcome.FAILED_TO_RUN.code


@dataclass
class RequirementCount:
    """One requirement on one controller."""

    requirement: Requirement
    limit: float
    flights: int = 0
    failures: int = 0
    failures_ended_early: int = 0  # failures that are such because the flight ended early
    failures_measured: int = 0  # failures by the metric alone, up to wherever the flight came
    missed: np.ndarray | None = None  # [flight] whether it failed, where the campaign stops when proven

    def add(self, values: np.ndarray, early: np.ndarray, flights: np.ndarray) -> None:
        """Count flights by their metric; not-a-number fails."""
        side = self.limit, self.requirement.below is not None
        measured = measured_failures(values, *side)
        failed = requirement_failures(values, early, *side, self.requirement.early_is_failure)
        self.failures_measured += int(measured.sum())
        self.failures_ended_early += int((failed & ~measured).sum())
        if self.missed is not None:
            self.missed[flights] = failed
        self.flights += len(values)
        self.failures += int(failed.sum())


@dataclass
class Tally:
    """Everything counted of one controller."""

    controller: str
    worst_kept: int
    worst_by: str
    requirements: list[RequirementCount]
    digest: Digest = field(default_factory=Digest)
    outcomes: Counter[str] = field(default_factory=Counter)
    failed: "array[int]" = field(default_factory=lambda: array("q"))  # flights that ended early; perhaps a million
    not_computed: "array[int]" = field(default_factory=lambda: array("q"))  # flights that failed to run
    worst: list[tuple[bool, float, int]] = field(default_factory=list)  # ok?, -metric, flight: rising

    def add(self, rows: FlightRows, digest: Digest) -> None:
        """Count one block."""
        self.digest += digest
        self.outcomes.update(rows.outcome)
        outcome = np.array(rows.outcome)
        flown = outcome != _FAILED
        early = (outcome != _OK) & flown
        self.failed.extend(rows.flights[early].tolist())
        self.not_computed.extend(rows.flights[~flown].tolist())
        for count in self.requirements:
            count.add(rows.values[flown, METRIC_INDEX[count.requirement.metric]], early[flown], rows.flights[flown])
        if self.worst_kept:
            metric = rows.values[:, METRIC_INDEX[self.worst_by]]
            metric = np.where(np.isnan(metric), np.inf, metric)
            candidates = zip((~early).tolist(), (-metric).tolist(), rows.flights.tolist(), flown.tolist(), strict=True)
            self.worst = sorted([*self.worst, *(c[:3] for c in candidates if c[3])])[: self.worst_kept]

    @property
    def worst_flights(self) -> list[int]:
        """The worst first: flights that ended early, then those with the largest metric."""
        return [flight for _, _, flight in self.worst]


def make_tallies(campaign: CheckedCampaign) -> dict[str, Tally]:
    """An empty tally for each controller."""
    model = campaign.model
    keep = model.keep.histories
    number = max((int(str(item).split()[1]) for item in keep.flights if str(item).startswith("worst")), default=0)
    first = next(iter(model.controllers))
    tallies = {}
    for name in model.controllers:
        counts = [
            # A flight that could not be computed stays a failure in a test: nothing shows that it held.
            RequirementCount(entry, limit, missed=np.ones(campaign.runs, bool) if campaign.looks else None)
            for entry, limit in zip(model.requirements, campaign.limits, strict=True)
            if name in (entry.controllers or (first,))
        ]
        tallies[name] = Tally(name, number, keep.by, counts)
    return tallies


def judge_requirements(tallies: dict[str, Tally], campaign: CheckedCampaign, flown: int) -> list[dict[str, Any]]:
    """Failure counts and verdicts, after so many flights without gaps, as the manifest holds them."""
    independent = campaign.model.sampling.design == INDEPENDENT
    found = []
    for name, tally in tallies.items():
        for count in tally.requirements:
            entry = count.requirement
            side = "below" if entry.below is not None else "above"
            asked = entry.probability, entry.consumer_risk
            verdict: Verdict | SequentialVerdict = judge(count.failures, count.flights, *asked, independent)
            if count.missed is not None:
                verdict = sequential_verdict(count.missed[:flown], make_sequential_plan(campaign.looks, *asked))
            found.append(
                {
                    "metric": entry.metric,
                    side: count.limit,
                    "probability": entry.probability,
                    "consumer_risk": entry.consumer_risk,
                    "controller": name,
                    "flights": count.flights,
                    "failures": count.failures,
                    "failures_ended_early": count.failures_ended_early,
                    "failures_measured": count.failures_measured,
                    "verdict": verdict.status,
                }
            )
    return found
