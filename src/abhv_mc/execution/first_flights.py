"""Simulation of first flights, which test dispersions and the simulator's repeatability.

To test repeatability, the flights are simulated in two new processes in parallel, and repeated in
each process. Trial flights are the nominal flight, and trials of each dispersion: a dispersion that
enters no equation of the simulation leaves all bits of a flight unchanged. Before the campaign,
such a dispersion, or a metric that is not finite in the nominal flight, is rejected with an error.
"""

import math
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.execution.executor import (
    FlightRunner,
    open_executor,
    open_threads,
    simulate,
    with_proofs,
)
from abhv_mc.execution.progress import Progress
from abhv_mc.execution.retention import (
    ESTIMATES,
    Difference,
    find_difference,
    outcome_and_metrics,
)
from abhv_mc.execution.retry import time_limit
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.repeatability import ROUNDING, Repeatability
from abhv_mc.io.messages import InputError, InputErrors

_LONG = 1.0  # duration of a flight in s above which each process repeats only one flight
_CHECKED = 8  # number of rows of inputs that are checked
_PAIRS = 4  # maximum number of pairs of processes


class FirstFlights(NamedTuple):
    """Results of the first flights of a campaign."""

    warnings: tuple[str, ...] = ()
    repeatability: Repeatability | None = None
    # [trial] trial flights of each system, the nominal flight first, if flights are repeatable
    trials: Mapping[str, FlightBlock] = MappingProxyType({})


class _Repeats(NamedTuple):
    """Flights of one system in a new process: all rows, then repeated rows in reverse order."""

    rows: Floats  # [flight, input]
    values: Floats  # [flight, value] outcome and metrics
    blocks: tuple[FlightBlock, ...]
    distinct: int  # number of rows before their repetition

    @property
    def lost(self) -> Mask:
        """Whether each flight failed to run."""
        return self.values[:, 0] == Outcome.FAILED_TO_RUN


def fly_first(campaign: Experiment, workers: int | None, every: Mapping[str, int]) -> FirstFlights:
    """Simulate the trials of the dispersions with each system.

    If the simulator does not guarantee that flights are repeatable, the first rows are simulated
    twice. Otherwise, the trials have histories; ``every`` contains the number of control ticks
    between samples by system.
    Raise InputError if no flight of a system can be computed, or if the trials show an error.
    """
    if campaign.simulator.capabilities.is_repeatable:
        return FirstFlights(trials=fly_probes(campaign, every))
    rows = campaign.make_samples().draw(0, min(_CHECKED, campaign.runs))
    with open_executor(campaign.simulator.engine, campaign.model.execution, workers) as executor:
        campaign.simulator.engine.close()  # The check of repeatability needs new processes.
        repeats, warnings = _fly_twice(campaign, executor, rows)
        for name in campaign.systems:
            if all(process.lost.all() for process in repeats[name]):
                reasons = (
                    text
                    for process in repeats[name]
                    for block in process.blocks
                    for text in block.reasons.values()
                )
                reason = next(reasons, "")
                raise campaign.document.key_error(
                    ("simulator",),
                    f"no flight of '{name}' can be computed ({reason})",
                    "a simulator that computes the first flights",
                )
        events = {
            name: sum(
                (Counter(block.events) for process in processes for block in process.blocks),
                Counter(),
            )
            for name, processes in repeats.items()
        }
        repeatability, noise = _judge_repeats(campaign, repeats)
        warnings += noise
        checked = with_proofs(campaign, check=1)
        plans = [system.plan for system in checked.systems.values()]
        if (campaign.simulator.time_of_flight(plans) or 0.0) < _LONG and campaign.dimensions:
            trials = make_trials(campaign)
            with (
                Progress("first flights", len(trials) * len(plans)) as progress,
                open_threads(executor.workers) as threads,
            ):
                flown = []
                for block in threads.map(
                    lambda name: simulate(checked, name, trials, None, executor.fly),
                    campaign.systems,
                ):
                    progress.add(len(block.outcome))
                    flown.append(block)
            warnings += [
                f"'{name}' from {low:g} to {high:g} has no effect on any flight"
                for name, low, high in find_ineffective(campaign, trials, flown)
                if name
                in campaign.names  # Three values cannot prove that an unknown has no effect.
            ]
            for name, block in zip(campaign.systems, flown, strict=True):
                events[name].update(block.events)
        for name, counts in events.items():
            warnings += campaign.simulator.describe_events(name, counts)
    return FirstFlights(tuple(warnings), repeatability)


