"""Import of a table of flights that another simulator computed into a campaign's folder."""

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import Executor
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.execution.runner import RunResult, fly_opened
from abhv_mc.execution.setup import OpenCampaign, make_manifest
from abhv_mc.execution.table_draws import check_draws
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import END_TIME, Digest, FlightRows, flights_schema, write_block
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.inputs import (
    FolderInputs,
    collect_inputs,
    describe_changes,
    read_folder_inputs,
)
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import RUNNING, Manifest, write_manifest
from abhv_mc.folder.opening import FlownFolder, begin_folder, open_folder
from abhv_mc.folder.samples import SampleReader, write_samples
from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.units import parse_in_any_unit

_ROWS = 65536  # of a piece
_HEAD = re.compile(r"(.*?)\s*(?:\[(.*)\]\s*)?")
_OTHERS = {
    "system": ("system", "controller"),
    "outcome": ("outcome",),
    "end": ("end_time", END_TIME.name),
    "flight": ("flight",),
}
_Piece = tuple[
    FlightRows, NDArray[np.int64]
]  # flights of one system one after another, and their lines in the table


def adopt_table(
    table: Path, campaign_file: Path, out: Path | None = None, fresh: bool = False
) -> RunResult:
    """Import the flights of ``table`` into the folder of a campaign without a simulator, or finish doing so.

    Requirements get verdicts only if the table holds independent draws as far as tests show. Raises InputError, with
    the row.
    """
    campaign = read_campaign(campaign_file, runs=1)
    if campaign.can_rerun:
        wish = "one with 'inputs', without a simulator"
        raise campaign.document.error((), "a campaign whose flights abhv-mc computes", wish)
    columns = _find_columns(table, campaign)
    pieces = list(_read(table, columns, campaign))
    samples, lines = _join_samples(table, campaign, pieces)
    campaign = read_campaign(campaign_file, runs=len(samples))
    factors = columns.factors[: len(campaign.inputs)]
    reasons = check_draws(table, campaign, samples, factors, lines)
    if reasons:
        campaign = _without_verdicts(campaign)
    inputs = collect_inputs(campaign)
    blocks = [rows for rows, _ in pieces]
    with ExitStack() as stack:
        stack.enter_context(sigterm_as_interrupt())
        folder = CampaignFolder(out or Path("reports") / campaign.name)
        flown = open_folder(folder, fresh, stack)
        if flown is not None:
            _check_same(flown, inputs, samples)
            manifest, files = flown.manifest, flown.files
        else:
            files = begin_folder(folder, inputs, {}, stack)
            write_samples(
                folder.samples,
                campaign.inputs,
                len(samples),
                lambda first, stop: samples[first:stop],
                {"table": table.name},
                table=campaign.parameters,
            )
            manifest = make_manifest(campaign, inputs, {}, reasons)
            manifest = replace(manifest, files=files.listed())
            write_manifest(folder.manifest, manifest)
        if manifest.complete and not _is_of(manifest, blocks):
            found = "a folder that holds the flights of another table"
            raise InputError(folder.root, found, "another folder (-o DIR), or --fresh")
        if not (manifest.complete and _is_whole(folder, files)):
            _write_blocks(folder, files, campaign, blocks, table.name)
            manifest = replace(manifest, state=RUNNING)
        opened = OpenCampaign(folder, campaign, manifest, campaign.controllers, files)
        return fly_opened(opened, Executor(campaign.simulator.engine.fly, 1))


def _without_verdicts(campaign: Experiment) -> Experiment:
    """Return the campaign as one whose flights are no independent draws."""
    data: Any = campaign.document.data
    document = replace(campaign.document, data={**data, "independent": False})
    model = campaign.model.model_copy(update={"independent": False})
    return replace(campaign, document=document, model=model)


def _check_same(flown: FlownFolder, inputs: FolderInputs, samples: Floats) -> None:
    """Raise InputError if a folder holds another campaign, or the inputs of another table."""
    before = read_folder_inputs(flown.folder, flown.manifest)
    changes = describe_changes(before, inputs, extensible=False)
    if flown.manifest.search:
        changes = ["the flights of a search"]
    elif not changes:
        held = SampleReader(flown.folder.samples)
        if not np.array_equal(held.rows(0, held.flights), samples):
            changes = ["samples: the inputs of another table"]
    if changes:
        found = "a folder that holds another campaign:\n  " + "\n  ".join(changes)
        raise InputError(flown.folder.root, found, "another folder (-o DIR), or --fresh")


