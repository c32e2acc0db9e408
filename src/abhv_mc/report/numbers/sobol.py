"""Sobol indices of every metric from a campaign with a Saltelli design."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.sampling.designs import SALTELLI, saltelli_group
from abhv_mc.folder.results import Results
from abhv_mc.statistics.sobol import sobol_indices
from abhv_mc.topics.plain import interval_at
from abhv_mc.topics.words import count_of


def sobol_numbers(results: Results) -> dict[str, Any]:
    """First-order and total indices by controller, metric and parameter, largest total first; empty for other designs.

    A controller with a flight that ended early or could not be computed has none, and a sentence that says why: its
    variance is not that of the mission.
    """
    if results.campaign.sampling != SALTELLI:
        return {}
    names = list(results.dispersed)
    numbers: dict[str, Any] = {}
    for controller in results.controllers:
        flights = results.flights[controller]
        lost = int(flights.failed.sum()) + flights.not_computed
        if lost:
            total = flights.flight.size + flights.not_computed
            words = f"{count_of(lost, total, 'flights')} ended early or could not be computed, and indices need all"
            numbers[controller] = {"refused": words, "metrics": {}}
            continue
        try:
            table = sobol_indices(np.column_stack([flights.metrics[name] for name in results.metrics]), len(names))
        except ValueError as error:
            numbers[controller] = {"refused": str(error), "metrics": {}}
            continue
        metrics = {}
        for column, metric in enumerate(results.metrics):
            if np.isnan(table.total[:, column]).any():
                continue
            metrics[metric] = [
                {
                    "parameter": names[row],
                    **{kind: interval_at(table, kind, row, column) for kind in ("first", "total")},
                }
                for row in np.argsort(-table.total[:, column], kind="stable")
            ]
        numbers[controller] = {"refused": None, "metrics": metrics}
    return {"group": saltelli_group(len(names)), "controllers": numbers}


def independent_rows(results: Results, flight: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which flights share no parameter value with another: of a Saltelli design the first and last of each group."""
    if results.campaign.sampling != SALTELLI:
        return np.ones(flight.size, dtype=np.bool_)
    group = saltelli_group(len(results.dispersed))
    return np.asarray(np.isin(flight % group, (0, group - 1)))
