"""Data of the interactive view of flights, for a report's page and for `explore`."""

import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Indices, Ints
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flown_campaign import FlownCampaign, read_histories
from abhv_mc.report.pages.channel_curves import channel_curves, describe_channel
from abhv_mc.topics.flights.model import channel_of, limit_sides, listed_worst, moments_of
from abhv_mc.topics.formatting import axis_unit, fixed, is_factor, shown_value, spoken_name
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words

MOST_FLIGHTS = 6000  # maximum number of points on a page, over all controllers
LISTED = 100  # maximum number of rows in the table
CELLS = (120, 80)  # cells of the density plot, horizontal and vertical
BARS = 60  # number of bars in a histogram strip
_HISTORY_RATE = 5.0  # sampling rate of the histories, Hz
_STRIPS = 24  # maximum number of dispersions drawn as strips
_HEADED = 4  # number of metrics in the table if there are no requirements
# Limits are drawn if the range of flights and limits is at most this multiple of the range of the
# flights.
_FAR = 3.0
# The page must contain the scripts in this order.
SCRIPTS = ("flight_axes.js", "flight_path.js", "flight_panel.js", "flights.js")
STYLES = ("style.css", "flights.css")
# SVG paths of markers. There is one marker fewer than colours, so that combinations rarely repeat.
SHAPES = {
    "circle": "M-4 0A4 4 0 1 0 4 0A4 4 0 1 0-4 0z",
    "square": "M-3.6-3.6H3.6V3.6H-3.6z",
    "triangle-up": "M0-4.6L4.4 3.6H-4.4z",
    "diamond": "M0-5L5 0L0 5L-5 0z",
    "triangle-down": "M0 4.6L4.4-3.6H-4.4z",
}
Ends = tuple[float, float]


def template_text(name: str) -> str:
    """Return the text of a page template, script or style sheet."""
    return (files("abhv_mc.report.pages") / "template" / name).read_text("utf-8")


def mark_of(number: int) -> str:
    """Return a controller's marker, which distinguishes it without colour."""
    return list(SHAPES)[number % len(SHAPES)]


def describe_flights(
    results: FlownCampaign,
    labels: Mapping[str, str],
    colors: Mapping[str, str],
    ends: Mapping[str, Ends],
    channels: Collection[str],
) -> dict[str, Any]:
    """Describe a campaign's flights for the view.

    ``ends`` contains the ranges of the columns in displayed units; ``channels`` names the channels
    with histories.
    """
    names, records = results.controllers, results.campaign.metrics
    required = results.campaign.requirements
    headed = (results.asked if required else results.asked[:_HEADED]) or results.metrics[:_HEADED]
    moments = moments_of(results)
    criteria = [records[criterion.metric] for criterion in results.campaign.criteria]
    parameters = results.campaign.parameters
    dispersions = [
        _dispersion(name, ends[name], moments[name], parameters) for name in results.dispersed
    ]
    metrics = [
        _metric(records[name], results.campaign.limits_of(name), ends[name])
        for name in results.metrics
    ]
    return {
        "name": results.campaign.name.replace("_", " "),
        "folder": shlex.quote(results.folder.as_posix()),
        "kind": results.campaign.kind.capitalize(),
        "flies": results.campaign.can_rerun,
        "controllers": [
            {"name": name, "label": labels[name], "color": colors[name], "mark": SHAPES[mark_of(k)]}
            for k, name in enumerate(names)
        ],
        "columns": [*dispersions, *metrics],
        "requirements": [
            {
                "words": requirement_words(item, records),
                "metric": item.metric,
                "low": item.limits.low,
                "high": item.limits.high,
            }
            for item in required
        ],
        "criteria": [
            {
                "metric": record.name,
                "channel": channel_of(record, channels, results.campaign.contents.stems),
                "sides": limit_sides(record, channels),
                "settled": record.settled,
                "from": record.start,
                "to": record.end if np.isfinite(record.end) else None,
            }
            for record in criteria
        ],
        "transients": results.campaign.transients
        if any(record.settled for record in criteria)
        else (),
        "headed": headed,
        "strips": list(results.dispersed[:_STRIPS]),
        "x": (results.dispersed or results.metrics)[0],
        "y": headed[0],
        "channels": [describe_channel(name, channels, results.campaign) for name in channels],
        "bars": BARS,
        "cells": CELLS,
        "banded": results.campaign.has_bands,
        "listed": LISTED,
    }


def _dispersion(name: str, ends: Ends, moments: Ends, parameters: Parameters) -> dict[str, Any]:
    spoken, (unit, scale) = spoken_name(name), axis_unit(name, parameters)
    mean, sigma = moments
    return {
        "name": name,
        "head": _head(name, unit),
        "label": spoken[:1].upper() + spoken[1:],
        "unit": unit,
        "ends": ends,
        "limits": [],
        "spoken": spoken,
        "factor": is_factor(name, parameters),
        "never": shown_value(name, None, parameters),
        "mean": scale * mean if np.isfinite(mean) else None,
        "sigma": scale * sigma if np.isfinite(sigma) else None,
    }