def _is_of(manifest: Manifest, blocks: list[FlightRows]) -> bool:
    """Return whether a complete folder holds these flights."""
    return manifest.digest == str(sum((block.digest() for block in blocks), Digest()))


def _is_whole(folder: CampaignFolder, files: FileHashes) -> bool:
    paths = [path for path in files.paths() if path.parent == folder.flights]
    return not any(files.damage(path) for path in paths)


def _write_blocks(
    folder: CampaignFolder,
    files: FileHashes,
    campaign: Experiment,
    blocks: list[FlightRows],
    source: str,
) -> None:
    """Write the flights, in place of those of a run that was interrupted."""
    stale = list(folder.flights.glob("*.parquet"))
    files.forget(*stale)
    for path in stale:
        path.unlink()
    schema = flights_schema(
        campaign.inputs,
        {"table": source},
        (*campaign.measured, END_TIME),
        campaign.parameters,
        campaign.outcomes,
    )
    for block in blocks:
        write_block(folder.flights, block, schema)


class _Columns(NamedTuple):
    """Where in a table stands what is needed."""

    names: tuple[str, ...]  # of the inputs, then of the metrics, in the table's words
    factors: Floats  # [column] to the declared unit
    others: Mapping[str, str]  # what else there is: system, outcome, end, flight


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() in (".parquet", ".pq")


def _find_columns(path: Path, campaign: Experiment) -> _Columns:
    """Raises InputError where one is missing, or has a unit that is none of its own."""
    try:
        heads = (pq.read_schema(path) if _is_parquet(path) else pc.open_csv(path).schema).names
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InputError(path, f"a table that cannot be read ({error})", "CSV or Parquet") from None
    split = {head: _HEAD.fullmatch(head.strip()).groups() for head in heads}  # type: ignore[union-attr]
    found = {name: (head, unit) for head, (name, unit) in split.items()}
    if len(found) < len(heads):
        twice = [split[head][0] for head in heads]
        name = next(name for name in twice if twice.count(name) > 1)
        raise InputError(
            path, f"{twice.count(name)} columns '{name}'", "one of each name, its unit aside", 1
        )
    units = {name: campaign.parameters[name].unit for name in campaign.inputs}
    units |= {metric.name: metric.unit for metric in campaign.measured}
    names, factors = [], []
    for name, unit in units.items():
        if name not in found:
            raise InputError(
                path,
                f"no column '{name}'",
                f"one for each input and metric ({one_of(found, name)})",
                1,
            )
        head, given = found[name]
        try:
            factors.append(
                parse_in_any_unit(f"1 {given}", unit) if given and given != unit else 1.0
            )
        except Refusal as refusal:
            raise InputError(path, f"'{head}': {refusal.found}", refusal.expected, 1) from None
        names.append(head)
    others = {
        key: found[name][0]
        for key, several in _OTHERS.items()
        for name in several[::-1]
        if name in found
    }
    if "system" not in others and len(campaign.controllers) > 1:
        raise InputError(
            path,
            "no column 'system'",
            f"the system of each flight: {', '.join(campaign.controllers)}",
            1,
        )
    return _Columns(tuple(names), np.array(factors), others)


def _batches(path: Path, columns: _Columns) -> Iterator[dict[str, Any]]:
    """The table's columns by their heads, some rows at a time: numbers, nan where there is none, and words."""
    words = [columns.others[key] for key in ("system", "outcome") if key in columns.others]
    kinds = dict.fromkeys((*columns.names, *columns.others.values()), pa.float64()) | dict.fromkeys(
        words, pa.string()
    )
    try:
        if _is_parquet(path):
            batches = pq.ParquetFile(path).iter_batches(_ROWS, columns=list(kinds))
        else:
            options = pc.ConvertOptions(
                column_types=kinds, include_columns=list(kinds), strings_can_be_null=True
            )
            batches = pc.open_csv(path, pc.ReadOptions(block_size=1 << 22), convert_options=options)
        for batch in batches:
            held = zip(batch.schema.names, batch.columns, strict=True)
            filled = {
                name: each.cast(kinds[name]).fill_null("" if name in words else np.nan)
                for name, each in held
            }
            yield {
                name: np.array(each.to_numpy(zero_copy_only=False)) for name, each in filled.items()
            }
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(path, str(error).splitlines()[0], "a table of numbers") from None


