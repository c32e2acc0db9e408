"""What a campaign's folder holds of its flights, and what it lacks."""

from collections.abc import Iterator

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.execution.blocks import Mask
from abhv_mc.execution.flight_counts import FlightCounts, judge_counts, make_flight_counts
from abhv_mc.folder.digest import Digest
from abhv_mc.folder.envelope_states import Collector
from abhv_mc.folder.flights import DamagedFileError, FlightRows, parse_block_name, read_block
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.samples import SampleReader
from abhv_mc.folder.table_check import check_table
from abhv_mc.io.input_error import InputError
from abhv_mc.statistics.evidence import flights_to_pass

_FIRST_JUDGED = 64  # flights after which a campaign that stops when proven is judged for the first time


class Completion:
    """The flights of a folder, counted: those that are done, and those that could not be computed."""

    def __init__(self, campaign: CheckedCampaign, part: tuple[int, int], asked: tuple[str, ...]) -> None:
        """``part``: first flight of this folder's shard and the one after its last; ``asked``: controllers to fly."""
        self.campaign, self.asked = campaign, asked
        self.first, self.stop = part
        self.all_counts: dict[str, FlightCounts] = make_flight_counts(campaign)
        self.done = {name: np.zeros(campaign.runs, bool) for name in self.all_counts}
        self.tried = {name: np.zeros(campaign.runs, bool) for name in self.all_counts}  # a second time
        self.left: dict[str, Mask] = {}  # what an earlier run could not compute

    def count(self, blocks: Iterator[FlightRows]) -> None:
        """Begin anew with these."""
        self.all_counts = make_flight_counts(self.campaign)
        for flown in self.done.values():
            flown[:] = False
        for rows in blocks:
            self.add(rows, rows.digest())

    def add(self, rows: FlightRows, digest: Digest) -> None:
        """Count a block."""
        self.all_counts[rows.controller].add(rows, digest)
        self.done[rows.controller][rows.first : rows.stop] = True

    def goal(self) -> int:
        """Number of flights to have: all, or as many as a campaign that stops when proven needs for its verdicts.

        It is judged after numbers of flights that follow from its flights alone: not from workers or interruptions.
        """
        if self.campaign.model.stop is None:
            return self.stop
        there = int(min(np.argmin(np.append(mask, False)) for mask in self.done.values()))
        goal = min(_FIRST_JUDGED, self.stop)
        while goal <= there and goal < self.stop:
            verdicts = [v for _, count, v in judge_counts(self.all_counts, self.campaign, goal) if count.binds]
            left = [verdict for verdict in verdicts if verdict.status == "NOT SHOWN"]
            if not left:
                return max(goal, there)
            next_pass = min(flights_to_pass(v.failures, v.probability, v.consumer_risk) for v in left)
            goal = min(max(next_pass, goal + goal // 10), 2 * goal, self.stop)
        return goal

    def to_retry(self) -> dict[str, list[int]]:
        """Flights that earlier runs could not compute, and that this one has not tried again."""
        due = {
            name: counts.uncomputed & self.left[name] & ~self.tried[name] for name, counts in self.all_counts.items()
        }
        return {name: np.flatnonzero(mask).tolist() for name, mask in due.items() if name in self.asked}

    def whole(self) -> bool:
        goal = self.goal()
        return all(mask[self.first : goal].all() for mask in self.done.values())

    def find_missing(self, collectors: dict[str, Collector]) -> dict[str, tuple[Mask, Mask]]:
        """Rows and parts of the envelopes that are missing up to the goal, by controller; empty when none is."""
        missing = {}
        numbers = np.arange(self.campaign.runs)
        below = (numbers >= self.first) & (numbers < self.goal())
        for name, done in self.done.items():
            wanted = ~done & below & (name in self.asked)  # what was flown and is in no envelope is wanted anyhow
            computed = ~self.all_counts[name].uncomputed  # the others have nothing for the envelopes
            missing[name] = wanted, ~collectors[name].covered & (done & computed | wanted)
        return missing if any(mask.any() for masks in missing.values() for mask in masks) else {}


def find_blocks(
    folder: CampaignFolder,
    controllers: tuple[str, ...],
    runs: int,
    samples: SampleReader,
    columns: tuple[str, ...],
    files: FileHashes,
) -> Iterator[FlightRows]:
    """The sound blocks; what is damaged, foreign or double gets a name that hides it from readers of the folder."""
    flown = {name: np.zeros(runs, bool) for name in controllers}
    for path in sorted(folder.flights.glob("*.parquet")):
        try:
            controller, first, stop = parse_block_name(path)
            mask = flown.get(controller)
            if mask is None or stop > runs or mask[first:stop].any():
                raise DamagedFileError(f"{path.name} belongs to no part of this campaign")
            if files.knows(path) and not files.holds(path):
                raise DamagedFileError(f"{path.name} is not as it was written")
            check_table(path)
            rows = read_block(path, samples.names)
            if rows.columns != columns:
                raise DamagedFileError(f"{path.name} holds other metrics")
            if not np.array_equal(rows.samples, samples.rows(first, stop)):
                raise DamagedFileError(f"{path.name} was flown on other samples")
        except (DamagedFileError, InputError):
            path.rename(path.with_name(f"_{path.name}.damaged"))
            files.forget(path)
            continue
        if not files.knows(path):  # it landed after the last manifest, and holds what it says
            files.note(path, hash_file(path))
        mask[first:stop] = True
        yield rows
