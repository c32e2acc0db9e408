"""Functions that read tables of flights computed by another simulator."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import END_TIME, FlightRows
from abhv_mc.io.foreign_table import Column, ForeignTable, read_foreign_table
from abhv_mc.io.messages import InputError, counted, joined, one_of, quoted
from abhv_mc.statistics.table_checks import RISK, distance_p_values

if TYPE_CHECKING:
    import pandas as pd

_ROWS = 65536  # number of rows per block
_HEADS = {"controller": "system", END_TIME.name: "end_time"}  # column headings of exported tables
_BY_ROW = "line"  # value of 'flight' under 'columns' that pairs rows of two tables in order
_ROW, _LINE = "#row", "#line"  # names of added columns, which no input can have
_OK, _NOT_COMPUTED = Outcome.OK.code, Outcome.FAILED_TO_RUN.code
_ECHO = 1e-4  # tolerance for inputs repeated in a table of results, as a share of the largest value


@dataclass(frozen=True)
class FlightTable:
    """Flights of all systems, in the units of the campaign."""

    path: Path  # path of the table of inputs
    samples: Floats  # inputs [flight, input], which are the same for all systems
    lines: Ints  # [flight] line number of the inputs in the file
    factors: Floats  # [input] conversion factors from units of the file to units of the campaign
    blocks: tuple[FlightRows, ...]
    warnings: tuple[str, ...]  # assumptions about the tables


@dataclass(frozen=True)
class _Rows:
    """Columns of one table that a campaign uses, in the units of the campaign."""

    table: ForeignTable
    columns: Mapping[str, Column]
    factors: Mapping[str, float]
    frame: "pd.DataFrame"

    def error(self, row: Any, name: str, problem: str, expected: str) -> InputError:
        """Return the InputError for the cell in a row and a named column."""
        column = self.columns.get(name)
        return self.table.error(int(row), column.position if column else None, problem, expected)


def read_flight_tables(paths: Sequence[Path], campaign: Experiment) -> FlightTable:
    """Read flights from one table, or from a table of inputs and a table of results.

    Raise InputError, with line and column, if the tables do not match the campaign.
    """
    if len(paths) > 2:
        expected = "one table of flights, or a table of inputs and a table of results"
        raise InputError(paths[2], "a third table is given", expected)
    measured = [metric.name for metric in campaign.measured]
    inputs, *result_tables = sorted(
        (_read_rows(path, campaign) for path in paths),
        key=lambda rows: sum(name in rows.columns for name in measured),
    )
    results = result_tables[0] if result_tables else inputs
    warnings = [
        f"the last line of '{rows.table.path.name}' has no end; the table may be incomplete"
        for rows in (inputs, *result_tables)
        if rows.table.is_cut
    ]
    model: Any = campaign.model
    known = {*inputs.columns, *results.columns}
    for name, head in model.columns.items():
        if (name, head) != ("flight", _BY_ROW) and name not in known:
            expected = f"the column that 'columns' in the campaign file names for '{name}'"
            table = (inputs if name in campaign.inputs else results).table
            raise table.error(None, None, f"the table has no column '{head}'", expected)
    for name in (*campaign.marginals, *measured):
        if name not in known:
            heads = (*inputs.table.heads, *results.table.heads)
            expected = (
                "a column for each dispersed input and metric, or its heading under 'columns'"
            )
            expected = f"{expected} in the campaign file ({one_of(dict.fromkeys(heads), name)})"
            raise results.table.error(None, None, f"the table has no column '{name}'", expected)
    if "system" not in results.columns and len(campaign.controllers) > 1:
        expected = f"a column with the system of each flight ({quoted(campaign.controllers, 'or')})"
        raise results.table.error(None, None, "the column 'system' is missing", expected)
    if result_tables:
        frame = _join(inputs, results, campaign, warnings)
    else:
        frame = results.frame.assign(**{_LINE: results.frame[_ROW]})
    systems = {name: _select(results, frame, name) for name in campaign.controllers}
    counts = {name: len(own) for name, own in systems.items()}
    if len(set(counts.values())) > 1 or not counts[campaign.controllers[0]]:
        numbers = joined([f"{count} of '{name}'" for name, count in counts.items()])
        path = results.table.path
        raise InputError(
            path,
            f"the numbers of flights differ or are zero ({numbers})",
            "the same number of flights for each system, at least 1",
        )
    nominal = {name: campaign.parameters[name].nominal for name in campaign.inputs}
    first = systems[campaign.controllers[0]]
    samples = [
        np.column_stack([own.get(name, np.full(len(own), nominal[name])) for name in nominal])
        for own in systems.values()
    ]
    for own, values in zip(systems.values(), samples, strict=True):
        for flight in np.flatnonzero((values != samples[0]).any(axis=1))[:1]:
            system, reference = own.system.iloc[0], campaign.controllers[0]
            problem = f"inputs of flight {flight} differ between '{system}' and '{reference}'"
            expected = "the same inputs for all systems, or a separate folder for each"
            raise results.error(own[_ROW].iloc[flight], "flight", problem, expected)
    return FlightTable(
        path=inputs.table.path,
        samples=samples[0],
        lines=np.array(inputs.table.lines)[first[_LINE]],
        factors=np.array([inputs.factors.get(name, 1.0) for name in nominal]),
        blocks=tuple(
            block
            for (name, own), values in zip(systems.items(), samples, strict=True)
            for block in _blocks(name, own, values, campaign, measured)
        ),
        warnings=tuple(warnings),
    )


def _read_rows(path: Path, campaign: Experiment) -> _Rows:
    """Read the columns that a campaign uses. Raise InputError for an invalid row."""
    import pandas as pd

    model: Any = campaign.model
    table = read_foreign_table(path, comma=model.comma)
    units = {name: campaign.parameters[name].unit for name in campaign.inputs}
    units |= {metric.name: metric.unit for metric in campaign.measured}
    units |= {"end_time": "s", "flight": "-"}
    labels = {"system": campaign.controllers, "outcome": tuple(campaign.outcomes.numbers)}
    columns = table.find([*units, *labels, *_HEADS], model.columns)
    for head, name in _HEADS.items():
        if head in columns:
            columns.setdefault(name, columns.pop(head))
    factors = {
        name: table.factor(columns[name], unit) for name, unit in units.items() if name in columns
    }
    positions = {name: columns[name].position for name in factors}

    def fits(values: Floats) -> Mask:
        mask = np.zeros(len(factors), bool)
        for i, (name, factor) in enumerate(factors.items()):
            if (marginal := campaign.marginals.get(name)) is not None:
                probability = marginal.cdf(values[:, i] * factor)
                mask[i] = distance_p_values(probability, probability)[0] > RISK
        return mask

    dimensional = [positions[name] for name in factors if units[name] != "-"]
    numbers = table.numbers([*positions.values()], False, dimensional, fits)
    pa.default_memory_pool().release_unused()
    numbers *= list(factors.values())
    frame = pd.DataFrame(numbers, columns=list(factors), copy=False)
    if model.columns.get("flight") == _BY_ROW and "flight" not in columns:
        frame["flight"] = np.arange(len(frame), dtype=np.float64)
    rows = _Rows(table, columns, factors, frame.assign(**{_ROW: np.arange(len(frame))}))
    for name, choices in labels.items():
        default = [choices[0]] * len(table)
        texts = table.words(columns[name].position) if name in columns else default
        rows.frame.insert(0, name, pd.Series(texts, dtype=object))  # shares equal strings
        for row in np.flatnonzero(~rows.frame[name].isin(choices))[:1]:
            head = table.heads[columns[name].position]
            raise rows.error(
                row, name, f"unknown {head} '{texts[row]}'", one_of(choices, texts[row])
            )
    for name in (*campaign.inputs, "flight"):
        for row in np.flatnonzero(~np.isfinite(frame.get(name, np.empty(0))))[:1]:
            raise rows.error(row, name, f"'{name}' is not a finite number", "a number in each cell")
    is_sorted = "flight" not in frame or (np.diff(frame.flight) > 0.0).all()
    for row in np.flatnonzero(not is_sorted and rows.frame.duplicated(["system", "flight"]))[:1]:
        problem = f"flight {frame.flight[row]:g} of '{rows.frame.system[row]}' appears twice"
        raise rows.error(row, "flight", problem, "each flight only once")
    return rows


def _join(
    inputs: _Rows, results: _Rows, campaign: Experiment, warnings: list[str]
) -> "pd.DataFrame":
    """Join inputs and results by flight number; flights without results failed to run.

    Append assumptions to ``warnings``. Raise InputError if a row of results has no inputs, or if it
    repeats inputs with other values.
    """
    is_paired = all("flight" in rows.columns for rows in (inputs, results))
    key = None if is_paired else _find_key(inputs, results)
    way = f"by the column '{key}'" if key else "in order"
    for rows in (inputs, results):
        if "flight" not in rows.frame:
            expected = (
                "a column 'flight' in both tables, to pair inputs and results, or "
                f"'columns: {{flight: {key or _BY_ROW}}}' to pair the rows {way}"
            )
            raise rows.table.error(None, None, "the column 'flight' is missing", expected)
    name = inputs.table.path.name
    if "flight" not in results.columns and key is not None:
        problem = f"the column '{key}' has other values in the same rows of '{name}'"
        column = results.table.heads.index(key)
        expected = (
            f"'columns: {{flight: {key}}}' in the campaign file, to pair the rows by this column"
        )
        raise results.table.error(None, column, problem, expected)
    if "flight" not in results.columns and len(inputs.frame) != len(results.frame):
        own, other = (counted(len(rows.frame), "row") for rows in (results, inputs))
        problem = f"the table has {own}, but '{name}' has {other}"
        expected = "equal numbers of rows in both tables, to pair the rows in order"
        raise InputError(results.table.path, problem, expected)
    _align_numbers(inputs, results, campaign, warnings)
    drawn, paired = _pair(inputs, results, campaign)
    import pandas as pd

    frames = [paired]
    for system in campaign.controllers:
        absent = drawn[~drawn.flight.isin(paired.flight[paired.system == system])]
        if len(absent):
            entries = {"system": system, "outcome": _NOT_COMPUTED, _ROW: 0}
            frames.append(absent.assign(**entries))
    return pd.concat(frames, ignore_index=True)


def _pair(
    inputs: _Rows, results: _Rows, campaign: Experiment
) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """Return the inputs, and the results joined with them. Raise InputError if they differ."""
    drawn = inputs.frame.rename(columns={_ROW: _LINE}).drop(columns=["system", "outcome"])
    drawn = drawn.drop_duplicates("flight")
    name = inputs.table.path.name
    for row in np.flatnonzero(~results.frame.flight.isin(drawn.flight))[:1]:
        problem = f"flight {results.frame.flight[row]:g} is not in '{name}'"
        raise results.error(row, "flight", problem, f"flights of '{name}'")
    paired = results.frame.merge(drawn, on="flight", how="left", suffixes=("_repeated", ""))
    for quantity in campaign.inputs:
        if (repeated := paired.get(f"{quantity}_repeated")) is not None:
            errors = (repeated - paired[quantity]).abs()
            for row in np.flatnonzero(errors > _ECHO * paired[quantity].abs().max())[:1]:
                problem = (
                    f"'{quantity}' is {repeated[row]:g}, but {paired[quantity][row]:g} in '{name}'"
                )
                raise results.error(row, quantity, problem, "the same inputs in both tables")
    return drawn, paired


def _align_numbers(
    inputs: _Rows, results: _Rows, campaign: Experiment, warnings: list[str]
) -> None:
    """Renumber flights from 0 if only one of the tables contains flight 0.

    Raise InputError if the other table may be numbered from 0 or 1.
    """
    has_zero = [bool((rows.frame.flight == 0.0).any()) for rows in (inputs, results)]
    if has_zero[0] == has_zero[1]:
        return
    reference, other = (inputs, results) if has_zero[0] else (results, inputs)
    names = [rows.table.path.name for rows in (other, reference)]
    model: Any = campaign.model
    numbers, firsts = other.frame.flight, [0, 1]
    if model.first_flight is not None:
        firsts = [model.first_flight]
    elif np.array_equal(np.unique(numbers) - 1.0, np.unique(reference.frame.flight)):
        firsts = [1]
    elif {*inputs.frame} & {*results.frame} & {*campaign.inputs}:
        for first in (0, 1):
            other.frame["flight"] = numbers - first
            try:
                _pair(inputs, results, campaign)
            except InputError:
                firsts.remove(first)
    if len(firsts) > 1:
        expected = f"'first_flight: 0' or 'first_flight: 1' for '{names[0]}' in the campaign file"
        raise other.error(0, "flight", f"flight 0 is only in '{names[1]}'", expected)
    first = firsts[0] if firsts else 0
    if first != (model.first_flight or 0):
        warnings.append("'{}' numbers the flights from 1, '{}' from 0".format(*names))
    other.frame["flight"] = numbers - first


def _find_key(inputs: _Rows, results: _Rows) -> str | None:
    """Return a heading whose integers number the rows of both tables in different orders."""
    for column, head in enumerate(inputs.table.heads):
        if head in results.table.heads:
            both = inputs.table.words(column), results.table.words(results.table.heads.index(head))
            is_key = all(
                len({*texts}) == len(texts) and all(map(str.isdecimal, texts)) for texts in both
            )
            if is_key and both[0] != both[1]:
                return head
    return None


def _select(rows: _Rows, frame: "pd.DataFrame", system: str) -> "pd.DataFrame":
    """Return a system's flights in ascending order. Raise InputError if a flight is missing.

    Flight numbers start at 0 or 1.
    """
    own = frame[frame.system == system]
    if "flight" not in own or not len(own):
        return own
    own = own.sort_values("flight", kind="stable")
    first = 1.0 if frame.flight.min() == 1.0 else 0.0
    for number in np.flatnonzero(own.flight != np.arange(len(own)) + first)[:1]:
        problem = f"flight {number + first:g} of '{system}' is missing"
        expected = "all flights, numbered from 0 or 1, with an outcome for those that failed"
        raise rows.error(own[_ROW].iloc[number], "flight", problem, expected)
    return own


def _blocks(
    system: str, own: "pd.DataFrame", samples: Floats, campaign: Experiment, measured: list[str]
) -> Iterator[FlightRows]:
    """Yield the flights of a system in blocks."""
    end = own.get("end_time", np.full(len(own), np.nan))
    values = np.column_stack([*(own[name] for name in measured), end])
    outcome, metrics, end = own.outcome.to_numpy(copy=True), values[:, :-1], values[:, -1]
    outcome[(outcome == _OK) & ~np.isfinite(metrics).all(axis=1)] = _NOT_COMPUTED
    metrics[outcome == _NOT_COMPUTED] = np.nan
    end[np.isnan(end) & (outcome != _OK) & (outcome != _NOT_COMPUTED)] = 0.0
    for first in range(0, len(own), _ROWS):
        block = slice(first, first + _ROWS)
        yield FlightRows(
            controller=system,
            first=first,
            names=campaign.inputs,
            samples=samples[block],
            outcome=tuple(outcome[block].tolist()),
            values=values[block],
            columns=(*measured, END_TIME.name),
        )
