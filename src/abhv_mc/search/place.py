"""Comparison of test flights with simulated flights under the same conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign, read_histories
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import notify
from abhv_mc.search.flight_records import Programme, sample
from abhv_mc.statistics.circular import align_flights
from abhv_mc.statistics.placement import (
    CONFIDENCE,
    Band,
    judge_set,
    simultaneous_band,
)

FEWEST_FLIGHTS = 39  # minimum number of flights for a simultaneous 95 % band
SETS = 199  # number of simulated sets of flights
_SUMMARIES = ("largest", "smallest", "mean", "last")


@dataclass(frozen=True)
class RankedMetric:
    """Metric of a test flight, ranked among the simulated flights under the same conditions."""

    metric: str
    rank: int  # rank of the test flight, 1 for the smallest value
    value: float
    low: float  # 2.5 % quantile of the simulated flights
    median: float
    high: float
    p_value: float  # two-sided p-value of this value alone


@dataclass(frozen=True)
class Departure:
    """First exit of a history from the simultaneous band."""

    channel: str
    time_s: float


@dataclass(frozen=True)
class PlacedFlight:
    """Comparison of one test flight with the simulated flights."""

    name: str
    vehicle: str
    metrics: tuple[RankedMetric, ...]  # ranked metrics, smallest p-value first
    p_value: float  # p-value of all metrics and the history, corrected for the number of flights
    leaves: Departure | None
    offset_s: float  # time by which the record's clock is ahead of the simulation
    covers: tuple[float, float] | None  # times of the first and last sample of a history, s


@dataclass(frozen=True)
class Placement:
    """Comparison of test flights with the simulated flights of one controller."""

    controller: str
    simulated: int  # number of simulated sets
    vehicles: int
    by_vehicle: tuple[str, ...]  # dispersions that the flights of a vehicle share
    measured: tuple[str, ...]  # measured parameters, which condition the simulated flights
    noise: Mapping[str, float]  # standard deviations of the declared measurement errors
    sensed: tuple[str, ...]  # channels to which errors of the campaign's sensors were added
    ignored: tuple[str, ...]  # columns of the test files that are not used
    spread: tuple[str, ...]  # channels without a band where the flights spread over the circle
    flights: tuple[PlacedFlight, ...]
    together_p_value: float | None  # joint p-value of several test flights
    times: Floats  # times of the bands, s
    # by channel, the edges [time] of a simultaneous band that contains the bands of all flights,
    # and the test flights [flight, time]
    bands: Mapping[str, tuple[Floats, Floats, Floats]]


def place_flights(
    campaign: Path,
    files: Sequence[Path],
    controller: str | None = None,
    noise: Mapping[str, float] | None = None,
    *,
    sets: int = SETS,
    engine: Engine | None = None,
) -> Placement:
    """Compare test flights with simulated sets of flights of the same vehicles.

    The largest, smallest, mean and last value of each channel are compared, and the history with
    the simultaneous band; or metrics, if the files contain no histories. `noise` is that of
    :class:`Programme`. Raise InputError if flights cannot be compared.
    """
    programme = Programme(campaign, files, controller, noise, engine)
    rows, names, times = programme.draw(sets), programme.names, programme.times
    notify(f"simulating {sets * rows.shape[1]} flights ({sets} sets of {rows.shape[1]})")
    with programme.open() as simulate:
        simulated = simulate(rows, True)
    count = np.isfinite(simulated).sum(axis=(0, 1, 2))
    tests = programme.align(simulated)
    spread = np.isfinite(simulated).sum(axis=(0, 1, 2)) < count
    pool = np.concatenate([simulated, tests[None]])
    pool[:, ~np.isfinite(tests)] = np.nan  # Simulated flights have the gaps of the test flights.
    bands = []
    scores, labels, values = np.zeros(pool.shape[:2]), list(names), pool[:, :, 0]
    if programme.is_history:
        values = summarize(pool)
        labels = [f"{name}, {summary}" for summary in _SUMMARIES for name in names]
        bands = [simultaneous_band(pool[:-1, k]) for k in range(len(tests))]
        deviations = [band.deviations(pool[-1, k]).max() for k, band in enumerate(bands)]
        scores = np.vstack([np.transpose([band.scores for band in bands]), deviations])
    result = judge_set(values, scores)
    factor = np.sort(np.append(scores[:-1].max(axis=1), inf))[ceil(CONFIDENCE * (sets + 1)) - 1]
    has_values = np.isfinite(values[:-1]).any(axis=0) & np.isfinite(values[-1])
    simulated, own = np.where(has_values, values, 0.0)[:-1], values[-1]
    ranks = (simulated < own).sum(axis=0) + 1
    ends = np.nanquantile(simulated, [0.025, 0.5, 0.975], axis=0)
    numbers = np.stack([own, *ends, result.columns], axis=2)
    flights = []
    for k, record in enumerate(programme.records):
        leaves = covers = None
        if bands:
            valid = times[np.isfinite(tests[k]).any(axis=1)]
            covers = float(valid[0]), float(valid[-1])
            for time, channel in np.argwhere(bands[k].deviations(tests[k]) > factor)[:1]:
                leaves = Departure(names[channel], float(times[time]))
        order = np.argsort(result.columns[k], kind="stable")
        flights.append(
            PlacedFlight(
                name=record.name,
                vehicle=record.vehicle,
                metrics=tuple(
                    RankedMetric(labels[i], int(ranks[k, i]), *numbers[k, i].tolist())
                    for i in order[has_values[k, order]]
                ),
                p_value=float(result.flights[k]),
                leaves=leaves,
                offset_s=record.offset,
                covers=covers,
            )
        )
    edges = np.array([band._replace(factor=factor).edges for band in bands])
    return Placement(
        controller=programme.controller,
        simulated=sets,
        vehicles=len({*programme.vehicles}),
        by_vehicle=programme.by_vehicle,
        measured=programme.measured,
        noise=programme.noise,
        sensed=tuple(programme.sensors),
        ignored=programme.ignored,
        spread=tuple(np.array(names)[spread].tolist()),
        flights=tuple(flights),
        together_p_value=result.together if len(tests) > 1 else None,
        times=times,
        bands={
            name: (
                np.fmin.reduce(edges[..., i], axis=(0, 1)),
                np.fmax.reduce(edges[..., i], axis=(0, 1)),
                tests[:, :, i],
            )
            for i, name in enumerate(names if bands else ())
            if not np.isnan(edges[..., i]).all()
        },
    )


def summarize(histories: Floats) -> Floats:
    """Return the largest, smallest, mean and last value of each channel [..., summary].

    The result is NaN for a channel of `histories` [..., time, channel] without values.
    """
    is_known = np.isfinite(histories)
    last = histories.shape[-2] - 1 - np.argmax(is_known[..., ::-1, :], axis=-2, keepdims=True)
    with np.errstate(invalid="ignore"):
        mean = np.nansum(histories, axis=-2) / is_known.sum(axis=-2)
    return np.concatenate(
        [
            np.fmax.reduce(histories, axis=-2),
            np.fmin.reduce(histories, axis=-2),
            mean,
            np.take_along_axis(histories, last, axis=-2)[..., 0, :],
        ],
        axis=-1,
    )


def find_band(
    results: FlownCampaign, controller: str, channels: Sequence[str], times: Floats
) -> tuple[list[str], Band] | None:
    """Return the channels that have histories, and the simultaneous band of these channels.

    Return None if there is no such channel or if there are too few random histories.
    """
    if not results.campaign.independent:
        return None
    steps = [  # Randomly sampled flights are those stored regardless of the outcome.
        int(text.removeprefix("every ").replace("all", "1"))
        for text in map(str, results.campaign.model.keep.histories.flights)
        if text.startswith(("all", "every "))
    ]
    stored = read_histories(results.folder, controller) if steps else {}
    histories = [stored[k] for k in sorted(stored) if any(k % step == 0 for step in steps)]
    shared = [name for name in channels if histories and name in histories[0]]
    if len(histories) < FEWEST_FLIGHTS or not shared:
        return None
    periods = results.campaign.periods
    sampled = np.stack([sample(history, shared, times, periods) for history in histories])
    for c, channel in enumerate(shared):
        sampled[:, :, c] = align_flights(sampled[:, :, c], periods[channel])
    return shared, simultaneous_band(sampled)
