"""Trials of the candidates of a tuning run: flights, stability margins and scores."""

import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Design
from abhv_mc.campaign.sampling.samples import drawn_samples
from abhv_mc.execution.executor import FlightRunner, simulate
from abhv_mc.flights.metrics import MARGIN_NAMES, MARGIN_VALUES, Metric
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.search.space import Space
from abhv_mc.statistics.estimates import severity, sorted_quantile
from abhv_mc_tune.candidates import Candidate, Candidates, Time
from abhv_mc_tune.constrained_search import Scores
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.vehicle_simulator.corner_margins import make_corners
from abhv_mc_vehicle.vehicle_simulator.tuning import Aim, Limit, Tune

_BLOCK = 128  # number of flights per call


@dataclass(frozen=True)
class Trial:
    """Metrics and stability margins of one candidate."""

    columns: tuple[str, ...]  # names of the metrics
    metrics: Floats  # metrics [flight, metric]; NaN if a flight terminated early or failed to run
    # margins [vehicle, margin], nominal vehicle first; empty without limits on margins
    margins: Floats

    def column(self, metric: str) -> Floats:
        """Return the values [flight] of a metric."""
        return self.metrics[:, self.columns.index(metric)]


def vehicles_of(campaign: Experiment, block: Tune) -> Floats:
    """Return rows [vehicle, parameter] of the vehicles whose margins are limited."""
    vehicles = [limit.vehicles for limit in block.limits if limit.is_margin]
    return (
        make_corners(campaign) if "corners" in vehicles else nominal_parameters()[: len(vehicles)]
    )


