"""Completion of a campaign: the numbers of stored flights and the missing flights."""

import numpy as np

from abhv_mc.array_types import Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.flight_counts import FlightCounts, judge_counts, make_flight_counts
from abhv_mc.folder.envelope_states import Collector
from abhv_mc.folder.flights import Digest, FlightRows
from abhv_mc.statistics.evidence import flights_to_pass

_FIRST_JUDGED = 64  # number of flights before the first assessment in a campaign with 'stop'


class Completion:
    """Counts of the stored flights of each controller."""

    def __init__(
        self, campaign: Experiment, shard: tuple[int, int], requested: tuple[str, ...]
    ) -> None:
        """Initialize the counts to zero.

        ``shard`` is the range of flights in the folder; ``requested`` lists the controllers to run.
        """
        self.campaign, self.requested = campaign, requested
        self.first, self.stop = shard
        self.all_counts: dict[str, FlightCounts] = make_flight_counts(campaign)
        self.done = {name: np.zeros(campaign.runs, bool) for name in self.all_counts}

    def add(self, rows: FlightRows, digest: Digest) -> None:
        """Add the flights of a block to the counts."""
        self.all_counts[rows.controller].add(rows, digest)
        self.done[rows.controller][rows.first : rows.stop] = True

    def goal(self) -> int:
        """Return the number of flights to run.

        A campaign that stops as soon as all verdicts are PASS or FAIL needs only the flights up to
        this point. The numbers of flights at which verdicts are assessed depend only on the flights
        themselves, not on workers or interruptions.
        """
        if self.campaign.model.stop is None:
            return self.stop
        points = len(self.campaign.unknowns.points)
        gapless = int(min(np.argmin(np.append(mask, False)) for mask in self.done.values()))
        goal = min(points * _FIRST_JUDGED, self.stop)
        while goal <= gapless and goal < self.stop:
            verdicts = [
                v
                for _, count, v, _ in judge_counts(self.all_counts, self.campaign, goal)
                if count.binds
            ]
            unproven = [verdict for verdict in verdicts if verdict.status == "NOT SHOWN"]
            if not unproven:
                return max(goal, gapless)
            next_pass = min(
                points * flights_to_pass(v.failures, v.probability, v.consumer_risk)
                for v in unproven
            )
            goal = min(max(next_pass, goal + goal // (10 * points) * points), 2 * goal, self.stop)
        return goal

    def is_complete(self) -> bool:
        """Return whether all flights up to the number returned by :meth:`goal` are stored."""
        goal = self.goal()
        return all(mask[self.first : goal].all() for mask in self.done.values())

    def find_missing(self, collectors: dict[str, Collector]) -> dict[str, tuple[Mask, Mask]]:
        """Return masks [flight] of missing rows and envelope contributions, by controller.

        Only flights up to the number returned by :meth:`goal` are considered. The result is an
        empty dictionary if no data is missing.
        """
        missing = {}
        numbers = np.arange(self.campaign.runs)
        below = (numbers >= self.first) & (numbers < self.goal())
        for name, done in self.done.items():
            # Envelopes include completed flights of all controllers.
            expected = ~done & below & (name in self.requested)
            # Flights that were not computed do not contribute to envelopes.
            computed = ~self.all_counts[name].uncomputed
            uncovered = (
                ~collectors[name].covered if name in collectors else np.zeros(len(done), bool)
            )
            missing[name] = expected, uncovered & (done & computed | expected)
        return missing if any(mask.any() for masks in missing.values() for mask in masks) else {}
