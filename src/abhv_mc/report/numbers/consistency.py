"""What lies in a campaign's folder held against each other: the flights are what everything else has to follow from.

Hashes say that a file is as its manifest says; whoever writes a folder anew writes them, too. Here its parts have to
fit: the campaign file, the samples, the flights, the manifest, the histories and the envelopes.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.campaign.file.resolve import read_own_campaign, resolve_campaign
from abhv_mc.execution.flight_counts import (
    FlightCounts,
    Mask,
    count_flights,
    flight_values,
    judge_requirements,
    make_flight_counts,
)
from abhv_mc.execution.retention import HistoryFile, list_histories
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.metrics import METRICS, Metric, Statistic
from abhv_mc.folder.flights import END_TIME, DamagedFileError, FlightRows, parse_block_name, read_block
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import COMPLETE
from abhv_mc.folder.samples import ROW_GROUP, SampleReader
from abhv_mc.folder.table_check import refusing
from abhv_mc.report.numbers.differences import differences
from abhv_mc.report.numbers.results import Envelope, Results
from abhv_mc.vehicle.arrays import Floats

_DRAWN = 1e-9  # relative; another machine's functions differ in last bits
_SINGLE = 1e-6  # relative; histories and envelopes are single precision
_EXTREMES = (Statistic.MAX_ABS, Statistic.MAX, Statistic.MIN)


@dataclass
class _Flown:
    """The flights of a folder, counted as the campaign counted them."""

    all_counts: dict[str, FlightCounts]
    done: dict[str, Mask]
    ends: dict[str, Floats]  # [flight] s, NaN where the flight was not computed
    metrics: dict[str, dict[str, Floats]]  # controller -> metrics that have a channel of their own -> [flight]


def find_contradictions(results: Results) -> Iterator[str]:
    """What in the folder does not fit the rest of it, one sentence each. Raises InputError for an unreadable file."""
    folder, manifest = CampaignFolder(results.folder), results.manifest
    campaign = read_own_campaign(folder)
    drawn, flown = SampleReader(folder.samples), _empty(campaign)
    if has_facts(manifest):
        yield from _campaign(campaign, manifest)
        yield from _samples(campaign, drawn)
    try:
        yield from _blocks(folder, campaign, drawn, flown)
    except DamagedFileError as error:
        yield f"flights/{error}"
        return
    counted, gapless = count_flights(flown.all_counts, flown.done)
    if not has_facts(manifest):
        yield from differences({"digest": manifest.get("digest")}, {"digest": counted["digest"]}, "", "the manifest")
        return
    yield from differences({key: manifest.get(key) for key in counted}, counted, "manifest", "the manifest")
    yield from _verdicts(campaign, manifest, flown, gapless)
    if manifest.get("state") == COMPLETE:  # what is made when all have flown
        yield from _envelopes(campaign, results, flown)
        yield from _histories(folder, replace(campaign, runs=gapless), results, flown)


def has_facts(manifest: Mapping[str, Any]) -> bool:
    """Whether the manifest is of a version that wrote all that is checked here; older ones wrote no hashes either."""
    return "files" in manifest


def _campaign(campaign: CheckedCampaign, manifest: Mapping[str, Any]) -> Iterator[str]:
    """The campaign file and its inputs are those that the manifest names."""
    resolved = resolve_campaign(campaign)
    inputs = manifest.get("inputs") or {}
    if replace(resolved, hashes=inputs | resolved.hashes).identity != manifest.get("campaign_hash"):
        yield "campaign.yaml: another campaign (with its inputs) than the manifest's campaign_hash"
    yield from differences(inputs, inputs | resolved.hashes, "inputs", "the manifest")
    facts = {"name": campaign.model.name, "seed": campaign.model.seed, "runs_planned": campaign.runs}
    yield from differences({key: manifest.get(key) for key in facts}, facts, "manifest", "the manifest")


def _samples(campaign: CheckedCampaign, drawn: SampleReader) -> Iterator[str]:
    """The samples are those that the campaign's seed, design and dispersions give."""
    source = campaign.make_samples()
    if drawn.names != tuple(source.names) or drawn.flights != campaign.runs:
        yield "samples.parquet: other parameters or flights than the campaign's"
        return
    for first in range(0, campaign.runs, ROW_GROUP):
        part = first, min(first + ROW_GROUP, campaign.runs)
        if not np.allclose(drawn.rows(*part), source.draw(*part), rtol=_DRAWN, atol=0.0, equal_nan=True):
            yield "samples.parquet: not what the campaign's seed and dispersions draw"
            return


