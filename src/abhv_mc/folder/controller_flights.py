"""Flights of a campaign by controller, and their ranking by severity.

The ranking determines which flights are listed, drawn and stored with their histories.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Indices, Ints, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import OUTCOMES, Outcome, Outcomes
from abhv_mc.folder.file_columns import SpooledColumns, missing_file, read_pieces
from abhv_mc.folder.flights import END_TIME, INPUT, REASON
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.parquet_columns import column_values, distinct_texts
from abhv_mc.statistics.estimates import Criterion, severity, worst_first

_EXPECTED = "a block of flights"


@dataclass(frozen=True)
class ControllerFlights:
    """Flights of one controller in ascending order, without flights that failed to run."""

    flight: Ints  # [flight]
    outcome: NDArray[np.uint8]  # [flight] codes of `Outcome`
    metrics: Mapping[str, Floats]  # [flight] values by metric; each access returns a copy
    absent: Ints  # numbers of the flights that failed to run, ascending
    records: Mapping[str, Metric]  # definitions of the metrics
    ends: Outcomes = OUTCOMES  # possible outcomes
    reasons: Mapping[int, str] = field(default_factory=dict)  # reasons why flights failed to run

    @property
    def end_time(self) -> Floats:
        """End time [flight] of each flight, s."""
        return self.metrics[END_TIME.name]

    @property
    def not_computed(self) -> int:
        """Number of flights that failed to run; they count as failures in verdicts."""
        return int(self.absent.size)

    @cached_property
    def failed(self) -> Mask:
        """Mask [flight] of early terminations."""
        return self.outcome != Outcome.OK

    def count_outcomes(self) -> dict[str, int]:
        """Return the number of flights by outcome code, for outcomes that occurred."""
        counts = np.bincount(self.outcome, minlength=max(self.ends.codes) + 1).tolist()
        return {
            code: counts[number]
            for code, number in sorted(self.ends.numbers.items())
            if counts[number]
        }


def severities(flights: ControllerFlights, metric: str, rows: Any = slice(None)) -> Floats:
    """Return the severity [flight] of all flights, or of ``rows``, according to a metric.

    Larger values are worse; early terminations are worst (see `abhv_mc.statistics`).
    """
    return severity(
        flights.metrics[metric][rows], flights.records[metric].bad, flights.failed[rows]
    )


def distances(flights: ControllerFlights, metric: str, rows: Any = slice(None)) -> Floats:
    """Return severities [flight] or, if a metric has two limits, exceedances of the limits."""
    band = flights.records[metric].band
    if band is None:
        return severities(flights, metric, rows)
    return severity(band.worse(flights.metrics[metric][rows]), "high", flights.failed[rows])


def metric_sign(record: Metric) -> float:
    """Return the sign of a metric in :func:`distances`: -1 if low values are worse, else 1."""
    return -1.0 if record.bad == "low" and not record.band else 1.0


def common_rows(a: ControllerFlights, b: ControllerFlights) -> tuple[Any, Any]:
    """Return the rows of the common flights in ``a`` and in ``b``, in the same order."""
    _, rows_a, rows_b = np.intersect1d(a.flight, b.flight, assume_unique=True, return_indices=True)
    return rows_a, rows_b


def pooled_values(flights: Mapping[str, ControllerFlights], metric: str) -> Floats:
    """Return a metric of the completed flights of all controllers, in ascending order."""
    return np.sort(
        np.concatenate([entry.metrics[metric][~entry.failed] for entry in flights.values()])
    )


class _Collector:
    """Collector of the flights of one controller, which are added block by block."""

    def __init__(self, metrics: list[str]) -> None:
        self.flight: list[Ints] = []
        self.outcome: list[NDArray[np.uint8]] = []
        self.metrics = SpooledColumns(metrics)
        self.absent: list[Ints] = []
        self.reasons: dict[int, str] = {}

    def add(self, flight: Ints, outcome: NDArray[np.uint8], values: Floats) -> None:
        """Add rows of a block; ``values`` is [metric, flight]."""
        computed = outcome != Outcome.FAILED_TO_RUN
        self.absent.append(flight[~computed])
        self.flight.append(flight[computed])
        self.outcome.append(outcome[computed])
        self.metrics.append(values[:, computed])

    def finish(self, records: Mapping[str, Metric], ends: Outcomes) -> ControllerFlights:
        """Return all flights in ascending order."""
        flight, outcome = np.concatenate(self.flight), np.concatenate(self.outcome)
        if np.any(flight[1:] < flight[:-1]):
            order = np.argsort(flight, kind="stable")
            flight, outcome = flight[order], outcome[order]
            self.metrics.put_in_order(order)
        return ControllerFlights(
            flight=flight,
            outcome=outcome,
            metrics=self.metrics,
            absent=np.sort(np.concatenate(self.absent)),
            records=records,
            ends=ends,
            reasons=self.reasons,
        )


def read_flights(
    folder: Path,
    allowed: Collection[Path] | None = None,
    records: Mapping[str, Metric] = MappingProxyType({}),
    columns: Collection[str] | None = None,
    ends: Outcomes = OUTCOMES,
) -> dict[str, ControllerFlights]:
    """Read the flights of all controllers from the files in a folder.

    Controllers without a computed flight are omitted. If ``allowed`` is given, only these files
    are read. ``records`` are the metrics of the campaign; ``columns`` are the metrics to read, by
    default all. Raise InputError if there is no flight.
    """
    files = [
        path for path in sorted(folder.glob("*.parquet")) if allowed is None or path in allowed
    ]
    if not files:
        raise missing_file(folder, "at least one block of flights (*.parquet)")
    schema = next(read_pieces(files[0], _EXPECTED)).schema
    # Metrics are columns of floats without a dot, except inputs.
    metrics = [
        field.name
        for field in schema
        if "." not in field.name
        and pa.types.is_floating(field.type)
        and INPUT not in (field.metadata or {})
        and (columns is None or field.name in columns)
    ]
    collectors: dict[str, _Collector] = {}
    expected = ["flight", "controller", "outcome", REASON, *metrics]
    for table in chain.from_iterable(read_pieces(path, _EXPECTED, expected) for path in files):
        flight = column_values(table["flight"]).astype(np.int64)
        names, owner = distinct_texts(table["controller"])
        codes, which = distinct_texts(table["outcome"])
        values = np.stack([column_values(table[name]) for name in metrics])
        outcome = np.array([ends.numbers[code] for code in codes], dtype=np.uint8)[which]
        for k, name in enumerate(names):
            rows = owner == k
            collectors.setdefault(name, _Collector(metrics)).add(
                flight[rows], outcome[rows], values[:, rows]
            )
        for row in np.flatnonzero(outcome == Outcome.FAILED_TO_RUN).tolist():
            collectors[names[owner[row]]].reasons[int(flight[row])] = table[REASON][row].as_py()
    flights = {name: collector.finish(records, ends) for name, collector in collectors.items()}
    flights = {name: computed for name, computed in flights.items() if computed.flight.size}
    if not flights:
        raise missing_file(folder, "at least one computed flight")
    return flights


@dataclass(frozen=True)
class Ranking:
    """Flights of all controllers, worst first.

    Early terminations come first, in order of time, followed by the largest exceedances.
    """

    controllers: tuple[str, ...]
    controller: Indices  # [rank] index of the controller
    row: Indices  # [rank] row among the controller's flights
    # by controller: largest relative exceedance [row], infinite for early terminations
    beyond: Mapping[str, Floats]
    criterion_index: Mapping[
        str, Indices
    ]  # by controller: index [row] of the criterion with the largest exceedance

    def rows_of(self, name: str) -> Indices:
        """Return the rows [flight] of a controller, worst first."""
        return self.row[self.controller == self.controllers.index(name)]

    def ranks_of(self, name: str) -> Indices:
        """Return the rank of each row of a controller among the flights of all controllers."""
        return np.flatnonzero(self.controller == self.controllers.index(name))[
            np.argsort(self.rows_of(name))
        ]


def rank_flights(
    flights: Mapping[str, ControllerFlights], criteria: Sequence[Criterion]
) -> Ranking:
    """Rank the flights of all controllers; ties are broken by name.

    If a limit has no scale, the completed flights of all controllers define the scale.
    """
    flights = dict(sorted(flights.items()))
    scales = [criterion.scale(pooled_values(flights, criterion.metric)) for criterion in criteria]
    beyond, criterion_index = {}, {}
    for name, simulated in flights.items():
        table = np.zeros((max(1, len(criteria)), simulated.flight.size))
        for i, (criterion, (start, unit)) in enumerate(zip(criteria, scales, strict=True)):
            table[i] = (criterion.excess(simulated.metrics[criterion.metric]) - start) / unit
        criterion_index[name] = np.argmax(table, axis=0)
        beyond[name] = np.where(simulated.failed, np.inf, table.max(axis=0))
    early_end_times = [
        np.where(simulated.failed, simulated.end_time, np.inf) for simulated in flights.values()
    ]
    order = worst_first(np.concatenate(early_end_times), np.concatenate(list(beyond.values())))
    sizes = [simulated.flight.size for simulated in flights.values()]
    controller = np.repeat(np.arange(len(sizes)), sizes)[order]
    starts = np.cumsum([0, *sizes[:-1]])
    return Ranking(tuple(flights), controller, order - starts[controller], beyond, criterion_index)


def read_worst(folder: CampaignFolder, campaign: Experiment, number: int) -> dict[str, list[int]]:
    """Return the numbers of the worst flights of each controller in the folder.

    Raise InputError if there is no flight.
    """
    criteria = campaign.criteria
    columns = {criterion.metric for criterion in criteria} | {END_TIME.name}
    stored = read_flights(
        folder.flights, records=campaign.metrics, columns=columns, ends=campaign.outcomes
    )
    flights = {name: stored[name] for name in campaign.controllers if name in stored}
    ranking = rank_flights(flights, criteria)
    return {
        name: simulated.flight[ranking.rows_of(name)[:number]].tolist()
        for name, simulated in flights.items()
    }