def _metric(record: Metric, limits: Sequence[float], ends: Ends) -> dict[str, Any]:
    """Describe a metric; the range of its axis includes limits that are close to the data."""
    low, high = min([*limits, ends[0]]), max([*limits, ends[1]])
    if high - low > _FAR * (ends[1] - ends[0]):
        low, high = ends
    unit = "" if record.unit == "-" else record.unit
    return {
        "name": record.name,
        "head": _head(record.name, unit),
        "label": record.label,
        "unit": unit,
        "ends": (low, high),
        "limits": limits,
        "bad": record.bad,
    }


def _head(name: str, unit: str) -> str:
    """Return the header of a column in a saved table."""
    return f"{name} [{unit or '-'}]"


def make_flights_view(
    results: FlownCampaign, labels: Mapping[str, str], colors: Mapping[str, str]
) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Return the data of the view on a page, and its packed arrays.

    If there are too many flights, only the worst flights and the first flights are included.
    """
    names, required = results.controllers, results.campaign.requirements
    most = MOST_FLIGHTS // len(names)
    rows_by_name = {name: _select_rows(results, name, most) for name in names}

    flights = [results.flights[name] for name in names]

    def stacked(columns: Iterable[NDArray[Any]]) -> NDArray[Any]:
        """Return the selected rows of one column, stacked over the controllers."""
        return np.concatenate(
            [column[rows] for column, rows in zip(columns, rows_by_name.values(), strict=True)]
        )

    controller = np.repeat(np.arange(len(names)), [rows.size for rows in rows_by_name.values()])
    number = stacked(table.flight for table in flights)
    outcome = stacked(table.outcome for table in flights)
    arrays = {}
    for name in results.dispersed:
        arrays[f"column:{name}"] = (
            axis_unit(name, results.campaign.parameters)[1] * results.samples[name][number]
        )
    for metric in results.metrics:
        arrays[f"column:{metric}"] = stacked(table.metrics[metric] for table in flights)
    ends = {key.removeprefix("column:"): find_range(values) for key, values in arrays.items()}
    keys = zip(np.array(names)[controller].tolist(), number.tolist(), strict=True)
    row_of = {key: row for row, key in enumerate(keys)}
    history = np.full(number.size, -1)
    channels = _add_histories(results, row_of, history, arrays)
    for name, channel in product(names, channels):
        if (name, channel) not in results.envelopes:
            time, curves = channel_curves(results, name, channel)
            if np.isfinite(curves).any():
                arrays.setdefault(f"time:{name}", time)
                arrays[f"{channel}:{name}"] = curves
    missed = [stacked(requirement_failures(table, item) for table in flights) for item in required]
    total = sum(table.flight.size for table in flights)
    data = {
        **describe_flights(results, labels, colors, ends, channels),
        "rows": {
            "controller": controller.tolist(),
            "flight": number.tolist(),
            "outcome": outcome.tolist(),
            "failed": (outcome != Outcome.OK).astype(int).tolist(),
            "history": history.tolist(),
            "by": stacked(results.ranking.criterion_index[name] for name in names).tolist(),
            "missed": [flags.astype(int).tolist() for flags in missed],
        },
        "outcomes": {
            k: results.campaign.outcomes.codes[k].replace("_", " ")
            for k in np.unique(outcome).tolist()
        },
        "order": np.argsort(stacked(map(results.ranking.ranks_of, names))).tolist(),
        "histories": bool(channels),
        "drawn_again": bool(results.campaign.channels),
        "total": number.size,
        "left": ""
        if number.size == total
        else f"Of {fixed(total, 0)} flights, the worst, the failed and the first are shown",
    }
    return data, arrays


def find_range(values: Floats) -> Ends:
    """Return the smallest and largest finite value; (0, 0) if there are none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


def _select_rows(results: FlownCampaign, name: str, most: int) -> Indices:
    """Return the rows [flight] to include, ascending: all, or the worst and first flights."""
    flights = results.flights[name].flight.size
    if flights <= most:
        return np.arange(flights)
    worst = list(
        dict.fromkeys([*listed_worst(results, name), *results.ranking.rows_of(name).tolist()])
    )[: most // 2]
    first_flights = np.setdiff1d(np.arange(most), worst)[: most - len(worst)]
    return np.sort(np.concatenate([worst, first_flights]).astype(np.intp))


def _add_histories(
    results: FlownCampaign,
    row_of: Mapping[tuple[str, int], int],
    history: Ints,
    arrays: dict[str, Floats],
) -> list[str]:
    """Add histories [flight, time] to ``arrays``, and their row numbers to ``history``.

    Return the channels that all histories have.
    """
    recorded = [
        (row_of[name, flight], results.align(name, columns))
        for name in results.controllers
        for flight, columns in read_histories(results.folder, name).items()
        if (name, flight) in row_of
    ]
    if not recorded:
        return []
    longest = max((columns["time"] for _, columns in recorded), key=len)
    step = float(np.median(np.diff(longest))) if longest.size > 1 else 1.0
    every = max(1, round(1.0 / (_HISTORY_RATE * step)))
    time = longest[::every]
    channels = [
        name
        for name in recorded[0][1]
        if name != "time" and all(name in columns for _, columns in recorded)
    ]
    arrays["history-time"] = time
    for channel in channels:
        table = np.full((len(recorded), time.size), np.nan)
        for i, (_, columns) in enumerate(recorded):
            table[i] = np.interp(time, columns["time"], columns[channel], np.nan, np.nan)
        arrays[f"history:{channel}"] = table
    for i, (row, _) in enumerate(recorded):
        history[row] = i
    return channels
