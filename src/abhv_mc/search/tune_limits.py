"""Quantiles, margins and limits of tuning: candidates' trials as scores."""

from collections.abc import Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.tuning import Limit, Tune
from abhv_mc.flight.metrics import MARGIN_NAMES, METRIC_INDEX
from abhv_mc.search.methods.tune import Scores
from abhv_mc.search.tune_trials import Trial
from abhv_mc.statistics.estimates import sorted_quantile


def quantile_of(metrics: Floats, metric: str, quantile: float, sign: float = 1.0) -> float:
    """A quantile of a metric, lost flights being the worst: of its largest values, or its smallest for ``sign`` -1."""
    return sign * sorted_quantile(np.sort(lost_as_worst(sign * metrics[:, METRIC_INDEX[metric]])), quantile)


def lost_as_worst(values: Floats) -> Floats:
    """Values ``[flight]``, large ones being bad, with those of lost flights infinite."""
    return np.where(np.isnan(values), np.inf, values)


def limited_value(trial: Trial, limit: Limit) -> float:
    """What a limit bounds: a quantile over the flights, or the least margin of the vehicles that it names."""
    if not limit.is_margin:
        return quantile_of(trial.metrics, limit.metric, limit.quantile, -1.0 if limit.above is not None else 1.0)
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


def score(trials: Sequence[Trial], block: Tune, bounds: Sequence[float]) -> Scores:
    """Scores of candidates on the same flights."""
    aim, usage = block.minimise, block.usage
    excess = [
        [excess_of(trial, limit, bound) for limit, bound in zip(block.limits, bounds, strict=True)] for trial in trials
    ]
    return Scores(
        np.array([quantile_of(trial.metrics, aim.metric, aim.quantile) for trial in trials]),
        np.array(excess).reshape(len(trials), len(bounds)),
        np.array([quantile_of(trial.metrics, usage.metric, usage.quantile) for trial in trials]),
    )
