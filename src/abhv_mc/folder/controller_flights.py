"""The flights of a campaign by controller, from its blocks; and all of them in one order, the worst first: what is
listed, drawn and kept follows it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.metrics import BUILT_IN, Metric
from abhv_mc.flight.outcome import OUTCOMES, Outcome, Outcomes
from abhv_mc.folder.file_columns import SpooledColumns, missing_file, read_pieces
from abhv_mc.folder.flights import END_TIME, INPUT, REASON
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.parquet_columns import column_values, distinct_texts
from abhv_mc.statistics.estimates import Criterion, severity, worst_first

_EXPECTED = "a block of flights"


@dataclass(frozen=True)
class ControllerFlights:
    """The flights of one controller, ascending by number; those that a machine could not compute are left out."""

    flight: NDArray[np.int64]  # [flight]
    outcome: NDArray[np.uint8]  # [flight], of `Outcome`
    metrics: Mapping[str, Floats]  # name -> [flight], copied anew each time
    absent: NDArray[np.int64]  # numbers of the flights that could not be computed, ascending
    records: Mapping[str, Metric] = field(
        default_factory=lambda: BUILT_IN
    )  # of the metrics, with what is bad
    ends: Outcomes = OUTCOMES  # how they may end
    reasons: Mapping[int, str] = field(default_factory=dict)  # of flights that failed to run

    @property
    def end_time(self) -> Floats:
        """When each flight [flight] ended, s."""
        return self.metrics[END_TIME.name]

    @property
    def not_computed(self) -> int:
        """How many flights could not be computed: they count as failures in verdicts."""
        return int(self.absent.size)

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Which flights [flight] did not end as planned."""
        return self.outcome != Outcome.OK

    def count_outcomes(self) -> dict[str, int]:
        """How many flights ended in each way that occurred, by its code."""
        counts = np.bincount(self.outcome, minlength=max(self.ends.codes) + 1).tolist()
        return {
            code: counts[number]
            for code, number in sorted(self.ends.numbers.items())
            if counts[number]
        }


def severities(flights: ControllerFlights, metric: str, rows: Any = slice(None)) -> Floats:
    """A metric [flight] in the sense of `abhv_mc.statistics`: larger is worse, a flight that failed is worst.

    Of all flights, or of those in `rows`.
    """
    return severity(
        flights.metrics[metric][rows], flights.records[metric].bad, flights.failed[rows]
    )


def distances(flights: ControllerFlights, metric: str, rows: Any = slice(None)) -> Floats:
    """The same, but for a metric that is required on both sides the distance [flight] outside its limits."""
    band = flights.records[metric].band
    if band is None:
        return severities(flights, metric, rows)
    values = flights.metrics[metric][rows]
    return severity(band.worse(values), "high", flights.failed[rows])


def metric_sign(record: Metric) -> float:
    """Return the factor from a distance to the metric: -1 if small values are bad."""
    return -1.0 if record.bad == "low" and not record.band else 1.0


def common_rows(a: ControllerFlights, b: ControllerFlights) -> tuple[Any, Any]:
    """Rows of the flights that both flew, so that row i of one is the same flight as row i of the other."""
    _, rows_a, rows_b = np.intersect1d(a.flight, b.flight, assume_unique=True, return_indices=True)
    return rows_a, rows_b


