"""First flights of a user's simulator: whether it runs, how long that takes, and whether it is repeatable.

They are simulated twice, each time in a new process, and a second time within each process.
"""

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import FlightRunner, open_executor, open_threads
from abhv_mc.execution.probe_dispersions import make_trials, unchanging
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.flight.repeatability import ROUNDING, Repeatability, relative_difference
from abhv_mc.simulators.engine import simulate

_LONG = 1.0  # s: of flights that take longer only one is repeated within a process
_CHECKED = 8  # rows that are simulated again
_PAIRS = 4  # of new processes at most, among which these rows are divided


class FirstFlights(NamedTuple):
    """What the first flights of a campaign show."""

    warnings: tuple[str, ...] = ()
    repeatability: Repeatability | None = None


class _Repeats(NamedTuple):
    """The flights of one system in one new process: all rows, then some of them again in the opposite order."""

    rows: Floats
    first: FlightBlock
    again: FlightBlock

    @property
    def again_rows(self) -> Floats:
        """The rows that were simulated again, in their order."""
        count = len(self.again.outcome)
        return self.rows[::-1] if count == len(self.rows) else self.rows[:count]


class _Difference(NamedTuple):
    """The largest relative difference between flights of the same inputs."""

    size: float = 0.0
    words: str = ""


def fly_first(campaign: Experiment, workers: int | None) -> FirstFlights:
    """Simulate the campaign's first rows and the trials of its dispersions, with each system.

    Raises InputError if no flight of a system can be computed.
    """
    rows = campaign.make_samples().draw(0, min(_CHECKED, campaign.runs))
    with open_executor(campaign.simulator.engine, campaign.model.execution, workers) as executor:
        _end_processes(campaign)  # those of an earlier campaign: a check needs new ones
        repeats, warnings = _fly_twice(campaign, executor, rows)
        for name in campaign.systems:
            blocks = [each.first for each in repeats[name]]
            if all((block.outcome == Outcome.FAILED_TO_RUN).all() for block in blocks):
                reason = next((text for each in blocks for text in each.reasons.values()), "")
                found = f"no flight of '{name}' that can be computed: {reason}"
                wish = "a simulator that flies the first rows"
                raise campaign.document.key_error(("simulator",), found, wish)
        events = {
            name: sum((Counter(block.events) for _, *pair in each for block in pair), Counter())
            for name, each in repeats.items()
        }
        repeatability, noise = _judge_repeats(campaign, repeats)
        warnings += noise
        plans = [system.plan for system in _checked(campaign).systems.values()]
        if (campaign.simulator.time_of_flight(plans) or 0.0) < _LONG and campaign.dimensions:
            trials = make_trials(campaign)
            with (
                Progress("first flights", len(trials) * len(plans)) as progress,
                open_threads(executor.workers) as threads,
            ):
                flown = []
                for block in threads.map(
                    lambda name: simulate(_checked(campaign), name, trials, None, executor.fly),
                    campaign.systems,
                ):
                    progress.add(len(block.outcome))
                    flown.append(block)
            warnings += [
                f"'{name}' from {low:g} to {high:g} changes no flight"
                for name, low, high in unchanging(campaign, trials, flown)
                if name in campaign.names  # three values do not show that an unknown has no effect
            ]
            for name, block in zip(campaign.systems, flown, strict=True):
                events[name].update(block.events)
        for name, counts in events.items():
            warnings += campaign.simulator.describe_events(name, counts)
    return FirstFlights(tuple(warnings), repeatability)


def _end_processes(campaign: Experiment) -> None:
    if campaign.simulator.engine.close is not None:
        campaign.simulator.engine.close()


def _checked(campaign: Experiment, process: int = 1) -> Experiment:
    """Return the campaign with plans for checks, whose flights have a process of this number for themselves."""
    systems = {
        name: each._replace(plan=campaign.simulator.prove(each.plan, check=process))
        for name, each in campaign.systems.items()
    }
    return replace(campaign, systems=systems)


