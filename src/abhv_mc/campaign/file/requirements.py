"""Reading and checking of the requirements and input tables of a campaign.

Requirements are a list or a CSV file with one row per entry. The checks also use the metrics, the
sampling design and the mission.
"""

import contextlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.config import TRACED, Campaign, RequirementEntry
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.campaign.file.systems import Contents, Input, InputName
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.campaign.sampling.distributions import Distribution
from abhv_mc.io.documents import Document, Problems, StrictModel, validate
from abhv_mc.io.foreign_table import ForeignTable, read_foreign_table
from abhv_mc.io.messages import InputError, Refusal, one_of

_COLUMNS = tuple(RequirementEntry.model_fields)
_NUMBERS = ("below", "above", "probability", "consumer_risk", "producer_risk")


class _Table(StrictModel):
    requirements: tuple[RequirementEntry, ...]


def read_tables(document: Document) -> Document:
    """Return the campaign document with its input and requirement tables expanded to entries.

    Raise InputErrors if a table is invalid.
    """
    return read_requirements(_read_inputs(document))


def read_requirements(document: Document) -> Document:
    """Return the campaign document with its requirement table expanded to entries.

    Raise InputErrors if the table is invalid.
    """
    if (path := _find_table(document, "requirements", "a list of requirements")) is None:
        return document
    table = _read_table(path)
    validate(table, _Table)  # Validate here, so that errors refer to locations in the table.
    tables = (*document.tables, table)
    return replace(document, data={**document.entries, **table.entries}, tables=tables)


def _find_table(document: Document, key: str, alternative: str) -> Path | None:
    """Return the path of the table that an entry names, or None if the entry is no path.

    Raise InputError if the table does not exist.
    """
    data = document.data
    if not isinstance(data, dict) or not isinstance(data.get(key), str):
        return None
    path = document.resolve(data[key])
    if not path.is_file():
        problem = f"the file '{path.name}' does not exist"
        raise document.error((key,), problem, f"an existing CSV file, or {alternative}")
    return path


class _Inputs(StrictModel):
    inputs: dict[InputName, Input]
    dispersions: dict[str, Distribution]


def _read_inputs(document: Document) -> Document:
    """Return the campaign document with its input table expanded to inputs and dispersions.

    The columns are ``name`` and the keys of inputs and dispersions. Raise InputErrors if the table
    is invalid.
    """
    if (path := _find_table(document, "inputs", "a mapping of inputs")) is None:
        return document
    data = document.entries
    table = read_foreign_table(path, has_units=False)
    if "name" not in table.heads:
        raise table.error(
            None, 0, "the column 'name' is missing", "a column with the names of the inputs"
        )
    entries: dict[str, dict[str, dict[str, Any]]] = {"inputs": {}, "dispersions": {}}
    locations: dict[tuple[str | int, ...], tuple[int, int]] = {(): (1, 1)}
    for row, line, cells in _list_cells(table):
        values = {head: _number(cell) for head, cell in cells.items()}
        name = str(values.pop("name", ""))
        if not name or name in entries["inputs"]:
            raise InputError(
                path, f"the input '{name}' has no unique name", "a unique name in each row", line
            )
        entries["inputs"][name] = {
            key: values.pop(key) for key in Input.model_fields if key in values
        }
        if values:
            entries["dispersions"][name] = values
        for key, entry in entries.items():
            locations[key, name] = line, 1
            for head in entry.get(name, ()):
                locations[key, name, head] = table.position(row, table.heads.index(head))
    rows = Document(path, {**entries}, locations, locations)
    validate(rows, _Inputs)
    entries["dispersions"] = {**(data.get("dispersions") or {}), **entries["dispersions"]}
    return replace(document, data={**data, **entries}, tables=(*document.tables, rows))


def _list_cells(table: ForeignTable) -> Iterator[tuple[int, int, dict[str, str]]]:
    """Yield the index, line and cells by heading of each row, without empty cells."""
    columns = [table.words(i) for i in range(len(table.heads))]
    for row, (line, *cells) in enumerate(zip(table.lines, *columns, strict=True)):
        yield row, line, {head: cell for head, cell in zip(table.heads, cells, strict=True) if cell}


def _number(cell: str) -> Any:
    with contextlib.suppress(ValueError):
        return float(cell)
    return {"true": True, "false": False}.get(cell.lower(), cell)


