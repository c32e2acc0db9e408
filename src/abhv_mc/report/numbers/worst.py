"""The worst flights of each controller."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.seeds import is_seed
from abhv_mc.flight.outcome import Outcome
from abhv_mc.report.numbers.flights import ControllerFlights, severities
from abhv_mc.report.numbers.metrics import HEADLINE, USAGE
from abhv_mc.report.numbers.plain import plain
from abhv_mc.report.numbers.results import Requirement, Results

_LISTED = 10
_LARGEST = 3  # dispersions of a flight that are told


def _scores(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> Iterator[tuple[str, Floats]]:
    """Metrics as shares [flight] of what they may be: of the limit that they have to keep, or of their own median."""
    for metric, item in {item.metric: item for item in requirements}.items():
        value = flights.metrics[metric]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = value / item.limit if item.below else item.limit / value
        yield metric, _comparable(share)
    if requirements:
        return
    for metric in HEADLINE:
        if metric in flights.metrics:
            value = severities(flights, metric)
            finite = value[np.isfinite(value)]
            middle = float(np.median(finite)) if finite.size else 0.0
            yield metric, _comparable(value / (middle or 1.0))


def _comparable(share: Floats) -> Floats:
    return np.where(np.isnan(share), np.inf, share)


def rank_worst(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> NDArray[np.intp]:
    """Rows [flight], worst first: those that ended early, then by the largest share of any limit."""
    share: Floats | None = None
    for _, score in _scores(flights, requirements):
        share = score if share is None else np.maximum(share, score)
    if share is None:
        return np.lexsort((flights.flight, ~flights.failed))
    return np.lexsort((flights.flight, -share, ~flights.failed))


def worst_share(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> Floats:
    """The largest share [flight] of any limit, or, without requirements, of any headline metric's median.

    Infinite where the flight ended early.
    """
    share = np.zeros(flights.flight.size)
    for _, score in _scores(flights, requirements):
        share = np.maximum(share, score)
    return np.where(flights.failed, np.inf, share)


def _spread(column: Floats) -> tuple[float, float]:
    """Mean and standard deviation; both infinite where some flights have an infinite value: it never comes to them."""
    return (float(np.mean(column)), float(np.std(column))) if np.isfinite(column).all() else (np.inf, np.inf)


def _sigmas(value: float, mean: float, sigma: float) -> float | None:
    return None if np.isinf(sigma) else (value - mean) / sigma if sigma > 0.0 else 0.0


def _largest(samples: Mapping[str, float], spread: Mapping[str, tuple[float, float]]) -> list[dict[str, Any]]:
    """The dispersions furthest from the campaign's mean in its standard deviations (its sigma), furthest first.

    Before them what only some flights have, such as a failure: its sigma is None.
    """
    moved: list[dict[str, Any]] = [
        {"parameter": key, "value": samples[key], "sigma": _sigmas(samples[key], *spread[key])}
        for key in spread
        if np.isfinite(samples[key])
    ]
    return sorted(moved, key=lambda entry: -np.inf if entry["sigma"] is None else -abs(entry["sigma"]))[:_LARGEST]


def worst_numbers(results: Results) -> dict[str, Any]:
    """The ten worst flights of each controller, with what they were worst in."""
    worst = {}
    requirements = results.campaign.requirements
    for name in results.controllers:
        flights = results.flights[name]
        rows = rank_worst(flights, requirements)[:_LISTED]
        numbers = flights.flight[rows]
        scores = {metric: score[rows] for metric, score in _scores(flights, requirements)}
        table = np.stack(list(scores.values())) if scores else np.zeros((0, 0))
        metrics = {m: flights.metrics[m][rows] for m in (*HEADLINE, *USAGE) if m in flights.metrics}
        samples = {key: value[numbers] for key, value in results.samples.items()}
        spread = {key: _spread(column) for key, column in results.samples.items() if not is_seed(key)}
        worst[name] = [
            {
                "flight": int(numbers[i]),
                "outcome": Outcome(int(flights.outcome[row])).code,
                "by": list(scores)[int(np.argmax(table[:, i]))] if scores else None,
                "share": plain(float(table[:, i].max())) if scores else None,
                "metrics": {metric: plain(values[i]) for metric, values in metrics.items()},
                "samples": {key: plain(values[i]) for key, values in samples.items()},
                "largest": _largest({key: float(values[i]) for key, values in samples.items()}, spread),
            }
            for i, row in enumerate(rows)
        ]
    return worst