def _read(path: Path, columns: _Columns, campaign: Experiment) -> Iterator[_Piece]:
    """The table by system. Raises InputError for a row that makes no sense, with its line."""
    done, width, line = dict.fromkeys(campaign.controllers, 0), len(campaign.inputs), 2
    names = *(metric.name for metric in campaign.measured), END_TIME.name
    ok, lost = Outcome.OK.code, Outcome.FAILED_TO_RUN.code
    for batch in _batches(path, columns):
        values = np.column_stack([batch[name] for name in columns.names]) * columns.factors
        given = {key: batch[name] for key, name in columns.others.items()}
        rows = line + np.arange(len(values))
        line += len(values)
        system = given.get("system", np.full(len(values), campaign.controllers[0], object))
        outcome = given.get("outcome", np.full(len(values), ok, object))
        for key, words, choices in (
            ("system", system, done),
            ("outcome", outcome, campaign.outcomes.numbers),
        ):
            if (at := _first(~np.isin(words, list(choices)))) is not None:
                head = columns.others[key]
                raise InputError(
                    path, f"{head} '{words[at]}'", one_of(choices, words[at]), int(rows[at])
                )
        samples, metrics = values[:, :width], values[:, width:]
        if (at := _first(~np.isfinite(samples).all(axis=1))) is not None:
            raise InputError(
                path, "an input that is no number", "a number in each cell", int(rows[at])
            )
        outcome[(outcome == ok) & ~np.isfinite(metrics).all(axis=1)] = lost
        metrics[outcome == lost] = np.nan
        end = given.get("end", np.full(len(values), np.nan))
        end[np.isnan(end) & (outcome != ok) & (outcome != lost)] = 0.0
        table = np.column_stack([metrics, end])
        for name in campaign.controllers:
            own, first = np.flatnonzero(system == name), done[name]
            done[name] += own.size
            numbers = given["flight"][own] if "flight" in given else np.arange(first, done[name])
            if (at := _first(numbers != np.arange(first, done[name]))) is not None:
                wish = f"flight {first + at}: those of a system from 0 on, in their order"
                raise InputError(path, f"another flight of '{name}'", wish, int(rows[own[at]]))
            if own.size:
                flown = (
                    name,
                    first,
                    campaign.inputs,
                    samples[own],
                    tuple(outcome[own].tolist()),
                    table[own],
                    names,
                )
                yield FlightRows(*flown), rows[own]


def _first(wrong: Any) -> int | None:
    """The first of some rows; None without any."""
    return int(np.argmax(wrong)) if wrong.any() else None


def _join_samples(
    path: Path, campaign: Experiment, pieces: list[_Piece]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the samples [flight, input], equal for all systems, and the lines [flight] of those of the first.

    Raises InputError.
    """
    counts = {
        name: sum(len(each.samples) for each, _ in pieces if each.controller == name)
        for name in campaign.controllers
    }
    if len(set(counts.values())) > 1 or not pieces:
        words = ", ".join(f"{count} of '{name}'" for name, count in counts.items())
        raise InputError(path, f"flights: {words}", "as many of each system, one at least")
    first = [piece for piece in pieces if piece[0].controller == campaign.controllers[0]]
    samples = np.concatenate([rows.samples for rows, _ in first])
    for each, rows in pieces:
        if (
            at := _first((samples[each.first : each.stop] != each.samples).any(axis=1))
        ) is not None:
            found = f"flight {each.first + at} of '{each.controller}' with other inputs than of another system"
            wish = "the same inputs for all systems, or a folder for each"
            raise InputError(path, found, wish, int(rows[at]))
    return samples, np.concatenate([lines for _, lines in first])