class _Collected:
    """What the blocks read so far say of one controller."""

    def __init__(self, metrics: list[str]) -> None:
        self.flight: list[NDArray[np.int64]] = []
        self.outcome: list[NDArray[np.uint8]] = []
        self.metrics = SpooledColumns(metrics)
        self.absent: list[NDArray[np.int64]] = []
        self.reasons: dict[int, str] = {}

    def add(self, flight: NDArray[np.int64], outcome: NDArray[np.uint8], values: Floats) -> None:
        """Rows of a block: [flight], [flight] and [metric, flight]."""
        computed = outcome != Outcome.FAILED_TO_RUN
        self.absent.append(flight[~computed])
        self.flight.append(flight[computed])
        self.outcome.append(outcome[computed])
        self.metrics.append(values[:, computed])

    def finish(self, records: Mapping[str, Metric], ends: Outcomes) -> ControllerFlights:
        """All of them, ascending by number."""
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
    known: Collection[Path] | None = None,
    records: Mapping[str, Metric] = BUILT_IN,
    columns: Collection[str] | None = None,
    ends: Outcomes = OUTCOMES,
) -> dict[str, ControllerFlights]:
    """All blocks of a folder, each read once; controllers without a computed flight are left out.

    ``records``: the metrics that the campaign knows; ``columns``: the numbers that are read, by default all.

    With ``known``, only those among them, which are as they were written.

    Raises InputError where there is no flight.
    """
    files = [path for path in sorted(folder.glob("*.parquet")) if known is None or path in known]
    if not files:
        raise missing_file(folder, "at least one flown block (*.parquet)")
    schema = next(read_pieces(files[0], _EXPECTED)).schema
    metrics = _find_metrics(schema)
    metrics = [name for name in metrics if columns is None or name in columns]
    collected: dict[str, _Collected] = {}
    expected = ["flight", "controller", "outcome", *metrics]
    if REASON in schema.names:  # folders of earlier versions have no reasons
        expected.append(REASON)
    for table in chain.from_iterable(read_pieces(path, _EXPECTED, expected) for path in files):
        flight = column_values(table["flight"]).astype(np.int64)
        names, owner = distinct_texts(table["controller"])
        codes, which = distinct_texts(table["outcome"])
        values = np.stack([column_values(table[name]) for name in metrics])
        outcome = np.array([ends.numbers[code] for code in codes], dtype=np.uint8)[which]
        for k, name in enumerate(names):
            rows = owner == k
            collected.setdefault(name, _Collected(metrics)).add(
                flight[rows], outcome[rows], values[:, rows]
            )
        lost = np.flatnonzero(outcome == Outcome.FAILED_TO_RUN)
        if REASON in expected and lost.size:
            for row, reason in zip(
                lost.tolist(), table[REASON].take(pa.array(lost)).to_pylist(), strict=True
            ):
                collected[names[owner[row]]].reasons[int(flight[row])] = reason
    flown = {name: found.finish(records, ends) for name, found in collected.items()}
    flown = {name: flights for name, flights in flown.items() if flights.flight.size}
    if not flown:
        raise missing_file(folder, "a flight that was computed")
    return flown


def _find_metrics(schema: pa.Schema) -> list[str]:
    """Columns of numbers that are no samples, whose names have a point, or a mark."""
    floats = [
        field for field in schema if "." not in field.name and pa.types.is_floating(field.type)
    ]
    return [field.name for field in floats if INPUT not in (field.metadata or {})]


@dataclass(frozen=True)
class Ranking:
    """Lost flights first, the earliest before all others; then the largest distance beyond a limit."""

    controllers: tuple[str, ...]
    controller: NDArray[np.intp]  # [place] index of the controller
    row: NDArray[np.intp]  # [place] row among its flights
    beyond: Mapping[
        str, Floats
    ]  # controller -> [row] largest distance, in its limit's unit; infinite where lost
    by: Mapping[str, NDArray[np.intp]]  # controller -> [row] the criterion of that distance

    def rows_of(self, name: str) -> NDArray[np.intp]:
        """The rows [flight] of a controller, the worst first."""
        return self.row[self.controller == self.controllers.index(name)]

    def places_of(self, name: str) -> NDArray[np.intp]:
        """The place of each row [flight] of a controller among the flights of all."""
        return np.flatnonzero(self.controller == self.controllers.index(name))[
            np.argsort(self.rows_of(name))
        ]


def rank_flights(
    flights: Mapping[str, ControllerFlights], criteria: Sequence[Criterion]
) -> Ranking:
    """Rank the flights of each controller; where a limit has no size, the first one's flights give the unit."""
    first = next(iter(flights.values()))
    scales = [
        criterion.scale(first.metrics[criterion.metric][~first.failed]) for criterion in criteria
    ]
    beyond, by = {}, {}
    for name, each in flights.items():
        table = np.zeros((max(1, len(criteria)), each.flight.size))
        for i, (criterion, (start, unit)) in enumerate(zip(criteria, scales, strict=True)):
            table[i] = (criterion.excess(each.metrics[criterion.metric]) - start) / unit
        by[name] = np.argmax(table, axis=0)
        beyond[name] = np.where(each.failed, np.inf, table.max(axis=0))
    lost_at = [np.where(each.failed, each.end_time, np.inf) for each in flights.values()]
    order = worst_first(np.concatenate(lost_at), np.concatenate(list(beyond.values())))
    sizes = [each.flight.size for each in flights.values()]
    controller = np.repeat(np.arange(len(sizes)), sizes)[order]
    starts = np.cumsum([0, *sizes[:-1]])
    return Ranking(tuple(flights), controller, order - starts[controller], beyond, by)


def read_worst(folder: CampaignFolder, campaign: Experiment, number: int) -> dict[str, list[int]]:
    """Numbers of the worst flights of each controller, of those in the folder. Raises InputError without a flight."""
    criteria = campaign.criteria
    columns = {criterion.metric for criterion in criteria} | {END_TIME.name}
    held = read_flights(
        folder.flights, records=campaign.metrics, columns=columns, ends=campaign.outcomes
    )
    flights = {name: held[name] for name in campaign.controllers if name in held}
    ranking = rank_flights(flights, criteria)
    return {
        name: each.flight[ranking.rows_of(name)[:number]].tolist() for name, each in flights.items()
    }
