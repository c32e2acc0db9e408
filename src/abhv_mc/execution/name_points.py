"""At which values of its unknowns a campaign is judged: searched for before its folder is made, and named in it."""

import sys
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.unknowns import points_entry
from abhv_mc.campaign.sampling.designs import make_generator
from abhv_mc.execution.executor import Executor, open_executor
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.metrics import MARGIN_VALUES
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.simulators.engine import Engine, make_ready, simulate
from abhv_mc.statistics.unknowns import (
    SEARCH_FLIGHTS,
    SEARCH_QUANTILE,
    points_flown,
    search_flights,
    search_worst,
)


def name_points(
    campaign: Experiment, plans: dict[str, FlightPlan], engine: Engine, workers: int | None
) -> Experiment:
    """The campaign with the points that a search of each controller finds; as it is where it has no unknowns, or
    names their points itself. The flights of the search are other ones than are judged."""
    unknowns = campaign.unknowns
    if not unknowns.names or campaign.model.points is not None:
        return campaign
    number, searched = len(unknowns.names), []
    if campaign.requirements:
        ready = make_ready(campaign, plans, margins=True)
        total = len(plans) * search_flights(number, len(campaign.requirements))
        print(
            f"{total} flights search the worst values of the unknowns", file=sys.stderr, flush=True
        )
        with (
            open_executor(engine, campaign.model.execution, workers, None) as executor,
            Progress("search of the unknowns' worst values: flights", total) as progress,
        ):
            for name in plans:
                severity = partial(_severity, ready, name, executor, progress)
                searched.append(
                    search_worst(severity, number, make_generator(campaign.seed, name, "unknowns"))
                )
    tried = len(np.unique(np.vstack([points for points, _ in searched]), axis=0)) if searched else 0
    return with_points(campaign, points_entry(unknowns, points_flown(number, searched), tried))


def with_points(campaign: Experiment, points: object) -> Experiment:
    """The campaign judged at ``points``, as a folder's campaign file has them; None: as it is."""
    if points is None or campaign.model.points is not None:
        return campaign
    data: dict[str, Any] = {**campaign.document.data, "points": points}  # type: ignore[dict-item]
    return check_campaign(replace(campaign.document, data=data))


def _severity(
    campaign: Experiment, name: str, executor: Executor, progress: Progress, places: Floats
) -> Floats:
    """Quantile [point, requirement] of how far the flights at each place go beyond each requirement's limit."""
    rows = campaign.search_rows(SEARCH_FLIGHTS, campaign.unknowns.values(places))
    margins = campaign.model.margins is not None
    block = simulate(campaign, name, rows, None, executor.fly_side_by_side, margins)
    progress.add(len(rows))
    columns = [signal.name for signal in (*campaign.measured, *MARGIN_VALUES)]
    found = []
    for item in campaign.requirements:
        worse = item.limits.worse(block.metrics[:, columns.index(item.metric)])
        worse = np.where(
            np.isnan(worse) | (item.early_is_failure & (block.outcome != Outcome.OK)), np.inf, worse
        )
        # The higher of two values: between a number and infinity lies nothing.
        found.append(
            np.quantile(worse.reshape(len(places), -1), SEARCH_QUANTILE, axis=1, method="higher")
        )
    return np.column_stack(found)
