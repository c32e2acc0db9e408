"""The worst flights of each controller."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.report.metrics import HEADLINE, USAGE
from abhv_mc.report.plain import plain
from abhv_mc.report.results import ControllerFlights, Floats, Requirement, Results
from abhv_mc.report.severities import severities

_LISTED = 10


def _scores(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> dict[str, Floats]:
    """Metrics as shares of what they may be: of the limit that they have to keep, or else of their own median."""
    scores: dict[str, Floats] = {}
    for item in requirements:
        value = flights.metrics[item.metric]
        with np.errstate(divide="ignore", invalid="ignore"):
            scores[item.metric] = value / item.limit if item.below else item.limit / value
    if not scores:
        for metric in HEADLINE:
            if metric in flights.metrics:
                value = severities(flights, metric)
                finite = value[np.isfinite(value)]
                middle = float(np.median(finite)) if finite.size else 0.0
                scores[metric] = value / (middle or 1.0)
    return scores


def rank_worst(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> NDArray[np.intp]:
    """Rows [flight], worst first: those that ended early, then by the largest share of any limit."""
    scores = _scores(flights, requirements)
    if not scores:
        return np.lexsort((flights.flight, ~flights.failed))
    share = np.nan_to_num(np.stack(list(scores.values())), nan=np.inf).max(axis=0)
    return np.lexsort((flights.flight, -share, ~flights.failed))


def worst_numbers(results: Results) -> dict[str, Any]:
    """The ten worst flights of each controller, with what they were worst in."""
    worst = {}
    requirements = results.campaign.requirements
    for name in results.controllers:
        flights = results.flights[name]
        scores = _scores(flights, requirements)
        rows = rank_worst(flights, requirements)[:_LISTED]
        table = np.nan_to_num(np.stack(list(scores.values())), nan=np.inf) if scores else np.zeros((0, 0))
        worst[name] = [
            {
                "flight": int(flights.flight[row]),
                "outcome": str(flights.outcome[row]),
                "by": list(scores)[int(np.argmax(table[:, row]))] if scores else None,
                "share": plain(float(table[:, row].max())) if scores else None,
                "metrics": {m: plain(flights.metrics[m][row]) for m in (*HEADLINE, *USAGE) if m in flights.metrics},
                "samples": {key: plain(value[flights.flight[row]]) for key, value in results.samples.items()},
            }
            for row in rows
        ]
    return worst
