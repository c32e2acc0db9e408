"""Trial flights before a campaign: the nominal flight, and trials of each dispersion.

A dispersion that enters no equation of the simulation leaves all bits of a flight unchanged. Before
the campaign, such a dispersion is rejected with an error. A metric that is not finite in the
nominal flight is rejected too.
"""

import math
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.execution.retry import time_limit
from abhv_mc.execution.simulation import simulate
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.documents import InputError, InputErrors

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
        problem = (
            f"'{name}' from {low:g} to {high:g} has no effect on the flights of any controller"
        )
        expected = "a dispersion that affects this vehicle"
        errors.append(campaign.document.key_error(keys, problem, expected))
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
