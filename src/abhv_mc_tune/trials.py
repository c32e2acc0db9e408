"""What tuning learns of each candidate: its flights and margins, kept in files as they are found, and its scores."""

import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.campaign.file.tuning import Aim, Limit, Tune
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Design
from abhv_mc.campaign.sampling.samples import drawn_samples
from abhv_mc.execution.executor import FlightRunner
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.metrics import MARGIN_NAMES, MARGIN_VALUES, Metric
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.search.space import Space
from abhv_mc.simulators.corner_margins import make_corners
from abhv_mc.simulators.engine import simulate
from abhv_mc.statistics.estimates import severity, sorted_quantile
from abhv_mc_tune.candidates import Candidate, Candidates, Time
from abhv_mc_tune.method import Scores

_BLOCK = 128  # flights of one call


@dataclass(frozen=True)
class Trial:
    """One candidate's flights and margins."""

    columns: tuple[str, ...]  # names of the metrics
    metrics: Floats  # [flight, metric]; not-a-number in the rows of flights that are lost
    margins: (
        Floats  # [vehicle, margin], the nominal one first; no rows where no limit asks for them
    )

    def column(self, metric: str) -> Floats:
        """A metric [flight]."""
        return self.metrics[:, self.columns.index(metric)]


def vehicles_of(campaign: Experiment, block: Tune) -> Floats:
    """Parameter rows ``[vehicle, parameter]`` whose margins the limits ask for: nominal, then corners."""
    asked = [limit.vehicles for limit in block.limits if limit.is_margin]
    return make_corners(campaign) if "corners" in asked else nominal_parameters()[: len(asked)]


@dataclass(frozen=True)
class Trials:
    """Flies candidates of one campaign and controller."""

    campaign: Experiment
    candidates: Candidates
    space: Space
    kept: Path  # folder
    identity: str  # of all that the flights depend on besides point and parameters
    executor: FlightRunner
    vehicles: Floats  # [vehicle, parameter] whose margins are found
    margins_at: tuple[Time, ...]
    flights_at: tuple[Time, ...] = ()  # where margins of each flight are found; none: nowhere

    def draw(self, seed: int, flights: int) -> Floats:
        """Rows ``[flight, column]`` of the space that all candidates fly."""
        design = Design(INDEPENDENT, seed, self.space.names, flights, 2)
        values = drawn_samples(design, self.space.marginals, self.space.copula).draw(0, flights)
        return self.space.complete(values, seed, 0)

    def measure(self, points: Floats, parameters: Floats) -> list[Trial]:
        """The trial of each candidate ``[candidate, dimension]``."""
        different, places = np.unique(points, axis=0, return_inverse=True)
        with ThreadPoolExecutor(self.executor.workers) as threads:
            found = list(threads.map(lambda point: self._one(point, parameters), different))
        return [found[place] for place in places.reshape(-1).tolist()]

    def nominal_margins(self, points: Floats) -> Floats:
        """Return the least margins ``[candidate, margin]`` of the nominal vehicle at the points of the limits."""
        trials = replace(self, vehicles=nominal_parameters())
        return np.stack([trials.margins_of(trials._make(point)())[0] for point in points])

    @functools.cached_property
    def columns(self) -> tuple[str, ...]:
        """The metrics of the flights, with their margins where these are asked for."""
        margins = MARGIN_VALUES if self.flights_at else ()
        return tuple(signal.name for signal in (*self.campaign.measured, *margins))

    def _one(self, point: Floats, parameters: Floats) -> Trial:
        candidate, columns = self._make(point), self.columns
        metrics = self._remember(
            point, parameters, len(columns), lambda: self._fly(candidate(), parameters)
        )
        if not len(self.vehicles):
            return Trial(columns, metrics, np.empty((0, len(MARGIN_NAMES))))
        found = self._remember(
            point, self.vehicles, len(MARGIN_NAMES), lambda: self.margins_of(candidate())
        )
        return Trial(columns, metrics, found)

    def _remember(
        self, point: Floats, parameters: Floats, columns: int, make: Callable[[], Floats]
    ) -> Floats:
        key = hashlib.sha256(
            point.tobytes() + parameters.tobytes() + self.identity.encode()
        ).hexdigest()[:32]
        path = self.kept / f"{key}.npy"
        kept = read_array(path)
        if (
            kept is not None
            and kept.shape == (len(parameters), columns)
            and kept.dtype == np.float64
        ):
            return np.array(kept)
        values = make()
        write_array(path, values)
        return values

    def _fly(self, candidate: Candidate | None, parameters: Floats) -> Floats:
        if candidate is None:
            return np.full((len(parameters), len(self.columns)), np.nan)
        plan = candidate.with_margins(self.flights_at) if self.flights_at else candidate.plan
        name = self.candidates.name
        experiment = replace(
            self.campaign, systems={name: System(plan)}, columns=self.space.columns
        )
        starts = range(0, len(parameters), _BLOCK)
        pieces = [
            simulate(experiment, name, parameters[start : start + _BLOCK], None, self.executor.fly)
            for start in starts
        ]
        metrics = np.concatenate([piece.metrics for piece in pieces])
        none = len(self.columns) - metrics.shape[1]  # no steady flight: no margin
        metrics = np.hstack([metrics, np.zeros((len(metrics), none))])
        lost = np.concatenate([piece.outcome for piece in pieces]) != Outcome.OK
        return np.where(lost[:, None], np.nan, metrics)

    def margins_of(self, candidate: Candidate | None) -> Floats:
        """Least margins ``[vehicle, margin]``; zero where there is no controller, or none in steady flight."""
        if candidate is None:
            return np.zeros((len(self.vehicles), len(MARGIN_NAMES)))
        return candidate.margins(self.vehicles, self.margins_at)

    def _make(self, point: Floats) -> Callable[[], Candidate | None]:
        """Makes the candidate once, when it is first asked for; None where its numbers make no controller."""
        file = self.kept / f"{hashlib.sha256(point.tobytes()).hexdigest()[:32]}.yaml"
        steady = bool(self.flights_at or len(self.vehicles))
        return functools.cache(lambda: self.candidates.make(point, file, steady))


