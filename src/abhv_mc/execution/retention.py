"""Flights run again at the end of a campaign: histories to store, and checks of a simulator.

The flights to store are run again, because the worst flights are known only at the end. The
repeated flights are bit-identical.

The first flights of a campaign reveal only the noise of a custom simulator. Flights with the same
inputs and stored flights that are run again also reveal files that changed later, workers that
disturbed each other, and flights that changed the state of their process. Each is re-run in a new
process.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Indices
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import simulate, with_proofs, work_ahead
from abhv_mc.execution.flight_counts import FlightCounts
from abhv_mc.execution.progress import Progress
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.repeatability import relative_difference
from abhv_mc.folder.controller_flights import read_worst
from abhv_mc.folder.flights import FlightRows, SampleReader
from abhv_mc.folder.hashes import KEY, FileHashes, Product
from abhv_mc.folder.histories import write_histories
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.interfaces import Fly

_FLIGHTS_PER_FILE = 128
_UNCOMPUTED = Outcome.FAILED_TO_RUN.code


def select_flights(
    items: tuple[int | str, ...], flights: int, counts: FlightCounts, worst: Sequence[int] = ()
) -> list[int]:
    """Return the sorted numbers of the flights that the entries ``items`` of ``keep`` select.

    ``worst`` lists the worst flights, worst first.
    """
    selected: set[int] = set()
    for item in items:
        match str(item).split():
            case ["all"]:
                selected.update(range(flights))
            case ["failed"]:
                selected.update(counts.failed)
            case ["every", step]:
                selected.update(range(0, flights, int(step)))
            case ["worst", number]:
                selected.update(worst[: int(number)])
            case [flight] if flight.isdecimal() and int(flight) < flights:
                selected.add(int(flight))  # In a campaign that stopped early, it may not exist.
    return sorted(selected - set(counts.not_computed))


@dataclass(frozen=True)
class HistoryFile:
    """File with the time histories of some of a controller's flights."""

    product: Product
    controller: str
    flights: list[int]


def list_histories(
    folder: CampaignFolder,
    campaign: Experiment,
    all_counts: Mapping[str, FlightCounts],
) -> list[HistoryFile]:
    """Return the history files that a campaign stores when its flights are complete."""
    keep = campaign.model.keep.histories
    files: list[HistoryFile] = []
    if not campaign.channels:
        return files
    number = campaign.worst
    worst = (
        read_worst(folder, campaign, number)
        if number and any(set(counts.outcomes) - {_UNCOMPUTED} for counts in all_counts.values())
        else {}
    )
    for name, counts in all_counts.items():
        selected = select_flights(keep.flights, campaign.runs, counts, worst.get(name, ()))
        for index, first in enumerate(range(0, len(selected), _FLIGHTS_PER_FILE)):
            flights = selected[first : first + _FLIGHTS_PER_FILE]
            key = hashlib.sha256(
                repr((flights, campaign.kept_channels, keep.rate)).encode()
            ).hexdigest()
            path = folder.histories / f"{name}-{index:06d}.parquet"
            files.append(HistoryFile(Product(path, key), name, flights))
    return files


def write_kept_histories(
    folder: CampaignFolder,
    campaign: Experiment,
    expected: Sequence[HistoryFile],
    samples: SampleReader,
    fly: Fly,
    *,
    workers: int,
    hashes: FileHashes,
) -> list[str]:
    """Re-run the flights of the ``expected`` files and write their histories.

    Files that are current are kept; all other history files are deleted. Return a message for each
    flight without a history.
    """
    missing = [file for file in expected if not file.product.is_current(hashes)]

    def rerun(file: HistoryFile) -> tuple[HistoryFile, FlightBlock]:
        name = file.controller
        every = campaign.simulator.find_stride(campaign.systems[name].plan, "histories")
        rows = np.concatenate([samples.rows(flight, flight + 1) for flight in file.flights])
        return file, simulate(campaign, name, rows, every, fly)

    total = sum(len(file.flights) for file in missing)
    failed = []
    landed = work_ahead(workers, rerun, ((file,) for file in missing))
    with Progress("histories", total) as progress, closing(landed):
        for file, block in landed:
            # A flight that is lost now was completed earlier; only its repetition failed.
            lost = block.outcome == Outcome.FAILED_TO_RUN
            failed += [
                f"no history of flight {file.flights[row]} of controller '{file.controller}'"
                f" ({block.reasons.get(row, 'it failed to run')})"
                for row in np.flatnonzero(lost).tolist()
            ]
            metadata = {KEY: "incomplete" if lost.any() else file.product.key}
            histories = file.product.path, file.controller, file.flights, block.times, block.history
            write_histories(
                *histories,
                channels=campaign.kept_channels,
                metadata=metadata,
                recorded=campaign.channels,
            )
            progress.add(len(file.flights))
    for path in set(folder.histories.glob("*.parquet")) - {file.product.path for file in expected}:
        path.unlink()
        hashes.forget(path)
    return failed


