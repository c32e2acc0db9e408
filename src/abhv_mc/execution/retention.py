"""Which flights are kept at full length, and how: flown once more when all have flown.

The worst are known only then, and flying a flight again gives the same bits.
"""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.backpressure import work_ahead
from abhv_mc.execution.flight_counts import FlightCounts
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.folder.controller_flights import read_worst
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.histories import write_histories
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.products import KEY, Product
from abhv_mc.folder.samples import SampleReader
from abhv_mc.interfaces import Fly
from abhv_mc.simulators.engine import simulate

_FLIGHTS_PER_FILE = 128
_UNCOMPUTED = Outcome.FAILED_TO_RUN.code


def choose_kept(
    items: tuple[int | str, ...], flights: int, counts: FlightCounts, worst: Sequence[int] = ()
) -> list[int]:
    """Numbers of the flights that ``items`` of the campaign's ``keep`` name, ascending; ``worst`` first."""
    kept: set[int] = set()
    for item in items:
        words = str(item).split()
        if isinstance(item, int):
            kept.update({item} & set(range(flights)))  # a campaign may have stopped before it
        elif item == "all":
            kept.update(range(flights))
        elif item == "failed":
            kept.update(counts.failed)
        elif words[0] == "every":
            kept.update(range(0, flights, int(words[1])))
        elif words[0] == "worst":
            kept.update(worst[: int(words[1])])
    return sorted(kept - set(counts.not_computed))


@dataclass(frozen=True)
class HistoryFile:
    """A file of histories that the campaign keeps."""

    product: Product
    controller: str
    flights: list[int]


def list_histories(
    folder: CampaignFolder,
    campaign: Experiment,
    all_counts: Mapping[str, FlightCounts],
) -> list[HistoryFile]:
    """The files that the histories of all flights, which have flown, are kept in."""
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
        kept = choose_kept(keep.flights, campaign.runs, counts, worst.get(name, ()))
        for part, first in enumerate(range(0, len(kept), _FLIGHTS_PER_FILE)):
            flights = kept[first : first + _FLIGHTS_PER_FILE]
            key = hashlib.sha256(
                repr((flights, campaign.kept_channels, keep.rate)).encode()
            ).hexdigest()
            path = folder.histories / f"{name}-{part:06d}.parquet"
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
    """Fly and write the ``expected`` files of histories; those that are there already stay, and no other. What failed,
    in words."""
    missing = [file for file in expected if not file.product.is_current(hashes)]

    def fly_again(file: HistoryFile) -> tuple[HistoryFile, FlightBlock]:
        name = file.controller
        every = campaign.simulator.find_stride(campaign.systems[name].plan, "histories")
        rows = np.concatenate([samples.rows(flight, flight + 1) for flight in file.flights])
        return file, simulate(campaign, name, rows, every, fly)

    total = sum(len(file.flights) for file in missing)
    failed = []
    landed = work_ahead(workers, fly_again, ((file,) for file in missing))
    with Progress("histories", total) as progress, closing(landed):
        for file, block in landed:
            lost = block.outcome == Outcome.FAILED_TO_RUN  # it flew the first time
            failed += [
                f"no history of flight {file.flights[row]} of {file.controller}"
                f" ({block.reasons.get(row, 'it failed to run')})"
                for row in np.flatnonzero(lost).tolist()
            ]
            metadata = {KEY: "incomplete" if lost.any() else file.product.key}
            of = file.product.path, file.controller, file.flights, block.times, block.history
            write_histories(
                *of,
                channels=campaign.kept_channels,
                metadata=metadata,
                recorded=campaign.channels,
            )
            progress.add(len(file.flights))
    for path in set(folder.histories.glob("*.parquet")) - {file.product.path for file in expected}:
        path.unlink()
        hashes.forget(path)
    return failed
