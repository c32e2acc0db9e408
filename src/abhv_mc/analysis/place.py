"""Comparison of test flights with the simulated flights of a campaign."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown, read_histories
from abhv_mc.io.foreign_table import NumberTable, read_foreign_table
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.io.units import parse_in_any_unit, parse_unit
from abhv_mc.statistics.circular import align_flights, unwrap
from abhv_mc.statistics.placement import (
    Band,
    joint_p_value,
    rank_p_values,
    set_p_value,
    simultaneous_band,
)

CONFIDENCE = 0.95
FEWEST_FLIGHTS = 39  # minimum number of simulated flights for which a two-sided p-value can be 5 %
_MOST_TIMES = 500  # maximum number of times at which histories are compared
_SUMMARIES = ("largest", "smallest", "mean", "last")


@dataclass(frozen=True)
class RankedMetric:
    """Metric of a test flight, ranked among the simulated flights."""

    metric: str
    value: float
    rank: int  # rank of the test flight among all flights, 1 for the smallest value
    low: float  # 2.5 % quantile of the simulated flights
    median: float
    high: float
    p_value: float  # two-sided p-value


@dataclass(frozen=True)
class Departure:
    """First exit of a history from the simultaneous band."""

    channel: str
    time_s: float


@dataclass(frozen=True)
class PlacedFlight:
    """Comparison of one test flight with the simulated flights."""

    name: str
    metrics: tuple[RankedMetric, ...]  # ranked metrics, smallest p-value first
    joint_p_value: float  # joint p-value of all metrics
    band_p_value: float | None  # p-value of the largest deviation of the history
    leaves: Departure | None


@dataclass(frozen=True)
class ChannelBands:
    """Bands of one channel over time, for a figure."""

    time: Floats
    simultaneous: tuple[Floats, Floats]
    pointwise: tuple[Floats, Floats]
    flights: tuple[Floats, ...]  # histories of the test flights


@dataclass(frozen=True)
class Placement:
    """Comparison of test flights with the simulated flights of one controller."""

    controller: str
    simulated: int
    noise: Mapping[str, float]  # standard deviations of the noise added to simulated channels
    sensed: tuple[str, ...]  # channels to which errors of the campaign's sensors were added
    ignored: tuple[str, ...]  # columns of the test files that the campaign does not record
    spread: tuple[str, ...]  # channels without a band where the flights spread over the circle
    flights: tuple[PlacedFlight, ...]
    together_p_value: float | None  # joint p-value of several test flights
    bands: Mapping[str, ChannelBands]


def place_flights(
    root: Path,
    files: Sequence[Path],
    controller: str | None = None,
    noise: Mapping[str, float] | None = None,
) -> Placement:
    """Compare test flights with the simulated flights of a campaign.

    A file with a column `time` is a history: the largest, smallest, mean and last value of each
    channel are ranked, and the history is compared with the simultaneous band. Any other file has
    one row per flight, and metrics of the campaign as columns. `noise` maps channels to standard
    deviations of measurement noise; the default is the noise in the campaign file or the errors of
    its sensors. Raise InputError if flights cannot be compared.
    """
    results = read_flown(root)
    controller = results.campaign.choose_controller(controller)
    if not results.campaign.independent or len(results.campaign.unknowns.points) > 1:
        expected = "a campaign with 'sampling: random' and no unknowns"
        raise InputError(
            root,
            "the flights are not random draws from a single distribution",
            expected,
        )
    records = (*results.campaign.metrics.values(), *results.campaign.channels)
    units = {"time": "s", **{record.name: record.unit for record in records}}
    tables = [_read_table(file, units) for file in files]
    timed = ["time" in table.names for table in tables]
    if any(timed) and not all(timed):
        expected = "a column 'time', as in the other files"
        raise InputError(files[timed.index(False)], "the column 'time' is missing", expected)
    labels = [table.table.path.name for table in tables]
    sensed: tuple[str, ...] = ()
    spread: list[str] = []
    if all(timed):
        histories, tests, times, channels = _read_histories(results, controller, tables)
        for channel in noise or {}:
            if channel not in channels:
                raise InputError(
                    "--measured", f"unknown channel '{channel}'", one_of(channels, channel)
                )
        declared = results.campaign.model.measured.items()
        noise = {
            channel: sigma
            for channel, sigma in (
                *((name, parse_in_any_unit(value, units[name])) for name, value in declared),
                *(noise or {}).items(),
            )
            if channel in channels
        }
        simulated, sensed = measure(results, histories, channels, noise, units)
        pool, number = np.vstack([simulated, tests]), len(simulated)
        aligned = {}
        for c, channel in enumerate(channels):
            column = align_flights(pool[:, :, c], results.campaign.periods[channel], number)
            if np.isnan(column[:number]).sum() > np.isnan(simulated[:, :, c]).sum():
                spread.append(channel)
            if channel not in spread or np.isfinite(column).any(axis=1).all():
                aligned[channel] = column
        if not aligned:
            expected = "a channel in which the flights do not spread over the circle"
            raise InputError(root, "no channel can be compared", expected)
        channels = [*aligned]
        simulated, tests = np.split(np.stack([*aligned.values()], axis=2), [number])
        names = [f"{channel}, {summary}" for summary in _SUMMARIES for channel in channels]
        values, own = summarize(simulated), summarize(tests)
    else:
        if noise:
            raise InputError(
                "--measured",
                "the test files contain no time histories",
                "test files with a column 'time'",
            )
        flights = results.flights[controller]
        names = _shared_columns(tables, results.metrics)
        values = np.column_stack([flights.metrics[name] for name in names])
        values = values[np.isfinite(values).all(axis=1)]
        own = np.vstack([_columns(table, names) for table in tables])
        labels = [f"{t.table.path.name}:{line}" for t in tables for line in t.table.lines]
    if len(values) < FEWEST_FLIGHTS:
        problem = (
            f"the number of simulated flights available for the comparison is only {len(values)}"
        )
        raise InputError(root, problem, f"at least {FEWEST_FLIGHTS}")
    placed, bands = (
        [_place(label, names, values, row) for label, row in zip(labels, own, strict=True)],
        {},
    )
    together = np.vstack([values, own])
    if all(timed):
        band = simultaneous_band(simulated, CONFIDENCE)
        placed = [
            _locate(flight, band, test, times, channels)
            for flight, test in zip(placed, tests, strict=True)
        ]
        bands = _channel_bands(band, simulated, tests, times, channels)
        scores = [band.deviations(test).max() for test in tests]
        together = np.column_stack([together, np.append(band.scores, scores)])
    results.refuse_changes()
    compared = {"time", *(bands or names), *spread}
    return Placement(
        controller=controller,
        simulated=len(values),
        noise=dict(noise or {}),
        sensed=sensed,
        ignored=tuple(dict.fromkeys(head for table in tables for head in _unused(table, compared))),
        spread=tuple(spread),
        flights=tuple(placed),
        together_p_value=set_p_value(together, len(placed)) if len(placed) > 1 else None,
        bands=bands,
    )


def _read_table(file: Path, units: Mapping[str, str]) -> NumberTable:
    """Read the columns that the campaign records from a test file, in campaign units.

    Raise InputError if a column is invalid.
    """
    table = read_foreign_table(file)
    columns = table.find(units)
    factors = [table.factor(column, units[name]) for name, column in columns.items()]
    numbers = table.numbers([column.position for column in columns.values()])
    return NumberTable(table, columns, numbers * factors)


def _unused(table: NumberTable, compared: Collection[str]) -> list[str]:
    """Return the headings of the table columns that are not compared."""
    used = {column.position for name, column in table.columns.items() if name in compared}
    return [head for i, head in enumerate(table.table.heads) if i not in used]


def _shared_columns(tables: Sequence[NumberTable], recorded: Sequence[str]) -> list[str]:
    """Return the names of the columns that the first file shares with the campaign.

    Raise InputError if another file lacks one of these columns.
    """
    names = [name for name in tables[0].names if name in recorded]
    for table in tables:
        missing = [name for name in names or recorded[:1] if name not in table.names]
        if missing:
            expected = f"columns that the campaign records, such as '{missing[0]}'"
            raise table.table.error(None, None, f"the column '{missing[0]}' is missing", expected)
    return names


def _columns(table: NumberTable, names: Sequence[str]) -> Floats:
    return table.values[:, [table.names.index(name) for name in names]]


def _read_histories(
    results: FlownCampaign,
    controller: str,
    tables: Sequence[NumberTable],
) -> tuple[dict[int, Floats], Floats, Floats, list[str]]:
    """Return simulated histories, test histories, times and channels.

    Simulated histories are arrays [time, channel] in a dictionary keyed by flight number; test
    histories are one array [flight, time, channel].
    """
    histories = _random_histories(results, controller)
    if not histories:
        expected = "'keep: {histories: {flights: all}}' or 'flights: every N' in the campaign file"
        raise InputError(
            results.folder,
            "the campaign stored no histories of randomly selected flights",
            expected,
        )
    channels = _shared_columns(
        tables, [name for name in next(iter(histories.values())) if name != "time"]
    )
    for table in tables:
        table.check_rising("time", "s")
    end = max(history["time"][-1] for history in histories.values())
    times = _columns(tables[0], ["time"])[:, 0]
    times = times[(times >= 0.0) & (times <= end)]
    if not times.size:
        raise tables[0].error(
            0,
            "time",
            "no time lies within the duration of the simulated flights",
            f"times from 0 to {end:g} s",
        )
    times = times[:: max(1, times.size // _MOST_TIMES)]
    periods = results.campaign.periods
    sampled = ((k, _sample(history, channels, times, periods)) for k, history in histories.items())
    simulated = {k: values for k, values in sampled if np.isfinite(values).any()}
    tests = np.stack(
        [
            _sample(dict(zip(t.names, t.values.T, strict=True)), channels, times, periods)
            for t in tables
        ]
    )
    for table, test in zip(tables, tests, strict=True):
        if not np.isfinite(test).any():
            raise table.error(
                0,
                "time",
                "the test flight has no time in common with the first test flight",
                "times that overlap with the times of the first test flight",
            )
    return simulated, tests, times, channels


def measure(
    results: FlownCampaign,
    histories: Mapping[int, Floats],
    channels: Sequence[str],
    noise: Mapping[str, float],
    units: Mapping[str, str],
) -> tuple[Floats, tuple[str, ...]]:
    """Return histories with sensor errors [flight, time, channel], and the sensed channels.

    The scale, bias and white noise of a sensor are those that the campaign draws for each flight.
    The lag of sensors is neglected.
    """
    flights, simulated = list(histories), np.stack(list(histories.values()))
    sigma = np.tile([noise.get(name, 0.0) for name in channels], (len(flights), 1))
    sensed = []
    for c, channel in enumerate(channels):
        sensor = _sensor_of(channel, results.campaign.parameters.index)
        drawn = {
            error: results.samples[f"sensor.{sensor}_{error}"][flights]
            for error in ("scale", "bias", "noise")
            if f"sensor.{sensor}_{error}" in results.samples
        }
        if channel in noise or not drawn:
            continue
        unit = parse_unit(units[channel])[0]
        if "scale" in drawn and not channel.rpartition("_")[0].endswith("_error"):
            simulated[:, :, c] *= drawn["scale"][:, np.newaxis]
        simulated[:, :, c] += np.reshape(drawn.get("bias", 0.0) / unit, (-1, 1))
        sigma[:, c] = np.abs(drawn.get("noise", 0.0)) / unit
        sensed.append(channel)
    draw = np.random.default_rng(0)
    simulated += sigma[:, np.newaxis] * draw.standard_normal(simulated.shape)
    return simulated, tuple(sensed)


def _sensor_of(channel: str, parameters: Collection[str]) -> str | None:
    """Return the sensed quantity to which a channel belongs, or None if there is none."""
    stems = channel, channel.rpartition("_")[0], channel.rpartition("_")[0].removesuffix("_error")
    return next((stem for stem in stems if f"sensor.{stem}_bias" in parameters), None)


def _sample(
    history: Mapping[str, Floats],
    channels: Sequence[str],
    times: Floats,
    periods: Mapping[str, float],
) -> Floats:
    """Interpolate channels at `times` [time, channel], with NaN outside the history."""
    curves = [unwrap(history[channel], periods[channel]) for channel in channels]
    return np.column_stack(
        [np.interp(times, history["time"], curve, np.nan, np.nan) for curve in curves]
    )


def _random_histories(results: FlownCampaign, controller: str) -> dict[int, dict[str, Floats]]:
    """Return, by flight number, the histories that were stored regardless of the outcome."""
    steps = [
        1 if item == "all" else int(str(item).removeprefix("every "))
        for item in results.campaign.model.keep.histories.flights
        if str(item) == "all" or str(item).startswith("every ")
    ]
    stored = read_histories(results.folder, controller) if steps else {}
    return {k: stored[k] for k in sorted(stored) if any(k % step == 0 for step in steps)}


def find_band(
    results: FlownCampaign, controller: str, channels: Sequence[str], times: Floats
) -> tuple[list[str], Band] | None:
    """Return the channels that have histories, and the simultaneous band of these channels.

    Return None if there is no such channel or if there are too few random histories.
    """
    if not results.campaign.independent:
        return None
    histories = list(_random_histories(results, controller).values())
    shared = [name for name in channels if histories and name in histories[0]]
    if len(histories) < FEWEST_FLIGHTS or not shared:
        return None
    periods = results.campaign.periods
    sampled = np.stack([_sample(history, shared, times, periods) for history in histories])
    for c, channel in enumerate(shared):
        sampled[:, :, c] = align_flights(sampled[:, :, c], periods[channel])
    return shared, simultaneous_band(sampled, CONFIDENCE)


def summarize(histories: Floats) -> Floats:
    """Return the largest, smallest, mean and last value of each channel [flight, summary]."""
    last = histories.shape[1] - 1 - np.argmax(np.isfinite(histories[:, ::-1]), axis=1)
    return np.hstack(
        [
            np.nanmax(histories, axis=1),
            np.nanmin(histories, axis=1),
            np.nanmean(histories, axis=1),
            np.take_along_axis(histories, last[:, np.newaxis], axis=1)[:, 0],
        ]
    )


def _place(label: str, names: Sequence[str], values: Floats, row: Floats) -> PlacedFlight:
    """Rank the values of one test flight."""
    pool = np.vstack([values, row])
    p_values = rank_p_values(pool)[-1]
    quantiles = np.quantile(values, [0.025, 0.5, 0.975], axis=0)
    return PlacedFlight(
        name=label,
        metrics=tuple(
            RankedMetric(
                metric=names[k],
                value=float(row[k]),
                rank=int(np.sum(values[:, k] < row[k])) + 1,
                low=float(quantiles[0, k]),
                median=float(quantiles[1, k]),
                high=float(quantiles[2, k]),
                p_value=float(p_values[k]),
            )
            for k in np.argsort(p_values, kind="stable").tolist()
        ),
        joint_p_value=joint_p_value(pool),
        band_p_value=None,
        leaves=None,
    )


def _locate(
    flight: PlacedFlight, band: Band, history: Floats, times: Floats, channels: Sequence[str]
) -> PlacedFlight:
    """Return a test flight that includes its history's p-value and first exit from the band."""
    outside = band.deviations(history) > band.factor
    leaves = None
    if outside.any():
        first = int(np.argmax(outside.any(axis=1)))
        leaves = Departure(channels[int(np.argmax(outside[first]))], float(times[first]))
    return replace(flight, band_p_value=band.p_value(history), leaves=leaves)


def _channel_bands(
    band: Band, simulated: Floats, tests: Floats, times: Floats, channels: Sequence[str]
) -> dict[str, ChannelBands]:
    bands = {}
    low, high = band.edges
    for c, channel in enumerate(channels):
        judged = np.isfinite(band.middle[:, c])
        ends = np.full((2, times.size), np.nan)
        ends[:, judged] = np.nanquantile(simulated[:, judged, c], [0.025, 0.975], axis=0)
        bands[channel] = ChannelBands(
            time=times,
            simultaneous=(low[:, c], high[:, c]),
            pointwise=(ends[0], ends[1]),
            flights=tuple(test[:, c] for test in tests),
        )
    return bands