def _fly_twice(
    campaign: Experiment, executor: FlightRunner, rows: Floats
) -> tuple[dict[str, list[_Repeats]], list[str]]:
    """Simulate each row in two new processes; several pairs of processes may run in parallel.

    Return the flights by system and process, with the two processes of a pair next to each other,
    and warnings about undeclared files that native code reads.
    """
    pairs = max(1, min(executor.workers // 2, _PAIRS, len(rows)))
    total, started = 2 * len(rows) * len(campaign.systems), time.time()

    plan: Any = next(iter(campaign.systems.values())).plan
    native = set[str]()

    def fly(process: int) -> dict[str, _Repeats]:
        own, own_rows = with_proofs(campaign, process + 1), rows[process // 2 :: pairs]
        first = {name: simulate(own, name, own_rows, None, executor.fly) for name in own.systems}
        plans = [system.plan for system in own.systems.values()]
        is_long = (campaign.simulator.time_of_flight(plans) or 0.0) > _LONG
        repeated = own_rows[:1] if is_long else own_rows[::-1]
        if is_long and process > 1:  # One pair of processes shows whether flights are repeatable.
            repeated = own_rows[:0]
        flown = {}
        for name, block in first.items():
            blocks = block, simulate(own, name, repeated, None, executor.fly)
            values = np.concatenate([outcome_and_metrics(block) for block in blocks])
            flown[name] = _Repeats(
                np.concatenate([own_rows, repeated]), values, blocks, len(own_rows)
            )
        progress.add(len(own_rows) * len(own.systems))
        native.update(campaign.simulator.find_undeclared_reads(plan, started))
        if executor.workers == 1:
            # The licence of a simulator may allow only one process at a time.
            campaign.simulator.engine.close()
        return flown

    with (
        Progress("first flights", total) as progress,
        open_threads(min(2 * pairs, executor.workers)) as threads,
    ):
        processes = list(threads.map(fly, range(2 * pairs)))
    for name in campaign.systems:
        for pair in zip(processes[::2], processes[1::2], strict=True):
            _repeat_lost(campaign, executor, name, [process[name] for process in pair])
    warnings = [
        f"native code reads {path}, which 'files' does not list; changes to that file will not be "
        "detected"
        for path in sorted(native)
    ]
    return {name: [process[name] for process in processes] for name in campaign.systems}, warnings


def _repeat_lost(
    campaign: Experiment, executor: FlightRunner, name: str, pair: list[_Repeats]
) -> None:
    """Simulate lost flights again if another attempt computed them, and replace their values."""
    computed = {row.tobytes() for process in pair for row in process.rows[~process.lost]}
    for process in pair:
        for i in np.flatnonzero(process.lost):
            row = process.rows[i]
            if row.tobytes() in computed:
                block = simulate(with_proofs(campaign, 1), name, row[None], None, executor.fly)
                process.values[i] = outcome_and_metrics(block)[0]


def _judge_repeats(
    campaign: Experiment, repeats: dict[str, list[_Repeats]]
) -> tuple[Repeatability, list[str]]:
    """Return the repeatability of the simulator, with warnings."""
    is_declared = campaign.simulator.states_noise
    largest = Difference()
    shared = ""
    for name, processes in repeats.items():
        for pair in zip(processes[::2], processes[1::2], strict=True):
            across = find_difference(campaign, name, _across(*pair))
            within = [find_difference(campaign, name, _within(process)) for process in pair]
            largest = max(largest, across, *within)
            noisy = max(within)
            if across.size <= ROUNDING < noisy.size:
                shared = shared or noisy.description
    if shared and is_declared:
        warning = f"two new processes draw the same noise despite 'repeatable: no': {shared}"
        return Repeatability.SHARED, [f"{warning}; {ESTIMATES}"]
    if is_declared:
        return Repeatability.DECLARED, []
    if largest.size > ROUNDING:
        return Repeatability.NOISE, [f"not repeatable: {largest.description}; {ESTIMATES}"]
    return Repeatability.ROUNDING if largest.size else Repeatability.EXACT, []


def _across(a: _Repeats, b: _Repeats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield each row of inputs with its results in two processes."""
    # If one process was slow, it repeated fewer flights than the other process.
    count = len(a.rows) if len(a.rows) == len(b.rows) else a.distinct
    yield from zip(a.rows[:count], a.values[:count], b.values[:count], strict=True)


def _within(repeats: _Repeats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield each repeated row of inputs with its first and second results in one process."""
    rows, again = repeats.rows[repeats.distinct :], repeats.values[repeats.distinct :]
    first = repeats.values[: repeats.distinct]
    first = first[::-1] if len(again) == len(first) else first[: len(again)]
    yield from zip(rows, first, again, strict=True)


_ROWS = 3  # number of trials for each dispersion
_DEFAULT_LIMIT = 600.0  # default time limit in s for 16 flights
_COMPILING = 1800.0  # time in s allowed for compilation on a busy machine


def make_trials(campaign: Experiment) -> Floats:
    """Return rows [trial, input]: the nominal flight and three trials per dispersion.

    In its three trials, a dispersion has its nominal value, its lower bound and its upper bound.
    All other dispersions are slightly above their medians: the start time of a gust, for example,
    has an effect only if there is a gust, and the median speed of a symmetric gust is zero.
    """
    names = campaign.dimensions
    nominal = campaign.parameters.nominal_of(names)
    quantiles = (
        np.stack([campaign.ends_of(i) for i in range(len(names))])
        if names
        else np.empty((0, _ROWS))
    )
    values = np.tile(quantiles[:, 1], (1 + _ROWS * len(names), 1))
    values[0] = nominal
    for i in range(len(names)):
        values[1 + _ROWS * i : 1 + _ROWS * (i + 1), i] = (
            nominal[i],
            quantiles[i, 0],
            quantiles[i, 2],
        )
    seeds = campaign.parameters.nominal_of(campaign.inputs[len(names) :])
    return np.column_stack([values, np.tile(seeds, (len(values), 1))])


def fly_probes(campaign: Experiment, every: Mapping[str, int]) -> dict[str, FlightBlock]:
    """Simulate the trials with each controller; the first trial is the nominal flight.

    ``every`` contains the number of control ticks between samples of histories by controller.

    Raise InputError if a dispersion has no effect, if a metric is not finite in a nominal flight
    that ends as planned, or if flights exceed the time limit.
    """
    trials = make_trials(campaign)
    flown = {
        name: _fly_temporary(campaign, name, trials, every.get(name, 0))
        for name in campaign.systems
    }
    errors = list(_find_not_finite(campaign, flown))
    for name, low, high in find_ineffective(campaign, trials, flown.values()):
        key = "unknowns" if name in campaign.unknowns.names else "dispersions"
        keys = ("sampling",) if campaign.sample_file is not None else (key, name)
        errors.append(
            campaign.document.key_error(
                keys,
                f"'{name}' from {low:g} to {high:g} has no effect on the flights of any controller",
                "a dispersion that affects this vehicle",
            )
        )
    if errors:
        raise InputErrors(errors)
    return flown


def find_ineffective(
    campaign: Experiment, trials: Floats, flown: Collection[FlightBlock]
) -> Iterator[tuple[str, float, float]]:
    """Yield each dispersion without effect in the trials, with the bounds of its range."""
    for i, name in enumerate(campaign.dimensions):
        unchanged, *rows = range(1 + _ROWS * i, 1 + _ROWS * (i + 1))
        if not any(differs(block, row, unchanged) for block in flown for row in rows):
            yield name, *trials[rows, i].tolist()


def _fly_temporary(campaign: Experiment, name: str, trials: Floats, every: int) -> FlightBlock:
    """Simulate trials without storing them.

    Raise InputError if the trials exceed the time limit, which does not include compilation.
    """
    limit = time_limit(len(trials), campaign.model.execution.flight_time_limit or _DEFAULT_LIMIT)
    try:
        run_in_thread(lambda: simulate(campaign, name, trials[:0], every), _COMPILING)
        return run_in_thread(lambda: simulate(campaign, name, trials, every), limit)
    except TimeoutError:
        problem = f"the trial flights of '{name}' did not end within {limit:g} s"
        expected = "a control law without endless loops, or a longer 'flight_time_limit'"
        raise InputError("controllers", problem, expected) from None


def _find_not_finite(campaign: Experiment, flown: dict[str, FlightBlock]) -> Iterator[InputError]:
    """Yield an error for each metric that is not finite in a nominal flight."""
    reported = set()
    for controller, block in flown.items():
        for metric, value in zip(campaign.measured, block.metrics[0].tolist(), strict=False):
            name = metric.name
            if block.outcome[0] != Outcome.OK or math.isfinite(value) or name in reported:
                continue
            reported.add(name)
            number = "not a number" if math.isnan(value) else value
            problem = f"'{name}' is {number} in the nominal flight of '{controller}'"
            expected = (
                "a finite number at each tick of its window ('empty' sets the value for an empty "
                "window)"
            )
            if "heat_flux" in metric.of:
                expected = f"reference.nose_radius in the vehicle file, or {expected}"
            yield campaign.document.key_error(("metrics", name), problem, expected)


def differs(block: FlightBlock, a: int, b: int) -> bool:
    """Return whether two flights of a block differ in any bit of outcome, end time or metrics."""
    values = np.column_stack([block.metrics, block.end_time])
    return not (
        np.array_equal(values[a], values[b], equal_nan=True)
        and block.outcome[a] == block.outcome[b]
    )
