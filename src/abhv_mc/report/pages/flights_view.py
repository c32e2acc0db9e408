"""What the page's linked view of the flights shows: every point a flight, its dispersions, metrics and history."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flown_campaign import FlownCampaign, read_histories
from abhv_mc.topics.failed_flights import requirement_failures, requirement_words
from abhv_mc.topics.flights.worst_flights import listed_worst
from abhv_mc.topics.parameter_words import axis_unit, spoken_name
from abhv_mc.topics.words import fixed

MOST_FLIGHTS = 6000  # points of the view, of all controllers together
LISTED = 100  # rows of the table
_HISTORY_RATE = 5.0  # Hz
_STRIPS = 24  # dispersions drawn
_HEADED = 4  # metrics in the table
# one fewer than colours: pairs come again late
_MARKS = ("circle", "square", "triangle-up", "diamond", "triangle-down")


@dataclass(frozen=True)
class FlightsView:
    """Plain data for the page's script, and the arrays that travel packed."""

    data: dict[str, object]
    arrays: dict[str, Floats]
    strips: tuple[tuple[str, str], ...]  # dispersions drawn: name and words
    headed: tuple[str, ...]  # metrics in the table


def make_flights_view(results: FlownCampaign, labels: Mapping[str, str], colors: Mapping[str, str]) -> FlightsView:
    """The view of a campaign: of all its flights, or of the worst and the first where there are too many."""
    names = results.controllers
    records = results.campaign.metrics
    metrics = [
        {"name": name, "label": records[name].label, "unit": records[name].unit.removeprefix("-")}
        for name in results.metrics
    ]
    headed = results.asked[:_HEADED]
    limits = {item.metric: results.campaign.limits_of(item.metric) for item in results.campaign.requirements}
    most = MOST_FLIGHTS // len(names)
    kept = {name: _kept(results.flights[name].flight.size, _rank(results, name), most) for name in names}
    controller = np.concatenate([np.full(rows.size, k) for k, rows in enumerate(kept.values())])
    flights = {name: results.flights[name] for name in names}
    number = np.concatenate([flights[name].flight[rows] for name, rows in kept.items()])
    outcome = np.concatenate([flights[name].outcome[rows] for name, rows in kept.items()])
    arrays: dict[str, Floats] = {}
    for entry in metrics:
        values = [flights[name].metrics[entry["name"]][rows] for name, rows in kept.items()]
        arrays[f"column:{entry['name']}"] = np.concatenate(values)
    dispersions = []
    for name in results.dispersed:
        unit, scale = axis_unit(name, results.campaign.parameters)
        dispersions.append({"name": name, "label": _capital(spoken_name(name)), "unit": unit})
        arrays[f"column:{name}"] = scale * results.samples[name][number]
    places = {
        (name, int(n)): i for i, (name, n) in enumerate(zip(np.array(names)[controller].tolist(), number, strict=True))
    }
    history = np.full(number.size, -1)
    channels, count = _add_histories(results, names, places, history, arrays)
    rank = [results.ranking.places_of(name)[rows] for name, rows in kept.items()]
    required = results.campaign.requirements
    missed = [
        np.concatenate([requirement_failures(flights[name], item)[rows] for name, rows in kept.items()])
        for item in required
    ]
    total = sum(flights[name].flight.size for name in names)
    data = {
        "controllers": [
            {"name": name, "label": labels[name], "color": colors[name], "mark": mark_of(k)}
            for k, name in enumerate(names)
        ],
        "folder": shlex.quote(results.folder.as_posix()),
        "rows": {
            "controller": controller.tolist(),
            "flight": number.tolist(),
            "outcome": outcome.tolist(),
            "failed": (outcome != Outcome.OK).astype(int).tolist(),
            "history": history.tolist(),
            "missed": [flags.astype(int).tolist() for flags in missed],
        },
        "outcomes": {k: results.campaign.outcomes.codes[k].replace("_", " ") for k in np.unique(outcome).tolist()},
        "order": np.argsort(np.concatenate(rank)).tolist(),
        "missed": [requirement_words(item, records) for item in required],
        "metrics": metrics,
        "dispersions": dispersions,
        "headed": list(headed),
        "limits": limits,
        "channels": channels,
        "track": count > 0 and {"north_m", "east_m"} <= {channel["name"] for channel in channels},
        "listed": LISTED,
        "left": ""
        if number.size == total
        else f"Shown of {fixed(total, 0)}: the worst, those that failed, and the first",
        "start": {
            "x": dispersions[0]["name"] if dispersions else metrics[0]["name"],
            "y": headed[0] if headed else metrics[0]["name"],
            "channel": "bank_deg",
        },
    }
    strips = tuple((entry["name"], entry["label"]) for entry in dispersions[:_STRIPS])
    return FlightsView(data, arrays, strips, headed)


def mark_of(number: int) -> str:
    """The mark of the controller with this number: colours carry no meaning alone."""
    return _MARKS[number % len(_MARKS)]


def _rank(results: FlownCampaign, name: str) -> list[int]:
    """Rows of a controller's flights: those that the report lists, then the worst of the others."""
    return list(dict.fromkeys([*listed_worst(results, name), *results.ranking.rows_of(name).tolist()]))


def _kept(flights: int, worst: Sequence[int], most: int) -> NDArray[np.intp]:
    """Rows [flight], ascending: all where there are few enough, else the worst half and the first of the others."""
    if flights <= most:
        return np.arange(flights)
    worst = worst[: most // 2]
    others = np.setdiff1d(np.arange(most), worst)[: most - len(worst)]
    return np.sort(np.concatenate([worst, others]).astype(np.intp))


def _add_histories(
    results: FlownCampaign,
    names: Sequence[str],
    places: Mapping[tuple[str, int], int],
    history: NDArray[np.int64],
    arrays: dict[str, Floats],
) -> tuple[list[dict[str, str | None]], int]:
    """Put the kept histories into ``arrays`` (``history:CHANNEL`` [flight, time]) and their numbers into ``history``.

    The channels that all of them have, and how many flights these are.
    """
    found = [
        (places[name, flight], columns)
        for name in names
        for flight, columns in read_histories(results.folder, name).items()
        if (name, flight) in places
    ]
    if not found:
        return [], 0
    longest = max((columns["time"] for _, columns in found), key=len)
    step = float(np.median(np.diff(longest))) if longest.size > 1 else 1.0
    every = max(1, round(1.0 / (_HISTORY_RATE * step)))
    time = longest[::every]
    held = [signal for signal in CHANNELS if all(signal.name in columns for _, columns in found)]
    arrays["history-time"] = time
    for signal in held:
        table = np.full((len(found), time.size), np.nan)
        for i, (_, columns) in enumerate(found):
            values = columns[signal.name][::every]
            table[i, : values.size] = values
        arrays[f"history:{signal.name}"] = table
    for i, (row, _) in enumerate(found):
        history[row] = i
    return [_channel(signal.name, signal.unit, {s.name for s in held}) for signal in held], len(found)


def _channel(name: str, unit: str, held: set[str]) -> dict[str, str | None]:
    stem, _, end = name.rpartition("_") if unit != "-" else (name, "", "")
    command = f"{stem}_command_{end}".rstrip("_")
    words = _capital(stem.replace("_", " "))
    return {
        "name": name,
        "label": words,
        "unit": "" if unit == "-" else unit,
        "command": command if command in held else None,
    }


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
