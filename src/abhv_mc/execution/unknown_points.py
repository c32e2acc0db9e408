"""Selection of the values of unknown parameters at which requirements are judged."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.unknowns import Unknowns, points_entry
from abhv_mc.campaign.sampling.designs import make_generator
from abhv_mc.execution.executor import FlightRunner, make_ready, open_executor, simulate
from abhv_mc.execution.progress import Progress
from abhv_mc.flights.metrics import MARGIN_VALUES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.interfaces import Plan
from abhv_mc.io.messages import counted, notify
from abhv_mc.statistics.unknowns import (
    SEARCH_QUANTILE,
    Trial,
    choose_points,
    search_flights,
    search_size,
    search_worst,
)


def select_points(
    campaign: Experiment,
    plans: Mapping[str, Plan],
    workers: int | None,
    baseline: Unknowns | None = None,
) -> Experiment:
    """Search for the worst points of each controller; return the campaign with these points.

    A point is a set of values of the unknown parameters. Points of ``baseline`` that lie within the
    bounds are added. A campaign without unknown parameters, or with points in its file, is returned
    unchanged. The flights of the search are not judged.
    """
    unknowns = campaign.unknowns
    if not unknowns.names or campaign.model.points is not None:
        return campaign
    number, searches = len(unknowns.names), []
    size = search_size(campaign.runs_at_point)
    if campaign.requirements:
        ready = make_ready(campaign, plans, margins=True)
        total = len(plans) * search_flights(
            number, len(campaign.requirements), campaign.runs_at_point
        )
        notify(f"searching for the worst values of the unknowns with {counted(total, 'flight')}")
        with (
            open_executor(campaign.simulator.engine, campaign.model.execution, workers) as executor,
            Progress("search for the worst values of the unknowns: flights", total) as progress,
        ):
            for name in plans:
                evaluate = partial(_evaluate, ready, name, executor, progress)
                searches.append(
                    search_worst(evaluate, number, make_generator(campaign.seed, name, "unknowns"))
                )
    baseline_points = None
    if baseline is not None:
        scaled = 2.0 * (baseline.points - unknowns.low) / (unknowns.high - unknowns.low) - 1.0
        scaled = np.round(scaled, 12)  # Rounding makes the corners and the centre of the box exact.
        baseline_points = scaled[np.all(np.abs(scaled) <= 1.0, axis=1)]
    chosen = choose_points(number, searches, baseline_points)
    return with_points(campaign, points_entry(unknowns, chosen, tuple(plans), searches, size))


def with_points(campaign: Experiment, points: object) -> Experiment:
    """Return the campaign with the ``points`` of a stored campaign file.

    The campaign is returned unchanged if ``points`` is None, or if its own file contains points.
    """
    if points is None or campaign.model.points is not None:
        return campaign
    data = {**campaign.document.entries, "points": points}
    return check_campaign(replace(campaign.document, data=data), campaign.engine)


def _evaluate(
    campaign: Experiment, name: str, executor: FlightRunner, progress: Progress, points: Floats
) -> Trial:
    """Simulate the search flights at ``points`` [point, unknown]."""
    rows = campaign.search_rows(
        search_size(campaign.runs_at_point), campaign.unknowns.values(points)
    )
    block = simulate(
        campaign, name, rows, None, executor.fly_parallel, margins=campaign.margin_flights > 0
    )
    progress.add(len(rows))
    columns = [signal.name for signal in (*campaign.measured, *MARGIN_VALUES)]
    trials = []
    for item in campaign.requirements:
        values = block.metrics[:, columns.index(item.metric)]
        early = item.early_is_failure & (block.outcome != Outcome.OK)
        severity = item.limits.worse(values)
        severity = np.where(np.isnan(severity) | early, np.inf, severity).reshape(len(points), -1)
        # Do not interpolate, because values may be infinite.
        quantile = np.quantile(severity, SEARCH_QUANTILE, axis=1, method="higher")
        failures = item.limits.failures(values, early).reshape(severity.shape).sum(axis=1)
        trials.append((quantile, failures, severity.max(axis=1)))
    return Trial(*map(np.column_stack, zip(*trials, strict=True)))
