"""What the first screen's chart shows: for each requirement the spread of the flights beside its limit."""

from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.results import Results
from abhv_mc.numerics.bounds import Bounds
from abhv_mc.statistics.ranking import spread
from abhv_mc.topics.plain import plain
from abhv_mc.topics.words import count_of, significant

_SHARES = {"low": 5.0, "median": 50.0, "high": 95.0}  # percent of the flights


def glance_numbers(results: Results, requirements: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each requirement; without any, for each metric that stands first, beside its nominal value.

    Of each controller the 5 %, 50 % and 95 % quantiles, None where they lie among lost flights, which are worst.
    """
    records = results.campaign.metrics
    rows = []
    for item, entry in zip(results.campaign.requirements, requirements, strict=True):
        cells = {}
        for name, verdict in entry["controllers"].items():
            cells[name] = {
                **_quantiles(results, name, item.metric, item.limits),
                "tolerance": verdict.get("tolerance_limit"),
                "status": verdict["status"],
                "failures": count_of(verdict["failures"], verdict["flights"]),
            }
        record, limits = records[item.metric], item.limits
        rows.append(
            {
                "metric": item.metric, "label": record.label, "text": record.with_unit(limits.symbols), "cells": cells,
                "unit": f"{record.unit} outside the limits" if limits.both else record.unit,
                **_scale(limits, results, item.metric),
            }
        )  # fmt: skip
    return rows or [_unlimited(results, metric) for metric in results.asked]


def _unlimited(results: Results, metric: str) -> dict[str, Any]:
    """A metric without a requirement: the first controller's median stands where a limit would."""
    record = results.campaign.metrics[metric]
    side = Bounds(low=0.0) if record.bad == "low" else Bounds(high=0.0)
    none = {"tolerance": None, "status": "", "failures": ""}
    cells = {name: {**_quantiles(results, name, metric, side), **none} for name in results.controllers}
    middle = next((cell["median"] for cell in cells.values() if cell["median"] is not None), 0.0)
    text = f"median {significant(middle, 3)} {'' if record.unit == '-' else record.unit}".strip()
    return {
        "metric": metric, "label": record.label, "unit": record.unit, "text": text, "cells": cells,
        **_scale(side, results, metric), "limit": middle, **({"size": abs(middle)} if middle else {}),
    }  # fmt: skip


def _scale(limits: Bounds, results: Results, metric: str) -> dict[str, Any]:
    """What the chart needs of limits: where the line is, on which side of it values are good, and its unit, which is
    the first controller's span of 5 to 95 % where the limit is 0."""
    first = results.flights[results.controllers[0]]
    size = limits.size or spread(first.metrics[metric][~first.failed])
    return {"limit": limits.sign * limits.limit, "below": limits.sign > 0.0, "size": size}


def _quantiles(results: Results, name: str, metric: str, limits: Bounds) -> dict[str, Any]:
    """Of the metric; of two limits, of the distance outside them, negative inside."""
    flights = results.flights[name]
    worse = limits.worse(flights.metrics[metric])
    values: Floats = limits.sign * np.where(flights.failed | np.isnan(worse), np.inf, worse)
    with np.errstate(invalid="ignore"):
        ends = np.percentile(values, list(_SHARES.values()), method="nearest")
    return dict(zip(_SHARES, plain(ends), strict=True))
