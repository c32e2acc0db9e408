"""Candidates in a tuning run: plans of a controller with changed parameters, and their trials.

Trials are flights, stability margins and scores.
"""

import functools
import hashlib
import operator
import os
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Design
from abhv_mc.campaign.sampling.samples import drawn_samples
from abhv_mc.execution.executor import FlightRunner, simulate
from abhv_mc.flights.metrics import MARGIN_NAMES, MARGIN_VALUES, Metric
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.arrays import read_array, write_array
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, read_document, write_document
from abhv_mc.io.messages import InputError, one_of
from abhv_mc.search.space import Space
from abhv_mc.statistics.estimates import severity, sorted_quantile
from abhv_mc_tune.constrained_search import Scores
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.law_file import NAMING_KEYS
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.stability.fly_with_margins import add_margins
from abhv_mc_vehicle.vehicle_simulator.corner_margins import make_corners, make_steady
from abhv_mc_vehicle.vehicle_simulator.make_plans import declare
from abhv_mc_vehicle.vehicle_simulator.tuning import Aim, Free, Limit, Tune

_NUMBER = re.compile(
    r"\s*(\+?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$"
)  # number with its unit
Time = Literal["trim"] | float  # trim, or a time of the flight in s


@dataclass(frozen=True)
class ControllerNumbers:
    """Controller file with free parameters.

    A point has one coordinate from -1 to 1 for each free parameter: the logarithm of its factor to
    the base of its largest factor.
    """

    document: Document
    free: tuple[Free, ...]

    def factors(self, point: Floats) -> Floats:
        """Return the factors [parameter] for a point [parameter]."""
        return np.array([entry.factor for entry in self.free]) ** point

    def values(self, point: Floats) -> dict[str, str | float]:
        """Return the free parameters of a point as written in the file, by key."""
        factors = self.factors(point).tolist()
        entries = dict(_numbers(self.document.data))
        return {
            e.key: _scaled(entries[e.key], factor)
            for e, factor in zip(self.free, factors, strict=True)
        }

    def at_ends(self, point: Floats) -> list[str]:
        """Return the keys of the free parameters that are at a bound of their range."""
        return [
            entry.key
            for entry, x in zip(self.free, point.tolist(), strict=True)
            if abs(x) >= 1.0 - 1e-9
        ]

    def write(self, path: Path, point: Floats, comment: str = "") -> None:
        """Write the controller file with the free parameters of a point.

        Paths of the files of a custom law are adapted to the new folder.
        """
        data = deepcopy(self.document.entries)
        for key in data.keys() & NAMING_KEYS:
            is_list = isinstance(data[key], list)
            files = [
                os.path.relpath(self.document.resolve(name).resolve(), path.parent.resolve())
                for name in (data[key] if is_list else [data[key]])
            ]
            data[key] = files if is_list else files[0]
        for key, value in self.values(point).items():
            *parents, last = key.split(".")
            functools.reduce(operator.getitem, parents, data)[last] = value
        write_document(path, data, comment)


def read_controller_numbers(
    path: Path, free: Sequence[Free], block: Document, keys: tuple[str | int, ...]
) -> ControllerNumbers:
    """Read a controller file and find the free parameters.

    ``keys`` lead to the ``tune`` block in the document ``block``. Raise InputError,
    with the location of the entry in the block, if an entry names a parameter that the file does
    not have.
    """
    read_controller(path)
    document = read_document(path)
    numbers = dict(_numbers(document.data))
    for i, entry in enumerate(free):
        if entry.key not in numbers:
            raise block.error(
                (*keys, "free", i),
                f"'{entry.key}' is not a positive number in {path.name}",
                one_of(numbers, entry.key),
            )
    return ControllerNumbers(document, tuple(free))


def check_free_numbers(campaign: Experiment) -> None:
    """Raise InputError if no controller has all free parameters of the ``tune`` block.

    The error refers to the first controller, which is tuned by default.
    """
    block = campaign.model.tune
    if block is None:
        return
    errors = []
    for path in campaign.model.controllers.values():
        try:
            read_controller_numbers(path, block.free, campaign.document, ("tune",))
        except InputError as error:
            errors.append(error)
        else:
            return
    if errors:
        raise errors[0]


