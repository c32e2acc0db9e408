"""The worst flights of each controller."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.seeds import is_seed
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.results import Results, kept_flights
from abhv_mc.statistics.ranking import Criterion, choose_worst, order_of, spread
from abhv_mc.topics.failed_flights import failed_anyhow
from abhv_mc.topics.plain import plain

_LISTED = 10  # at most, where no number of worst flights keeps its histories
_LARGEST = 3  # dispersions of a flight that are told


def rank_worst(flights: ControllerFlights, criteria: Sequence[Criterion], number: int) -> list[int]:
    """The rows [flight] of the worst flights, as histories are kept of them; listed with the very worst first.

    Those that ended early, then those furthest beyond a limit, in spreads of its metric.
    """
    whole = ~flights.failed
    early = zip(flights.end_time[~whole].tolist(), flights.flight[~whole].tolist(), strict=True)
    excess = [criterion.excess(flights.metrics[criterion.metric])[whole] for criterion in criteria]
    chosen = choose_worst(early, [order_of(each, flights.flight[whole]) for each in excess], number)
    return in_order(flights, criteria, np.searchsorted(flights.flight, chosen)).tolist()


def in_order(flights: ControllerFlights, criteria: Sequence[Criterion], rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows [flight], the very worst first: early ends by their time, then by the distance beyond a limit."""
    beyond = distance_beyond(flights, criteria)[0][rows]
    early_first = np.where(flights.failed[rows], flights.end_time[rows], np.inf)
    return rows[np.lexsort((flights.flight[rows], -beyond, early_first))]


def listed_worst(results: Results, name: str) -> list[int]:
    """The rows [flight] of the flights that a report lists: those whose histories are kept, the worst without any.

    At most as many as the campaign asks for with 'worst N', or 10 where it keeps others.
    """
    flights, criteria, number = results.flights[name], results.campaign.criteria, results.campaign.worst
    kept = np.flatnonzero(np.isin(flights.flight, list(kept_flights(results.folder, name))))
    if not kept.size:
        return rank_worst(flights, criteria, number or _LISTED)
    return in_order(flights, criteria, kept)[: max(number, _LISTED)].tolist()


def distance_beyond(flights: ControllerFlights, criteria: Sequence[Criterion]) -> tuple[Floats, NDArray[np.intp]]:
    """The largest distance [flight] beyond a limit, in spreads of its metric over all flights, and which limit that is.

    Without requirements the limit is the median. Infinite where the flight ended early.
    """
    table = np.zeros((max(1, len(criteria)), flights.flight.size))
    for i, criterion in enumerate(criteria):
        values = flights.metrics[criterion.metric]
        excess = criterion.excess(values)
        finite = excess[np.isfinite(excess) & ~flights.failed]
        middle = 0.0 if criterion.limits or not finite.size else float(np.median(finite))
        table[i] = (excess - middle) / spread(values[~flights.failed])
    which = np.argmax(table, axis=0)
    return np.where(flights.failed, np.inf, table.max(axis=0)), which


def rank_failed(results: Results, controller: str) -> list[int]:
    """Numbers of the flights that ended early or missed a requirement, the worst first."""
    flights = results.flights[controller]
    failed = failed_anyhow(flights, results.campaign.requirements)
    rows = rank_worst(flights, results.campaign.criteria, flights.flight.size) if failed.any() else []
    return [int(flights.flight[row]) for row in rows if failed[row]]


def _moments(column: Floats) -> tuple[float, float]:
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


def _counted(flights: ControllerFlights, metric: str, rows: NDArray[np.intp]) -> Floats:
    """Values [row] of a metric; not-a-number where a flight was lost before the stretches that it counts."""
    record, values = flights.records[metric], flights.metrics[metric][rows]
    nothing = flights.failed[rows] & record.settled & (values == record.empty)
    return np.where(nothing, np.nan, values)


def worst_numbers(results: Results) -> dict[str, Any]:
    """The worst flights of each controller, those whose histories are kept, with what they were worst in."""
    worst = {}
    criteria = results.campaign.criteria
    for name in results.controllers:
        flights = results.flights[name]
        rows = np.array(listed_worst(results, name), dtype=np.intp)
        beyond, which = distance_beyond(flights, criteria)
        numbers = flights.flight[rows]
        metrics = {m: _counted(flights, m, rows) for m in results.compared}
        samples = {key: value[numbers] for key, value in results.samples.items()}
        moments = {key: _moments(column) for key, column in results.samples.items() if not is_seed(key)}
        worst[name] = [
            {
                "flight": int(numbers[i]),
                "outcome": Outcome(int(flights.outcome[row])).code,
                "by": None if flights.failed[row] or not criteria else criteria[which[row]].metric,
                "beyond": plain(float(beyond[row])),
                "metrics": {metric: plain(values[i]) for metric, values in metrics.items()},
                "samples": {key: plain(values[i]) for key, values in samples.items()},
                "largest": _largest({key: float(values[i]) for key, values in samples.items()}, moments),
            }
            for i, row in enumerate(rows.tolist())
        ]
    return worst
