"""Check of the stored flights of a custom simulator: some flights are re-run.

The first flights of a campaign reveal only the noise of a simulator. Re-running stored flights at
the end of a run also reveals files that changed later and workers that disturbed each other.
"""

from collections.abc import Iterator
from contextlib import closing

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.backpressure import work_ahead
from abhv_mc.execution.flight_differences import (
    Difference,
    find_difference,
    outcome_and_metrics,
)
from abhv_mc.execution.progress import Progress
from abhv_mc.execution.simulation import simulate
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import FlightRows
from abhv_mc.interfaces import Fly

# One of 50 stored flights is re-run, but at least 4 and at most 64 flights in total.
_LEAST, _MOST, _SHARE = 4, 64, 50


class StoredFlights:
    """Inputs and values of the flights of each system that the check re-runs."""

    def __init__(self, campaign: Experiment, shard: tuple[int, int]) -> None:
        """Choose random flights of a shard; extending a campaign changes the choice."""
        first, stop = shard
        self._campaign = campaign
        count = min(stop - first, max(_LEAST, min(_MOST, (stop - first) // _SHARE)))
        generator = np.random.default_rng(stop)
        self._numbers = first + generator.choice(stop - first, count, replace=False)
        self._rows: dict[str, list[tuple[Floats, Floats]]] = {}

    def add(self, rows: FlightRows) -> None:
        """Record the inputs and values of the chosen flights of a block."""
        campaign, stored = self._campaign, self._rows.setdefault(rows.controller, [])
        is_inside = (self._numbers >= rows.first) & (self._numbers < rows.stop)
        for i in (self._numbers[is_inside] - rows.first).tolist():
            outcome = campaign.outcomes.numbers[rows.outcome[i]]
            if outcome != Outcome.FAILED_TO_RUN:
                metrics = rows.values[i, : len(campaign.measured)]
                stored.append((rows.samples[i], np.append(float(outcome), metrics)))

    def run_again(self, fly: Fly, workers: int) -> Difference:
        """Re-run the chosen flights and return the largest difference from the stored values."""
        calls = [(name, i) for name, rows in self._rows.items() for i in range(len(rows))]

        def run(name: str, i: int) -> Difference:
            row, values = self._rows[name][i]
            block = simulate(self._campaign, name, row[None], None, fly)
            computed = block.outcome[0] != Outcome.FAILED_TO_RUN
            pairs = [(row, values, outcome_and_metrics(block)[0])] if computed else []
            return find_difference(self._campaign, name, pairs)

        def differences() -> Iterator[Difference]:
            landed = work_ahead(workers, run, calls)
            with Progress("stored flights again", len(calls)) as progress, closing(landed):
                for difference in landed:
                    progress.add(1)
                    yield difference

        return max(differences(), default=Difference())