def _empty(campaign: CheckedCampaign) -> _Flown:
    names = tuple(campaign.model.controllers)
    return _Flown(
        make_flight_counts(campaign),
        {name: np.zeros(campaign.runs, bool) for name in names},
        {name: np.full(campaign.runs, np.nan) for name in names},
        {name: {metric.name: np.full(campaign.runs, np.nan) for metric in _CHANNEL_OF} for name in names},
    )


def _blocks(folder: CampaignFolder, campaign: CheckedCampaign, drawn: SampleReader, flown: _Flown) -> Iterator[str]:
    """Each block is whole, of this campaign and its samples, and no flight is there twice. Raises DamagedFileError."""
    columns = tuple(signal.name for signal in flight_values(campaign))
    for path in sorted(folder.flights.glob("*.parquet")):
        controller, first, stop = parse_block_name(path)
        done = flown.done.get(controller)
        if done is None or stop > campaign.runs or done[first:stop].any():
            yield f"flights/{path.name}: belongs to no part of this campaign"
            continue
        block = read_block(path, drawn.names)
        if block.columns != columns:
            yield f"flights/{path.name}: other metrics than the campaign's"
            continue
        if not np.array_equal(drawn.rows(first, stop), block.samples, equal_nan=True):
            yield f"flights/{path.name}: other samples than those of samples.parquet"
        _count(block, flown)


def _count(block: FlightRows, flown: _Flown) -> None:
    counts, here = flown.all_counts[block.controller], slice(block.first, block.stop)
    counts.add(block, block.digest())
    flown.done[block.controller][here] = True
    computed = ~counts.uncomputed[here]
    kept = {END_TIME.name: flown.ends[block.controller], **flown.metrics[block.controller]}
    for name, values in kept.items():
        values[here] = np.where(computed, block.values[:, block.columns.index(name)], np.nan)


def _verdicts(campaign: CheckedCampaign, manifest: Mapping[str, Any], flown: _Flown, gapless: int) -> Iterator[str]:
    """Verdicts are those of the flights, of which ``gapless`` have no gap."""
    if manifest.get("state") == COMPLETE and gapless < campaign.runs and not campaign.model.stop:
        yield f"manifest.state: complete, but flight {gapless} is missing"
    judged = json.loads(json.dumps(judge_requirements(flown.all_counts, campaign)))
    yield from differences(manifest.get("requirements"), judged, "manifest.requirements", "the manifest")


# --- histories and envelopes: what of them a metric of the flight or a count says again


_CHANNEL_OF: dict[Metric, str] = {
    metric: metric.of
    for metric in METRICS
    if metric.of in CHANNEL_INDEX and not metric.settled and metric.statistic in (*_EXTREMES, Statistic.FINAL)
}


def _extreme(metric: Metric, low: Floats, high: Floats) -> float:
    """What the metric is where its channel has these smallest and largest values."""
    least, most = float(np.nanmin(low)), float(np.nanmax(high))
    if metric.statistic == Statistic.MIN:
        return least
    value = max(abs(least), abs(most)) if metric.statistic == Statistic.MAX_ABS else most
    return max(value, 0.0) if metric.never_negative else value


def _beyond(metric: Metric, value: float, whole: float) -> float:
    """By how much a value, single precision, exceeds that of all ticks: more than 0 where it cannot be one of them."""
    excess = whole - value if metric.statistic == Statistic.MIN else value - whole
    return excess - _SINGLE * max(abs(whole), abs(value))


def _envelopes(campaign: CheckedCampaign, results: Results, flown: _Flown) -> Iterator[str]:
    """The envelopes are of these controllers, channels, times and numbers of flights, and reach their extremes."""
    keep = campaign.model.keep.envelopes
    wanted = {(name, channel) for name in campaign.model.controllers for channel in keep.channels}
    if results.envelopes.keys() != wanted:
        yield "envelopes.parquet: other controllers or channels than the campaign keeps"
        return
    every_tick = (results.manifest.get("machine") or {}).get("device") == "cpu"
    for (name, channel), envelope in results.envelopes.items():
        place = f"envelopes.parquet: {channel} of {name}"
        ends = np.sort(flown.ends[name][~np.isnan(flown.ends[name])])
        if not np.allclose(envelope.time, np.arange(len(envelope.time)) / keep.rate, rtol=1e-9, atol=1e-9):
            yield f"{place}: times that are not {keep.rate:g} a second"
            continue
        slack = 1e-6 * (1.0 + envelope.time)  # one that broke at its last tick has no value there
        most = len(ends) - np.searchsorted(ends, envelope.time - slack)
        least = len(ends) - np.searchsorted(ends, envelope.time + slack)
        if (envelope.count > most).any() or (envelope.count < least).any():
            yield f"{place}: other numbers of flights still flying than the flights' end times give"
        for metric, held in _CHANNEL_OF.items():
            values = flown.metrics[name][metric.name]
            if held != channel or metric.statistic not in _EXTREMES or np.isnan(values).all():
                continue
            whole = _extreme(metric, values, values)
            value = _extreme(metric, envelope.bands["min"], envelope.bands["max"])
            if _beyond(metric, value, whole) > 0.0 or (every_tick and _beyond(metric, whole, value) > 0.0):
                yield f"{place}: {value:.7g} at most (or least), but {metric.name} of the flights is {whole:.7g}"


