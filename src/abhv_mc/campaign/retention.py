"""Which flights are kept at full length, and how: flown once more when all have flown.

The worst are known only then. Flying a flight again gives the same bits, which is checked against its row.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.batches import Fly
from abhv_mc.campaign.check import CheckedCampaign
from abhv_mc.campaign.progress import Progress
from abhv_mc.campaign.samples import spread_parameters
from abhv_mc.campaign.tally import Tally
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.histories import history_metadata, write_histories
from abhv_mc.store.samples import SampleReader

_FLIGHTS_PER_FILE = 128


def choose_kept(items: tuple[int | str, ...], flights: int, tally: Tally) -> list[int]:
    """Numbers of the flights that ``items`` of the campaign's ``keep`` name, ascending."""
    kept: set[int] = set()
    for item in items:
        words = str(item).split()
        if isinstance(item, int):
            kept.update({item} & set(range(flights)))  # a campaign may have stopped before it
        elif item == "all":
            kept.update(range(flights))
        elif item == "failed":
            kept.update(tally.failed)
        elif words[0] == "every":
            kept.update(range(0, flights, int(words[1])))
        elif words[0] == "worst":
            kept.update(tally.worst_flights[: int(words[1])])
    return sorted(kept - set(tally.not_computed))


def write_kept_histories(
    folder: CampaignFolder,
    campaign: CheckedCampaign,
    plans: Mapping[str, FlightPlan],
    tallies: Mapping[str, Tally],
    samples: SampleReader,
    fly: Fly,
    workers: int = 1,
) -> None:
    """Fly and write the histories that the campaign keeps; files that are there already stay."""
    from joblib import Parallel, delayed

    keep = campaign.model.keep.histories
    wanted: list[tuple[Path, str, list[int]]] = []
    for name in plans:
        kept = choose_kept(keep.flights, campaign.runs, tallies[name])
        for part, first in enumerate(range(0, len(kept), _FLIGHTS_PER_FILE)):
            path = folder.histories / f"{name}-{part:06d}.parquet"
            wanted.append((path, name, kept[first : first + _FLIGHTS_PER_FILE]))
    stale = set(folder.histories.glob("*.parquet")) - {path for path, _, _ in wanted}
    missing = [(p, n, f) for p, n, f in wanted if history_metadata(p).get("kept") != _mark(f, keep.channels, keep.rate)]
    pool = Parallel(n_jobs=workers, backend="threading", return_as="generator", pre_dispatch="n_jobs")
    tasks = (
        delayed(fly)(plans[name], _parameters(samples, flights), round(1.0 / (keep.rate * plans[name].timing.tick)))
        for _, name, flights in missing
    )
    with Progress("histories", sum(len(flights) for _, _, flights in missing)) as progress:
        for (path, name, flights), block in zip(missing, pool(tasks), strict=True):
            mark = {"kept": _mark(flights, keep.channels, keep.rate)}
            write_histories(path, name, flights, block.times, block.history, keep.channels, mark)
            progress.add(len(flights))
    for path in stale:
        path.unlink()


def _parameters(samples: SampleReader, flights: list[int]) -> NDArray[np.float64]:
    values = np.concatenate([samples.rows(flight, flight + 1) for flight in flights])
    return spread_parameters(samples.names, values)


def _mark(flights: list[int], channels: tuple[str, ...], rate: float) -> str:
    return hashlib.sha256(repr((flights, channels, rate)).encode()).hexdigest()