def _fly_twice(
    campaign: Experiment, executor: FlightRunner, rows: Floats
) -> tuple[dict[str, list[_Repeats]], list[str]]:
    """Simulate ``rows`` in pairs of new processes at the same time; return the flights by system, pairs side by side,
    and warnings of files that native code reads."""
    pairs = max(1, min(executor.workers // 2, _PAIRS, len(rows)))
    total, started = 2 * len(rows) * len(campaign.systems), time.time()

    plan: Any = next(iter(campaign.systems.values())).plan
    native = set[str]()

    def fly(process: int) -> dict[str, _Repeats]:
        own, given = _checked(campaign, process + 1), rows[process // 2 :: pairs]
        first = {name: simulate(own, name, given, None, executor.fly) for name in own.systems}
        plans = [system.plan for system in own.systems.values()]
        is_long = (campaign.simulator.time_of_flight(plans) or 0.0) > _LONG
        order = given[:1] if is_long else given[::-1]
        if is_long and process > 1:  # one process of each system shows whether flights repeat
            order = given[:0]
        again = {name: simulate(own, name, order, None, executor.fly) for name in own.systems}
        progress.add(len(given) * len(own.systems))
        native.update(campaign.simulator.find_undeclared_reads(plan, started))
        if executor.workers == 1:  # there may be a licence for one process
            _end_processes(campaign)
        return {name: _Repeats(given, first[name], again[name]) for name in own.systems}

    with (
        Progress("first flights", total) as progress,
        open_threads(min(2 * pairs, executor.workers)) as threads,
    ):
        found = list(threads.map(fly, range(2 * pairs)))
    warnings = [
        f"native code keeps {path} open, which 'files' does not name: nobody will see if it changes"
        for path in sorted(native)
    ]
    return {name: [each[name] for each in found] for name in campaign.systems}, warnings


def _judge_repeats(
    campaign: Experiment, repeats: dict[str, list[_Repeats]]
) -> tuple[Repeatability, list[str]]:
    """Return how repeatable the simulator is, and warnings."""
    is_declared = campaign.simulator.states_noise
    largest = _Difference()
    shared = ""
    for name, processes in repeats.items():
        for one, other in zip(processes[::2], processes[1::2], strict=True):
            across = _compare(campaign, name, _across(one, other))
            within = [_compare(campaign, name, _within(each)) for each in (one, other)]
            largest = max(largest, across, *within)
            noisy = max(within)
            if across.size <= ROUNDING < noisy.size:
                shared = shared or noisy.words
    if shared and is_declared:
        words = (
            f"two new processes draw the same noise, although 'repeatable: no' is stated: {shared}"
        )
        return Repeatability.SHARED, [f"{words}; verdicts are estimates"]
    if is_declared:
        return Repeatability.DECLARED, []
    if largest.size > ROUNDING:
        return Repeatability.NOISE, [f"not repeatable: {largest.words}; verdicts are estimates"]
    return Repeatability.ROUNDING if largest.size else Repeatability.EXACT, []


def _across(one: _Repeats, other: _Repeats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield a row and its values in two processes."""
    yield from zip(one.rows, _values(one.first), _values(other.first), strict=True)
    if len(one.again.outcome) == len(other.again.outcome):  # else one of them was slow
        again = _values(one.again), _values(other.again)
        yield from zip(one.again_rows, *again, strict=True)


def _within(repeats: _Repeats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield a row and its values when it was simulated first and again in one process."""
    first, again = _values(repeats.first), _values(repeats.again)
    first = first[::-1] if len(again) == len(first) else first[: len(again)]
    yield from zip(repeats.again_rows, first, again, strict=True)


def _compare(
    campaign: Experiment, name: str, pairs: Iterable[tuple[Floats, Floats, Floats]]
) -> _Difference:
    """Return the largest difference; another outcome differs infinitely."""
    largest, labels = _Difference(), ("outcome", *(metric.name for metric in campaign.measured))
    for row, a, b in pairs:
        sizes = relative_difference(a, b)
        sizes[0] = 0.0 if a[0] == b[0] else np.inf
        at = int(np.argmax(sizes))
        if sizes[at] > largest.size:
            values = f"{a[at]:.10g} and {b[at]:.10g}"
            if at == 0:
                values = " and ".join(campaign.outcomes.of(np.array([a[0], b[0]], np.int64)))
            given = ", ".join(
                f"{key} {value:.6g}"
                for key, value in zip(campaign.inputs, row.tolist(), strict=True)
            )
            words = f"'{name}' gives {labels[at]} {values} of the same inputs ({given})"
            largest = _Difference(float(sizes[at]), words)
    return largest


def _values(block: FlightBlock) -> Floats:
    """Return the outcome and the metrics of each flight [flight, value]."""
    return np.column_stack([block.outcome.astype(np.float64), block.metrics])
