"""Flights that somebody else has flown: a table of them becomes a campaign's folder, which is judged like any other.

The table is read twice, a piece at a time: once to prove it, once to write it.
"""

import csv
import re
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import outside
from abhv_mc.execution.executor import Executor
from abhv_mc.execution.runner import RunResult, fly_opened
from abhv_mc.execution.setup import OpenCampaign, make_manifest
from abhv_mc.flight.outcome import Outcome
from abhv_mc.folder.flights import END_TIME, FlightRows, flights_schema, write_block
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import INTERRUPTED, write_manifest
from abhv_mc.folder.opening import begin_folder, open_folder
from abhv_mc.folder.samples import write_samples
from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.units import parse_in_any_unit
from abhv_mc.simulators.engine import engine_of

_ROWS = 65536  # of a piece
_HEAD = re.compile(r"(.*?)\s*(?:\[(.*)\]\s*)?")
_ENDS = ("end_time", END_TIME.name)


class _Piece(NamedTuple):
    """Some rows of one system, one after another."""

    system: str
    first: int  # flight
    rows: np.ndarray  # their lines in the table
    samples: Floats  # [flight, input]
    outcome: tuple[str, ...]
    values: Floats  # [flight, metric], then the end


def adopt_table(table: Path, campaign_file: Path, out: Path | None = None, fresh: bool = False) -> RunResult:
    """Make a folder of the flights of ``table`` by a campaign without a simulator. Raises InputError, with the row."""
    campaign = read_campaign(campaign_file, runs=1)
    if not campaign.adopted:
        raise campaign.document.error(
            (), "a campaign that is flown by itself", "one with 'inputs', without a simulator"
        )
    columns = _find_columns(table, campaign)
    with ExitStack() as stack:
        spool = stack.enter_context(tempfile.TemporaryFile())
        counts = _prove(columns, campaign, spool)
        flights = next(iter(counts.values()))
        campaign = read_campaign(campaign_file, runs=flights)
        folder = CampaignFolder(out or Path("reports") / campaign.name)
        if open_folder(folder, fresh, stack) is not None:
            raise InputError(folder.root, "a folder that holds flights", "another one (-o DIR), or --fresh")
        inputs, engine = collect_inputs(campaign), engine_of(campaign)
        files = begin_folder(folder, inputs, {}, stack)
        width = len(campaign.inputs)
        write_samples(
            folder.samples,
            campaign.inputs,
            flights,
            lambda first, stop: _read_spool(spool, width, first, stop - first),
            {"table": table.name},
            table=campaign.parameters,
        )
        names = tuple(metric.name for metric in campaign.measured)
        values, ends = (*campaign.measured, END_TIME), campaign.outcomes
        schema = flights_schema(campaign.inputs, {"table": table.name}, values, campaign.parameters, ends)
        for piece in _read(columns, campaign):
            rows = FlightRows(
                piece.system, piece.first, campaign.inputs, piece.samples, piece.outcome, piece.values,
                (*names, END_TIME.name),
            )  # fmt: skip
            write_block(folder.flights, rows, schema)
        manifest = replace(make_manifest(campaign, inputs, engine, {}, ()), state=INTERRUPTED, files=files.listed())
        write_manifest(folder.manifest, manifest)
        opened = OpenCampaign(folder, campaign, manifest, campaign.controllers, files)
        return fly_opened(opened, engine, Executor(engine.fly, 1))


@dataclass(frozen=True)
class _Columns:
    """Where in a table stands what is needed."""

    path: Path
    names: tuple[str, ...]  # of the inputs, then of the metrics, in the table's words
    factors: Floats  # [column] to the declared unit
    system: str | None
    outcome: str | None
    end: str | None
    flight: str | None

    def pieces(self) -> Iterator[pa.RecordBatch]:
        """The table's rows, some at a time. Raises InputError."""
        words = [name for name in (self.system, self.outcome) if name]
        numbers = [*self.names, *(name for name in (self.end, self.flight) if name)]
        kinds = {**dict.fromkeys(words, pa.string()), **dict.fromkeys(numbers, pa.float64())}
        try:
            if self.path.suffix.lower() in (".parquet", ".pq"):
                with pq.ParquetFile(self.path) as file:
                    for batch in file.iter_batches(_ROWS, columns=list(kinds)):
                        yield batch.cast(pa.schema([(name, kinds[name]) for name in batch.schema.names]))
            else:
                options = pc.ConvertOptions(column_types=kinds, include_columns=list(kinds), strings_can_be_null=True)
                blocks = pc.ReadOptions(block_size=1 << 24)
                yield from pc.open_csv(self.path, read_options=blocks, convert_options=options)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise InputError(self.path, str(error).splitlines()[0], "a table of numbers") from None


def _find_columns(path: Path, campaign: Experiment) -> _Columns:
    """Raises InputError where one is missing, or has a unit that is none of its own."""
    try:
        if path.suffix.lower() in (".parquet", ".pq"):
            heads = pq.read_schema(path).names
        else:
            with path.open(encoding="utf-8-sig", newline="") as file:
                heads = next(csv.reader(file), [])
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InputError(path, f"a table that cannot be read ({error})", "CSV or Parquet") from None
    found: dict[str, tuple[str, str]] = {}
    for head in heads:
        name, unit = _HEAD.fullmatch(head.strip()).groups()  # type: ignore[union-attr]
        found[name] = head, unit or ""
    names, factors = [], []
    units = {name: campaign.parameters[name].unit for name in campaign.inputs}
    units |= {metric.name: metric.unit for metric in campaign.measured}
    for name, unit in units.items():
        if name not in found:
            raise InputError(path, f"no column '{name}'", f"one for each input and metric ({one_of(found, name)})", 1)
        head, given = found[name]
        try:
            factors.append(parse_in_any_unit(f"1 {given}", unit) if given not in ("", unit) else 1.0)
        except Refusal as refusal:
            raise InputError(path, f"'{head}': {refusal.found}", refusal.expected, 1) from None
        names.append(head)
    system, outcome, end, flight = (
        next((found[name][0] for name in several if name in found), None)
        for several in (("system", "controller"), ("outcome",), _ENDS, ("flight",))
    )
    if system is None and len(campaign.controllers) > 1:
        raise InputError(path, "no column 'system'", f"the system of each flight: {', '.join(campaign.controllers)}", 1)
    return _Columns(path, tuple(names), np.array(factors), system, outcome, end, flight)