def _read_table(path: Path) -> Document:
    table = read_foreign_table(path, has_units=False)
    for column, head in enumerate(table.heads):
        if head not in _COLUMNS:
            raise table.error(None, column, f"unknown column '{head}'", one_of(_COLUMNS, head))
    if "metric" not in table.heads:
        raise table.error(None, 0, "the column 'metric' is missing", one_of(_COLUMNS))
    entries: list[Any] = []
    locations: dict[tuple[str | int, ...], tuple[int, int]] = {(): (1, 1)}
    for row, line, cells in _list_cells(table):
        location = ("requirements", row)
        locations[location] = (line, 1)
        for head in cells:
            locations[(*location, head)] = table.position(row, table.heads.index(head))
        entries.append({head: _value(head, cell) for head, cell in cells.items()})
    return Document(path, {"requirements": entries}, locations, locations)


def _value(head: str, cell: str) -> Any:
    """Return the value of a CSV cell: a number, a list of controllers or text."""
    if head == "controllers":
        return cell.replace(";", " ").split()
    return _number(cell) if head in _NUMBERS else cell


def select_requirements(entries: Any, controllers: Sequence[str]) -> Iterator[Any]:
    """Yield the requirements that apply to any of the controllers."""
    for entry in entries:
        if not entry.get("controllers"):
            yield entry
        elif chosen := [name for name in entry["controllers"] if name in controllers]:
            yield {**entry, "controllers": chosen}


def join_requirements(
    first: Iterable[Any], second: Iterable[Any], controllers: Iterable[str]
) -> list[Any]:
    """Join two lists of requirements and remove duplicates.

    Entries that differ only in their controllers become one entry.
    """
    joined: dict[str, Any] = {}
    for entry in (*first, *second):
        shared = {key: value for key, value in entry.items() if key != "controllers"}
        kind = json.dumps([shared, bool(entry.get("controllers"))], sort_keys=True)
        named = [*joined.get(kind, {}).get("controllers", ()), *(entry.get("controllers") or ())]
        joined[kind] = (
            {**entry, "controllers": [name for name in controllers if name in named]}
            if named
            else entry
        )
    return list(joined.values())


def check_requirements(
    model: Campaign, contents: Contents, errors: Problems
) -> Iterator[Requirement]:
    """Yield checked requirements; append problems to ``errors``."""
    systems, read = contents.systems, contents.read_limit
    metrics = {metric.name: metric for metric in (*contents.metrics, *contents.margins)}
    ids = [entry.id for entry in model.requirements]
    for i, entry in enumerate(model.requirements):
        where = ("requirements", i)
        if entry.id is not None and entry.id in ids[:i]:
            errors.add(
                (*where, "id"),
                f"the id '{entry.id}' is used more than once",
                "a unique id for each requirement",
            )
        for j, name in enumerate(entry.controllers or ()):
            if name not in systems:
                problem = f"unknown {contents.kind} '{name}'"
                errors.add((*where, "controllers", j), problem, one_of(systems, name))
        if entry.metric not in metrics:
            margins = () if contents.margin_flights(1) else contents.margins
            expected = one_of([*metrics][: len(metrics) - len(margins)], entry.metric)
            errors.add((*where, "metric"), f"unknown metric '{entry.metric}'", expected)
            continue
        key = "above"
        try:
            low = None if entry.above is None else read(entry.above, metrics[entry.metric].unit)
            key = "below"
            high = None if entry.below is None else read(entry.below, metrics[entry.metric].unit)
            if low is not None and high is not None and low >= high:
                raise Refusal(
                    f"no value is both below {high:g} and above {low:g}",
                    "an upper limit 'below' that exceeds the lower limit 'above'",
                )
            yield Requirement(
                metric=entry.metric,
                limits=Bounds(low, high),
                probability=entry.probability,
                consumer_risk=entry.consumer_risk,
                producer_risk=entry.producer_risk,
                controllers=tuple(sorted(entry.controllers or model.under_test or systems)),
                named=bool(entry.controllers),
                early_is_failure=entry.ended_early == "failure",
                traced={key: text for key in TRACED if (text := getattr(entry, key)) is not None},
            )
        except Refusal as refusal:
            errors.add((*where, key), refusal.found, refusal.expected)


def check_stop(model: Campaign, errors: Problems) -> None:
    """Check that a campaign with 'stop' has requirements and independent flights."""
    if model.stop is None:
        return
    if not model.requirements:
        errors.add_key(("stop",), "'stop' needs requirements", "at least one requirement")
    if model.sampling.design != INDEPENDENT:
        errors.add_key(
            ("stop",),
            "'stop' needs independent flights, unlike those of the design "
            f"'{model.sampling.design}'",
            f"'sampling: {INDEPENDENT}', or no 'stop'",
        )
