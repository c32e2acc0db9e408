"""Storage of selected flights' time histories, which happens at the end of a campaign.

The selected flights are run again, because the worst flights are known only at the end. The
repeated flights are bit-identical.
"""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import simulate, work_ahead
from abhv_mc.execution.flight_counts import FlightCounts
from abhv_mc.execution.progress import Progress
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.controller_flights import read_worst
from abhv_mc.folder.hashes import KEY, FileHashes, Product
from abhv_mc.folder.histories import write_histories
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.samples import SampleReader
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