def severities_of(trial: Trial, metric: Metric) -> Floats:
    """A metric [flight], larger being worse, with those of lost flights infinite; the distance outside two limits."""
    values = trial.column(metric.name)
    return (
        severity(metric.band.worse(values), "high") if metric.band else severity(values, metric.bad)
    )


def value_of(trial: Trial, metric: Metric, quantile: float) -> float:
    """A quantile of a metric over the flights, from its good side, in its unit; lost flights are the worst."""
    found = sorted_quantile(np.sort(severities_of(trial, metric)), quantile)
    return -found if metric.bad == "low" and not metric.band else found


def limited_value(trial: Trial, limit: Limit) -> float:
    """What a limit bounds: a quantile over the flights, or the least margin of the vehicles that it names."""
    if not limit.is_margin:
        sign = -1.0 if limit.above is not None else 1.0
        worse = severity(sign * trial.column(limit.metric), "high")
        return sign * sorted_quantile(np.sort(worse), limit.quantile)
    margins = trial.margins[:, MARGIN_NAMES.index(limit.metric)]
    return float(margins.min() if limit.vehicles == "corners" else margins[0])


def bound_of(limit: Limit, start: Trial) -> float:
    """The limit as a number: one that is relative, times what the start has."""
    if limit.below_start_times is not None:
        return limit.below_start_times * limited_value(start, limit)
    return float(limit.below if limit.below is not None else limit.above or 0.0)


def excess_of(trial: Trial, limit: Limit, bound: float) -> float:
    """How far a candidate is beyond a limit, relative to it; at or below zero where it keeps it."""
    sign = -1.0 if limit.above is not None else 1.0
    return sign * (limited_value(trial, limit) - bound) / (abs(bound) or 1.0)


def score(
    trials: Sequence[Trial], block: Tune, bounds: Sequence[float], metrics: Mapping[str, Metric]
) -> Scores:
    """Scores of candidates on the same flights: quantiles of severities, the smaller the better."""
    excess = [
        [excess_of(trial, limit, bound) for limit, bound in zip(block.limits, bounds, strict=True)]
        for trial in trials
    ]

    def scores(aim: Aim) -> Floats:
        found = [np.sort(severities_of(trial, metrics[aim.metric])) for trial in trials]
        return np.array([sorted_quantile(values, aim.quantile) for values in found])

    return Scores(
        scores(block.minimise),
        np.array(excess).reshape(len(trials), len(bounds)),
        scores(block.usage),
    )