def _numbers(data: Any, prefix: str = "") -> Any:
    """Yield the keys and entries of all positive numbers."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, int | float | str) and not isinstance(data, bool):
        match = _NUMBER.match(str(data))
        if match and float(match[1]) > 0.0:
            yield prefix, data


def _scaled(entry: Any, factor: float) -> str | float:
    """Return an entry multiplied by a factor, with its unit and six significant digits."""
    match: Any = _NUMBER.match(str(entry))
    number, unit = match.groups()
    value = f"{float(number) * factor:.6g}"
    return f"{value} {unit}" if unit else float(value)


class Candidate(NamedTuple):
    """Plan of a controller with the parameters of a candidate."""

    plan: FlightPlan
    steady: FlightPlan | None  # plan of steady flight, if a trim exists and margins are required


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
    name: str  # name of the controller
    numbers: ControllerNumbers
    engine: Engine
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
        return np.concatenate([trials.margins_of(trials._make(point)) for point in points])

    @functools.cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the metrics of the flights, including margins if required."""
        margins = MARGIN_VALUES if self.flights_at else ()
        return tuple(signal.name for signal in (*self.campaign.measured, *margins))

    def _run(self, point: Floats, parameters: Floats) -> Trial:
        candidate = functools.cache(lambda: self._make(point))
        metrics = self._remember(
            point, parameters, self.columns, lambda: self._fly(candidate(), parameters)
        )
        margins = np.empty((0, len(MARGIN_NAMES)))
        if len(self.vehicles):
            margins = self._remember(
                point, self.vehicles, MARGIN_NAMES, lambda: self.margins_of(candidate())
            )
        return Trial(self.columns, metrics, margins)

    def _remember(
        self, point: Floats, parameters: Floats, columns: Sequence[str], make: Callable[[], Floats]
    ) -> Floats:
        """Return stored values [row, column], or compute and store the values."""
        key = point.tobytes() + parameters.tobytes() + self.identity.encode()
        path = self.folder / f"{_digest(key)}.npy"
        stored = read_array(path)
        shape = len(parameters), len(columns)
        if stored is not None and stored.shape == shape and stored.dtype == np.float64:
            return np.array(stored)
        values = make()
        write_array(path, values)
        return values

    def _fly(self, candidate: Candidate | None, parameters: Floats) -> Floats:
        """Return the metrics [flight, metric] of a candidate, NaN if it is invalid."""
        if candidate is None:
            return np.full((len(parameters), len(self.columns)), np.nan)
        plan = candidate.plan
        if self.flights_at and candidate.steady is not None:
            plan = add_margins(plan, candidate.steady, self.flights_at)
        experiment = replace(
            self.campaign, systems={self.name: System(plan)}, columns=self.space.columns
        )
        blocks = [
            simulate(
                experiment, self.name, parameters[start : start + _BLOCK], None, self.executor.fly
            )
            for start in range(0, len(parameters), _BLOCK)
        ]
        metrics = np.concatenate([block.metrics for block in blocks])
        missing = len(self.columns) - metrics.shape[1]  # Margins are missing if there is no trim.
        metrics = np.pad(metrics, ((0, 0), (0, missing)))
        metrics[np.concatenate([block.outcome for block in blocks]) != Outcome.OK] = np.nan
        return metrics

    def margins_of(self, candidate: Candidate | None) -> Floats:
        """Return the smallest margins [vehicle, margin] of a candidate.

        Margins are zero if the candidate is invalid or has no trim.
        """
        if candidate is None or candidate.steady is None:
            return np.zeros((len(self.vehicles), len(MARGIN_NAMES)))
        return margins_of_flights(
            candidate.plan, candidate.steady, self.vehicles, self.margins_at
        ).table

    def _make(self, point: Floats) -> Candidate | None:
        """Return the candidate of a point, or None if its parameters are invalid.

        The controller is written to a file, which is deleted before the method returns. Raise
        InputError if the initial parameters are invalid.
        """
        model = self.campaign.model
        file = self.folder / f"{_digest(point.tobytes())}.yaml"
        try:
            self.numbers.write(file, point)
            plan = declare(
                self.campaign, self.engine.prepare(model.vehicle, model.mission, file, self.name)
            )
            steady = None
            if self.flights_at or len(self.vehicles):
                with suppress(InputError, np.linalg.LinAlgError):
                    steady = make_steady(self.campaign, plan, file)
            return Candidate(plan, steady)
        except InputError:
            if not np.any(point):
                raise
            return None
        finally:
            file.unlink(missing_ok=True)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


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
    value = _quantile(severities_of(trial, metric), quantile)
    return -value if metric.bad == "low" and not metric.band else value


def _quantile(values: Floats, quantile: float) -> float:
    return sorted_quantile(np.sort(values), quantile)


def _sign(limit: Limit) -> float:
    """Return -1 for a lower limit, and 1 for an upper limit."""
    return -1.0 if limit.above is not None else 1.0


def limited_value(trial: Trial, limit: Limit) -> float:
    """Return the limited quantity: a quantile over the flights, or the smallest margin."""
    if not limit.is_margin:
        worse = severity(_sign(limit) * trial.column(limit.metric), "high")
        return _sign(limit) * _quantile(worse, limit.quantile)
    margins = trial.margins[:, MARGIN_NAMES.index(limit.metric)]
    return float(margins.min() if limit.vehicles == "corners" else margins[0])


def bound_of(limit: Limit, start: Trial) -> float:
    """Return the bound of a limit; a relative limit is multiplied by the initial value."""
    if limit.below_start_times is not None:
        return limit.below_start_times * limited_value(start, limit)
    return float(limit.below if limit.below is not None else limit.above or 0.0)


def excess_of(trial: Trial, limit: Limit, bound: float) -> float:
    """Return the relative violation of a limit, positive if the limit is violated."""
    return _sign(limit) * (limited_value(trial, limit) - bound) / (abs(bound) or 1.0)


def score(
    trials: Sequence[Trial], block: Tune, bounds: Sequence[float], metrics: Mapping[str, Metric]
) -> Scores:
    """Return the scores of candidates on the same flights, as quantiles of severities."""
    excess = [
        [excess_of(trial, limit, bound) for limit, bound in zip(block.limits, bounds, strict=True)]
        for trial in trials
    ]

    def scores(aim: Aim) -> Floats:
        metric = metrics[aim.metric]
        return np.array([_quantile(severities_of(trial, metric), aim.quantile) for trial in trials])

    return Scores(
        scores(block.minimise),
        np.array(excess).reshape(len(trials), len(bounds)),
        scores(block.usage),
    )