ESTIMATES = "requirements get estimates instead of verdicts"  # last clause of warnings
# One of 20 stored flights of each system is re-run, but at least 4 and at most 20.
_LEAST, _MOST, _SHARE = 4, 20, 20
_LOST = float(Outcome.FAILED_TO_RUN)


class Difference(NamedTuple):
    """Largest relative difference between flights with the same inputs."""

    size: float = 0.0
    description: str = ""


def find_difference(
    campaign: Experiment, name: str, pairs: Iterable[tuple[Floats, Floats, Floats]]
) -> Difference:
    """Return the largest difference, which is infinite if outcomes differ.

    Each of ``pairs`` contains a row of inputs, and the values of two flights of the system ``name``
    with these inputs.
    """
    largest, labels = Difference(), ("outcome", *(metric.name for metric in campaign.measured))
    for row, a, b in pairs:
        sizes = relative_difference(a, b)
        sizes[0] = 0.0 if a[0] == b[0] else np.inf
        i = int(np.argmax(sizes))
        if sizes[i] > largest.size:
            values = f"{a[i]:.10g} and {b[i]:.10g}"
            if i == 0:
                values = " and ".join(campaign.outcomes.of(np.array([a[0], b[0]], np.int64)))
            inputs = ", ".join(
                f"{key} {value:.6g}"
                for key, value in zip(campaign.inputs, row.tolist(), strict=True)
            )
            description = f"'{name}' returns {labels[i]} {values} for the same inputs ({inputs})"
            largest = Difference(float(sizes[i]), description)
    return largest


def outcome_and_metrics(block: FlightBlock) -> Floats:
    """Return the outcome and metrics of each flight [flight, value]."""
    return np.column_stack([block.outcome.astype(np.float64), block.metrics])


class StoredFlights:
    """Values of the stored flights of each system, some of which the check re-runs."""

    def __init__(self, campaign: Experiment, shard: tuple[int, int]) -> None:
        """Initialize the check of the flights of a shard."""
        first, self._stop = shard
        self._count = max(_LEAST, min(_MOST, (self._stop - first) // _SHARE))
        self._campaign = campaign
        # [flight, value] outcome and metrics
        self._values: dict[str, Floats] = {}

    def add(self, rows: FlightRows) -> None:
        """Record the outcomes and metrics of a block."""
        campaign, metrics = self._campaign, len(self._campaign.measured)
        values = self._values.setdefault(
            rows.controller, np.full((campaign.runs, 1 + metrics), _LOST)
        )
        outcome = [campaign.outcomes.numbers[code] for code in rows.outcome]
        values[rows.flights] = np.column_stack([outcome, rows.values[:, :metrics]])

    def choose(self, counts: FlightCounts) -> Indices:
        """Return the numbers of the flights to re-run: random failures, then the worst flights."""
        values = self._values[counts.controller]
        flights = np.flatnonzero(values[:, 0] != _LOST)
        columns = [metric.name for metric in self._campaign.measured]
        is_failure, rank = np.zeros(flights.size, bool), np.full(flights.size, flights.size)
        for count in counts.requirements:
            severity = count.requirement.limits.worse(
                values[flights, 1 + columns.index(count.requirement.metric)]
            )
            is_failure |= count.missed[flights]
            rank = np.minimum(rank, np.argsort(np.argsort(-severity, kind="stable")))
        order = np.random.default_rng(self._stop).permutation(flights.size)
        chosen = np.lexsort([order, np.where(is_failure, -1, rank)])
        return flights[chosen[: self._count]]

    def run_again(
        self, fly: Fly, workers: int, samples: SampleReader, counts: Mapping[str, FlightCounts]
    ) -> Difference:
        """Re-run flights and return the largest difference from the stored values."""
        campaign = with_proofs(self._campaign, check=-1)
        campaign.simulator.engine.close()  # New processes may need the licences of idle processes.
        calls = [(name, i) for name in self._values for i in self.choose(counts[name]).tolist()]

        def run(name: str, i: int) -> Difference:
            row = samples.rows(i, i + 1)
            again = outcome_and_metrics(simulate(campaign, name, row, None, fly))
            pairs = zip(row, self._values[name][i : i + 1], again, strict=True)
            return find_difference(campaign, name, pairs if again[0, 0] != _LOST else ())

        largest, landed = Difference(), work_ahead(workers, run, calls)
        with Progress("stored flights again", len(calls)) as progress, closing(landed):
            for difference in landed:
                progress.add(1)
                largest = max(largest, difference)
        return largest