def _histories(folder: CampaignFolder, campaign: CheckedCampaign, results: Results, flown: _Flown) -> Iterator[str]:
    """The histories are of the flights that the campaign keeps, as long as they, and within their extremes."""
    known = FileHashes(folder.root, results.manifest.get("files") or {})
    wanted = list_histories(folder, campaign, flown.all_counts, known)
    there = set(folder.histories.glob("*.parquet"))
    for path in sorted(there - {file.path for file in wanted}):
        yield f"histories/{path.name}: no file of histories that the campaign keeps"
    for file in wanted:
        if file.path not in there:
            yield f"histories/{file.path.name}: missing"
        else:
            yield from _history_file(file, campaign, results, flown)


def _history_file(file: HistoryFile, campaign: CheckedCampaign, results: Results, flown: _Flown) -> Iterator[str]:
    keep, place = campaign.model.keep.histories, f"histories/{file.path.name}"
    with refusing(file.path):
        table = pq.read_table(file.path, partitioning=None)
    channels = [name for name in table.column_names if name not in ("flight", "controller", "time")]
    numbers = table["flight"].to_numpy()
    if set(table["controller"].to_pylist()) != {file.controller} or np.unique(numbers).tolist() != file.flights:
        yield f"{place}: other flights than the campaign keeps of {file.controller}"
        return
    if channels != list(keep.channels):
        yield f"{place}: other channels than the campaign keeps"
        return
    starts = [*np.flatnonzero(np.diff(numbers, prepend=-1)), len(numbers)]
    if len(starts) != len(file.flights) + 1:
        yield f"{place}: rows of a flight that are not together"
        return
    columns = {name: table[name].to_numpy().astype(np.float64) for name in channels}
    times = table["time"].to_numpy()
    for flight, first, stop in zip(file.flights, starts[:-1], starts[1:], strict=True):
        held = {name: values[first:stop] for name, values in columns.items()}
        yield from (
            f"{place}: flight {flight}: {words}"
            for words in _history(flight, times[first:stop], held, file.controller, keep.rate, results, flown)
        )


def _history(
    flight: int, times: Floats, held: dict[str, Floats], name: str, rate: float, results: Results, flown: _Flown
) -> Iterator[str]:
    """What of one history does not fit its flight's row, or the envelopes."""
    end = flown.ends[name][flight]
    if not np.allclose(times, np.arange(len(times)) / rate, rtol=1e-9, atol=1e-9):
        yield f"times that are not {rate:g} a second"
        return
    if not end - 2.0 / rate < times[-1] <= end + 1e-6 * (1.0 + end):
        yield f"ends at {times[-1]:g} s, but the flight at {end:g} s"
        return
    for metric, channel in _CHANNEL_OF.items():
        if channel not in held:
            continue
        whole, values = flown.metrics[name][metric.name][flight], held[channel]
        if metric.statistic == Statistic.FINAL:
            apart = abs(values[-1] - whole) - _SINGLE * abs(whole) if abs(times[-1] - end) < 1e-6 else 0.0
            value = float(values[-1])
        else:
            value = _extreme(metric, values, values)
            apart = _beyond(metric, value, whole)
        if not apart <= 0.0:
            yield f"{channel} reaches {value:.7g}, but its {metric.name} is {whole:.7g}"
    for channel, values in held.items():
        envelope = results.envelopes.get((name, channel))
        if envelope is not None and not _is_within(times, values, envelope):
            yield f"{channel} leaves the envelope of all flights"


def _is_within(times: Floats, values: Floats, envelope: Envelope) -> bool:
    """Whether a history stays between the extremes of the bins before and after each of its times: it is in both."""
    before = np.searchsorted(envelope.time, times + 1e-9, side="right") - 1
    bins = np.stack([before, np.minimum(before + 1, len(envelope.time) - 1)])
    low, high = np.fmax.reduce(envelope.bands["min"][bins]), np.fmin.reduce(envelope.bands["max"][bins])
    slack = _SINGLE * np.abs(values)
    return bool(((values >= low - slack) & (values <= high + slack)).all())
