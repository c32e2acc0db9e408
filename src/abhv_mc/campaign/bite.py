"""Trial flights before a campaign: the nominal one, and proof that every dispersion changes something.

A dispersion that reaches no equation gives the same flight to the last bit; it is refused before anything is flown,
so that no campaign silently varies nothing.
"""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.batches import Fly
from abhv_mc.campaign.check import CheckedCampaign
from abhv_mc.campaign.samples import spread_parameters
from abhv_mc.documents import InputError, InputErrors
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.plant.parameters import PARAMETER_INDEX, PARAMETERS

Floats = NDArray[np.float64]


def make_trials(campaign: CheckedCampaign) -> Floats:
    """Parameter rows: the nominal flight, then each dispersion alone at the low and at the high end of its law."""
    names = campaign.names
    values = np.tile([PARAMETERS[PARAMETER_INDEX[name]].nominal for name in names], (1 + 2 * len(names), 1))
    for i, name in enumerate(names):
        if campaign.sample_file is not None:
            column = campaign.sample_file.values[: campaign.runs, i]
            ends = np.array([column.min(), column.max()])
        else:
            ends = campaign.laws[name].at_fraction(np.array([0.0, 1.0]))
        values[1 + 2 * i : 3 + 2 * i, i] = ends
    return spread_parameters(names, values)


def fly_trials(campaign: CheckedCampaign, plans: dict[str, FlightPlan], fly: Fly, every: int) -> dict[str, FlightBlock]:
    """Fly the trials of every controller; the first flight of each block is the nominal one.

    Raises InputError for a dispersion that changes no controller's flight.
    """
    trials = make_trials(campaign)
    flown = {name: fly(plan, trials, every) for name, plan in plans.items()}
    errors: list[InputError] = []
    for i, name in enumerate(campaign.names):
        rows = [1 + 2 * i, 2 + 2 * i]
        if not any(_differs(block, row) for block in flown.values() for row in rows):
            low, high = trials[rows, PARAMETER_INDEX[name]]
            where = ("sampling",) if campaign.sample_file is not None else ("dispersions", name)
            found = f"'{name}' from {low:g} to {high:g}, which changes no controller's flight"
            errors.append(campaign.document.key_error(where, found, "a dispersion that matters to this vehicle"))
    if errors:
        raise InputErrors(errors)
    return flown


def _differs(block: FlightBlock, row: int) -> bool:
    """Whether a trial differs from the nominal flight in any bit of what it measured."""
    same = np.array_equal(block.metrics[row], block.metrics[0], equal_nan=True)
    return not (same and block.outcome[row] == block.outcome[0] and block.end_time[row] == block.end_time[0])
