"""Trial flights before a campaign: the nominal one, and a sensitivity check of every dispersion.

A dispersion that reaches no equation gives the same flight to the last bit; it is refused before anything is flown,
so that no campaign silently varies nothing. So is a metric of a quantity that the vehicle does not have.
"""

import math
from collections.abc import Collection, Iterator

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.retry import time_limit
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.io.documents import InputError, InputErrors
from abhv_mc.simulators.engine import simulate
from abhv_mc.user_code.child import run_in_thread

_ROWS = 3  # trials of each dispersion
_USUAL = 600.0  # s for 16 flights where the campaign gives no limit
_COMPILING = 1800.0  # s at most, before they fly: on a busy machine more than 600 were seen


def make_trials(campaign: Experiment) -> Floats:
    """Rows [trial, input]: the nominal flight, then for each dispersion its nominal value and both ends of its range.

    The others stand a little above their middles meanwhile: a gust's start matters only where there is a gust, and a
    gust that blows either way alike has none in its middle.
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


def fly_probes(campaign: Experiment, every: int) -> dict[str, FlightBlock]:
    """Fly the trials of every controller; the first flight of each block is the nominal one.

    Raises InputError for a dispersion that changes no controller's flight, for a metric that is no finite number in a
    nominal flight that ends as planned, and where flights do not end.
    """
    trials = make_trials(campaign)
    limit = _COMPILING + time_limit(
        len(trials), campaign.model.execution.flight_time_limit or _USUAL
    )
    flown = {
        name: _fly_temporary(campaign, name, trials, every, limit) for name in campaign.systems
    }
    errors = list(_find_not_finite(campaign, flown))
    for name, low, high in unchanging(campaign, trials, flown.values()):
        key = "unknowns" if name in campaign.unknowns.names else "dispersions"
        where = ("sampling",) if campaign.sample_file is not None else (key, name)
        found = f"'{name}' from {low:g} to {high:g}, which changes no controller's flight"
        errors.append(
            campaign.document.key_error(where, found, "a dispersion that matters to this vehicle")
        )
    if errors:
        raise InputErrors(errors)
    return flown


def unchanging(
    campaign: Experiment, trials: Floats, flown: Collection[FlightBlock]
) -> Iterator[tuple[str, float, float]]:
    """The dispersions that change no flight of the trials, each with the ends of its range."""
    for i, name in enumerate(campaign.dimensions):
        unchanged, *rows = range(1 + _ROWS * i, 1 + _ROWS * (i + 1))
        if not any(differs(block, row, unchanged) for block in flown for row in rows):
            yield name, *trials[rows, i].tolist()


def _fly_temporary(
    campaign: Experiment, name: str, trials: Floats, every: int, limit: float
) -> FlightBlock:
    try:
        return run_in_thread(lambda: simulate(campaign, name, trials, every), limit)
    except TimeoutError:
        found = f"first flights of '{name}' that are not done in {limit:g} s"
        wish = "a law whose loops end, or a longer 'flight_time_limit'"
        raise InputError("controllers", found, wish) from None


def _find_not_finite(campaign: Experiment, flown: dict[str, FlightBlock]) -> Iterator[InputError]:
    told = set()
    for controller, block in flown.items():
        for metric, value in zip(campaign.measured, block.metrics[0].tolist(), strict=False):
            name = metric.name
            if block.outcome[0] != Outcome.OK or math.isfinite(value) or name in told:
                continue
            told.add(name)
            found = (
                f"'{name}', which is {'not a number' if math.isnan(value) else value} in "
                f"{controller}'s nominal flight"
            )
            wish = "a number at each tick of its window ('empty' says what it is without one)"
            if "heat_flux" in metric.of:
                wish = f"reference.nose_radius in the vehicle's file, or {wish}"
            yield campaign.document.key_error(("metrics", name), found, wish)


def differs(block: FlightBlock, a: int, b: int) -> bool:
    """Whether two flights of a block differ in any bit of what was measured."""
    values = np.column_stack([block.metrics, block.end_time])
    return not (
        np.array_equal(values[a], values[b], equal_nan=True)
        and block.outcome[a] == block.outcome[b]
    )