@dataclass(frozen=True)
class Trials:
    """Simulation of the candidates of one controller of a campaign."""

    campaign: Experiment
    candidates: Candidates
    space: Space
    folder: Path  # folder of stored results
    identity: str  # hash of all inputs except point and parameters
    executor: FlightRunner
    vehicles: Floats  # parameters [vehicle, parameter] of the vehicles whose margins are limited
    margins_at: tuple[Time, ...]
    flights_at: tuple[Time, ...] = ()  # times at which margins of flights are computed, if any

    def draw(self, seed: int, flights: int) -> Floats:
        """Draw the inputs [flight, column] that are common to all candidates."""
        design = Design(INDEPENDENT, seed, self.space.names, flights, 2)
        values = drawn_samples(
            design, self.space.marginals, self.space.copula, self.space.parameters
        ).draw(0, flights)
        return self.space.complete(values, seed, 0)

    def measure(self, points: Floats, parameters: Floats) -> list[Trial]:
        """Simulate candidates ``points`` [candidate, dimension] and return their trials."""
        distinct, indices = np.unique(points, axis=0, return_inverse=True)
        with ThreadPoolExecutor(self.executor.workers) as threads:
            trials = list(threads.map(lambda point: self._run(point, parameters), distinct))
        return [trials[i] for i in indices.reshape(-1).tolist()]

    def nominal_margins(self, points: Floats) -> Floats:
        """Return the smallest margins [candidate, margin] of the nominal vehicle."""
        trials = replace(self, vehicles=nominal_parameters())
        return np.stack([trials.margins_of(trials._make(point)())[0] for point in points])

    @functools.cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the metrics of the flights, including margins if required."""
        margins = MARGIN_VALUES if self.flights_at else ()
        return tuple(signal.name for signal in (*self.campaign.measured, *margins))

    def _run(self, point: Floats, parameters: Floats) -> Trial:
        candidate, columns = self._make(point), self.columns
        metrics = self._remember(
            point, parameters, len(columns), lambda: self._fly(candidate(), parameters)
        )
        if not len(self.vehicles):
            return Trial(columns, metrics, np.empty((0, len(MARGIN_NAMES))))
        margins = self._remember(
            point, self.vehicles, len(MARGIN_NAMES), lambda: self.margins_of(candidate())
        )
        return Trial(columns, metrics, margins)

    def _remember(
        self, point: Floats, parameters: Floats, columns: int, make: Callable[[], Floats]
    ) -> Floats:
        """Return stored values [row, column], or compute and store the values."""
        key = hashlib.sha256(
            point.tobytes() + parameters.tobytes() + self.identity.encode()
        ).hexdigest()[:32]
        path = self.folder / f"{key}.npy"
        stored = read_array(path)
        if (
            stored is not None
            and stored.shape == (len(parameters), columns)
            and stored.dtype == np.float64
        ):
            return np.array(stored)
        values = make()
        write_array(path, values)
        return values

    def _fly(self, candidate: Candidate | None, parameters: Floats) -> Floats:
        """Return the metrics [flight, metric] of a candidate, NaN if it is invalid."""
        if candidate is None:
            return np.full((len(parameters), len(self.columns)), np.nan)
        plan = candidate.with_margins(self.flights_at) if self.flights_at else candidate.plan
        name = self.candidates.name
        experiment = replace(
            self.campaign, systems={name: System(plan)}, columns=self.space.columns
        )
        starts = range(0, len(parameters), _BLOCK)
        blocks = [
            simulate(experiment, name, parameters[start : start + _BLOCK], None, self.executor.fly)
            for start in starts
        ]
        metrics = np.concatenate([block.metrics for block in blocks])
        missing = len(self.columns) - metrics.shape[1]  # Margins are missing if there is no trim.
        metrics = np.hstack([metrics, np.zeros((len(metrics), missing))])
        lost = np.concatenate([block.outcome for block in blocks]) != Outcome.OK
        return np.where(lost[:, None], np.nan, metrics)

    def margins_of(self, candidate: Candidate | None) -> Floats:
        """Return the smallest margins [vehicle, margin] of a candidate.

        Margins are zero if the candidate is invalid or has no trim.
        """
        if candidate is None:
            return np.zeros((len(self.vehicles), len(MARGIN_NAMES)))
        return candidate.margins(self.vehicles, self.margins_at)

    def _make(self, point: Floats) -> Callable[[], Candidate | None]:
        """Return a cached function that returns the candidate, or None if it is invalid."""
        file = self.folder / f"{hashlib.sha256(point.tobytes()).hexdigest()[:32]}.yaml"
        steady = bool(self.flights_at or len(self.vehicles))
        return functools.cache(lambda: self.candidates.make(point, file, steady))


def severities_of(trial: Trial, metric: Metric) -> Floats:
    """Return the severities [flight] of a metric; early terminations are infinite.

    Larger severities are worse. The severity of a metric with two limits is the distance outside
    the limits.
    """
    values = trial.column(metric.name)
    return (
        severity(metric.band.worse(values), "high") if metric.band else severity(values, metric.bad)
    )


def value_of(trial: Trial, metric: Metric, quantile: float) -> float:
    """Return a quantile of a metric over the flights, ordered from best to worst.

    Early terminations count as the worst value.
    """
    value = sorted_quantile(np.sort(severities_of(trial, metric)), quantile)
    return -value if metric.bad == "low" and not metric.band else value


def limited_value(trial: Trial, limit: Limit) -> float:
    """Return the limited quantity: a quantile over the flights, or the smallest margin."""
    if not limit.is_margin:
        sign = -1.0 if limit.above is not None else 1.0
        worse = severity(sign * trial.column(limit.metric), "high")
        return sign * sorted_quantile(np.sort(worse), limit.quantile)
    margins = trial.margins[:, MARGIN_NAMES.index(limit.metric)]
    return float(margins.min() if limit.vehicles == "corners" else margins[0])


def bound_of(limit: Limit, start: Trial) -> float:
    """Return the bound of a limit; a relative limit is multiplied by the initial value."""
    if limit.below_start_times is not None:
        return limit.below_start_times * limited_value(start, limit)
    return float(limit.below if limit.below is not None else limit.above or 0.0)


def excess_of(trial: Trial, limit: Limit, bound: float) -> float:
    """Return the relative violation of a limit, positive if the limit is violated."""
    sign = -1.0 if limit.above is not None else 1.0
    return sign * (limited_value(trial, limit) - bound) / (abs(bound) or 1.0)


def score(
    trials: Sequence[Trial], block: Tune, bounds: Sequence[float], metrics: Mapping[str, Metric]
) -> Scores:
    """Return the scores of candidates on the same flights, as quantiles of severities."""
    excess = [
        [excess_of(trial, limit, bound) for limit, bound in zip(block.limits, bounds, strict=True)]
        for trial in trials
    ]

    def scores(aim: Aim) -> Floats:
        severities = [np.sort(severities_of(trial, metrics[aim.metric])) for trial in trials]
        return np.array([sorted_quantile(values, aim.quantile) for values in severities])

    return Scores(
        scores(block.minimise),
        np.array(excess).reshape(len(trials), len(bounds)),
        scores(block.usage),
    )
