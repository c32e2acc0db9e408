"""Quantiles, margins and limits of tuning: candidates' trials as scores."""

from collections.abc import Mapping, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.tuning import Aim, Limit, Tune
from abhv_mc.flight.metrics import MARGIN_NAMES, Metric
from abhv_mc.search.methods.tune import Scores
from abhv_mc.search.tune_trials import Trial
from abhv_mc.statistics.estimates import severity, sorted_quantile


def severities_of(trial: Trial, metric: Metric) -> Floats:
    """A metric [flight], larger being worse, with those of lost flights infinite; the distance outside two limits."""
    values = trial.column(metric.name)
    return severity(metric.band.worse(values), "high") if metric.band else severity(values, metric.bad)


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


def score(trials: Sequence[Trial], block: Tune, bounds: Sequence[float], metrics: Mapping[str, Metric]) -> Scores:
    """Scores of candidates on the same flights: quantiles of severities, the smaller the better."""
    excess = [
        [excess_of(trial, limit, bound) for limit, bound in zip(block.limits, bounds, strict=True)] for trial in trials
    ]

    def scores(aim: Aim) -> Floats:
        found = [np.sort(severities_of(trial, metrics[aim.metric])) for trial in trials]
        return np.array([sorted_quantile(values, aim.quantile) for values in found])

    return Scores(scores(block.minimise), np.array(excess).reshape(len(trials), len(bounds)), scores(block.usage))
