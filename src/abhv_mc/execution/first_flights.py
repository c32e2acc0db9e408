"""First flights of a user's simulator: whether it flies, how long that takes, and whether it gives the same again.

They fly in the workers, side by side. Where a flight takes long they are the campaign's first rows alone.
"""

from collections import Counter
from dataclasses import replace
from typing import Any, cast

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import open_executor, open_threads
from abhv_mc.execution.probe_dispersions import make_trials, unchanging
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.simulators.engine import Engine, simulate
from abhv_mc.simulators.user_simulator.user_flights import describe_events, seconds_of_a_flight

_LONG = 1.0  # s: flights that take longer are not flown for a check alone


def fly_first(campaign: Experiment, engine: Engine, workers: int | None) -> list[str]:
    """Fly the campaign's first two rows and the trials of its dispersions, with each system; what to say of them.

    Raises InputError where no flight of a system can be computed.
    """
    checks = {
        name: each._replace(plan=replace(cast("Any", each.plan), check=True, is_proven=True))
        for name, each in campaign.systems.items()
    }
    campaign = replace(campaign, systems=checks)
    rows = campaign.make_samples().draw(0, min(2, campaign.runs))
    systems = list(campaign.systems)
    plans = [system.plan for system in campaign.systems.values()]
    told: list[str] = []
    events: dict[str, Counter[str]] = {name: Counter() for name in systems}
    with open_executor(engine, campaign.model.execution, workers, None) as executor:

        def fly(jobs: list[tuple[str, Floats]]) -> list[FlightBlock]:
            with (
                Progress("first flights", sum(len(given) for _, given in jobs)) as progress,
                open_threads(executor.workers) as threads,
            ):
                blocks = []
                for block in threads.map(
                    lambda job: simulate(campaign, job[0], job[1], None, executor.fly), jobs
                ):
                    progress.add(len(block.outcome))
                    blocks.append(block)
                for (name, _), block in zip(jobs, blocks, strict=True):
                    events[name].update(block.events)
                return blocks

        pairs = fly([(name, given) for name in systems for given in (rows, rows[::-1])])
        for name, there, back in zip(systems, pairs[::2], pairs[1::2], strict=True):
            if (np.append(there.outcome, back.outcome) == Outcome.FAILED_TO_RUN).all():
                found = f"no flight of '{name}' that can be computed (why stands above)"
                raise campaign.document.key_error(
                    ("simulator",), found, "a simulator that flies the first rows"
                )
            told += _not_repeatable(campaign, name, there, back)
        if seconds_of_a_flight(plans) < _LONG and campaign.dimensions:
            trials = make_trials(campaign)
            flown = fly([(name, trials) for name in systems])
            told += [
                f"'{name}' from {low:g} to {high:g} changes no flight"
                for name, low, high in unchanging(campaign, trials, flown)
            ]
    told += [words for name in systems for words in describe_events(name, events[name])]
    return told


def _not_repeatable(
    campaign: Experiment, name: str, there: FlightBlock, back: FlightBlock
) -> list[str]:
    """What differs of flights that were flown twice, in swapped order; of those that were computed twice."""
    for row, other in enumerate(reversed(range(len(there.outcome)))):
        if Outcome.FAILED_TO_RUN in (there.outcome[row], back.outcome[other]):
            continue
        for i, metric in enumerate(campaign.measured):
            values = there.metrics[row, i], back.metrics[other, i]
            if not np.array_equal(*values, equal_nan=True):
                words = f"{metric.name} {values[0]:g} and {values[1]:g}"
                return [
                    f"not repeatable: flight {row} of '{name}' gives {words} of the same inputs"
                ]
    return []