def _read(columns: _Columns, campaign: Experiment) -> Iterator[_Piece]:
    """The table by system. Raises InputError for a row that makes no sense, with its line."""
    done = dict.fromkeys(campaign.controllers, 0)
    known, line, inputs = set(campaign.outcomes.numbers), 2, len(campaign.parameters.records)
    ok, lost = Outcome.OK.code, Outcome.FAILED_TO_RUN.code
    for batch in columns.pieces():
        rows = line + np.arange(batch.num_rows)
        line += batch.num_rows
        values = np.column_stack([_numbers(batch, name) for name in columns.names]) * columns.factors
        end = _numbers(batch, columns.end) if columns.end else np.full(len(rows), np.nan)
        system = _words(batch, columns.system, campaign.controllers[0])
        outcome = _words(batch, columns.outcome, ok)
        for column, words, choices in ((columns.system, system, done), (columns.outcome, outcome, known)):
            strange = ~np.isin(words, list(choices))
            if strange.any():
                at = int(np.argmax(strange))
                raise InputError(columns.path, f"{column} '{words[at]}'", one_of(choices, words[at]), int(rows[at]))
        samples, metrics = values[:, :inputs], values[:, inputs:]
        if (bad := ~np.isfinite(samples).all(axis=1)).any():
            at = int(np.argmax(bad))
            raise InputError(columns.path, "an input that is no number", "a number in each cell", int(rows[at]))
        outcome[(outcome == ok) & ~np.isfinite(metrics).all(axis=1)] = lost
        metrics[outcome == lost] = np.nan
        end[np.isnan(end) & (outcome != ok) & (outcome != lost)] = 0.0
        for name in campaign.controllers:
            own = np.flatnonzero(system == name)
            if not own.size:
                continue
            first = done[name]
            done[name] += own.size
            if columns.flight:
                wrong = _numbers(batch, columns.flight)[own] != np.arange(first, done[name])
                if wrong.any():
                    at = own[int(np.argmax(wrong))]
                    wish = f"flight {first + int(np.argmax(wrong))}: those of a system from 0 on, in their order"
                    raise InputError(columns.path, f"another flight of '{name}'", wish, int(rows[at]))
            table = np.column_stack([metrics[own], end[own]])
            yield _Piece(name, first, rows[own], samples[own], tuple(outcome[own].tolist()), table)


def _numbers(batch: pa.RecordBatch, name: str) -> Floats:
    column: Any = batch.column(batch.schema.get_field_index(name))
    return np.array(column.fill_null(np.nan).to_numpy(zero_copy_only=False), dtype=np.float64)


def _words(batch: pa.RecordBatch, name: str | None, default: str) -> np.ndarray:
    if name is None:
        return np.full(batch.num_rows, default, dtype=object)
    column: Any = batch.column(batch.schema.get_field_index(name))
    return np.array(column.fill_null("").to_pylist(), dtype=object)


def _prove(columns: _Columns, campaign: Experiment, spool: Any) -> dict[str, int]:
    """Flights of each system, whose samples, equal for all, go into ``spool``. Raises InputError with the row."""
    counts, width, written = dict.fromkeys(campaign.controllers, 0), len(campaign.inputs), 0
    for piece in _read(columns, campaign):
        _check_laws(columns.path, campaign, piece)
        stop = piece.first + len(piece.samples)
        counts[piece.system] = stop
        held = max(0, min(written, stop) - piece.first)
        before = _read_spool(spool, width, piece.first, held)
        other = (before != piece.samples[:held]).any(axis=1)
        if other.any():
            at = int(np.argmax(other))
            found = f"flight {piece.first + at} of '{piece.system}' with other inputs than of another system"
            wish = "the same inputs for all systems, or a folder for each"
            raise InputError(columns.path, found, wish, int(piece.rows[at]))
        spool.seek(0, 2)
        spool.write(np.ascontiguousarray(piece.samples[held:]).tobytes())
        written = max(written, stop)
    if len(set(counts.values())) > 1 or not written:
        words = ", ".join(f"{count} of '{name}'" for name, count in counts.items())
        raise InputError(columns.path, f"flights: {words}", "as many of each system, one at least")
    return counts


def _read_spool(spool: Any, width: int, first: int, number: int) -> Floats:
    spool.seek(8 * width * first)
    return np.frombuffer(spool.read(8 * width * number), dtype=np.float64).reshape(number, width)


def _check_laws(path: Path, campaign: Experiment, piece: _Piece) -> None:
    for name, marginal in campaign.marginals.items():
        values = piece.samples[:, campaign.inputs.index(name)]
        if (wrong := outside(marginal, values)).any():
            at = int(np.argmax(wrong))
            found = f"{name} {values[at]:.10g}, outside of its distribution"
            raise InputError(path, found, "a draw of the stated dispersions", int(piece.rows[at]))
