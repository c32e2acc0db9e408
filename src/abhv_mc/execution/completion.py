"""What a campaign's folder holds of its flights, and what it lacks."""

import numpy as np

from abhv_mc.array_types import Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.flight_counts import FlightCounts, judge_counts, make_flight_counts
from abhv_mc.folder.envelope_states import Collector
from abhv_mc.folder.flights import Digest, FlightRows
from abhv_mc.statistics.evidence import flights_to_pass

_FIRST_JUDGED = (
    64  # flights after which a campaign that stops when proven is judged for the first time
)


class Completion:
    """The flights that a folder holds, counted; what is not among them is missing."""

    def __init__(
        self, campaign: Experiment, part: tuple[int, int], to_fly: tuple[str, ...]
    ) -> None:
        """``part``: first flight of this folder's shard and the one after its last; ``to_fly``: controllers to fly."""
        self.campaign, self.to_fly = campaign, to_fly
        self.first, self.stop = part
        self.all_counts: dict[str, FlightCounts] = make_flight_counts(campaign)
        self.done = {name: np.zeros(campaign.runs, bool) for name in self.all_counts}

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
        points = len(self.campaign.unknowns.points)
        there = int(min(np.argmin(np.append(mask, False)) for mask in self.done.values()))
        goal = min(points * _FIRST_JUDGED, self.stop)
        while goal <= there and goal < self.stop:
            verdicts = [
                v
                for _, count, v, _ in judge_counts(self.all_counts, self.campaign, goal)
                if count.binds
            ]
            left = [verdict for verdict in verdicts if verdict.status == "NOT SHOWN"]
            if not left:
                return max(goal, there)
            next_pass = min(
                points * flights_to_pass(v.failures, v.probability, v.consumer_risk) for v in left
            )
            goal = min(max(next_pass, goal + goal // (10 * points) * points), 2 * goal, self.stop)
        return goal

    def whole(self) -> bool:
        goal = self.goal()
        return all(mask[self.first : goal].all() for mask in self.done.values())

    def find_missing(self, collectors: dict[str, Collector]) -> dict[str, tuple[Mask, Mask]]:
        """Rows and parts of the envelopes that are missing up to the goal, by controller; empty when none is."""
        missing = {}
        numbers = np.arange(self.campaign.runs)
        below = (numbers >= self.first) & (numbers < self.goal())
        for name, done in self.done.items():
            expected = (
                ~done & below & (name in self.to_fly)
            )  # what was flown and is in no envelope is wanted anyhow
            computed = ~self.all_counts[
                name
            ].uncomputed  # the others have nothing for the envelopes
            wanted = ~collectors[name].covered if name in collectors else np.zeros(len(done), bool)
            missing[name] = expected, wanted & (done & computed | expected)
        return missing if any(mask.any() for masks in missing.values() for mask in masks) else {}
