"""Requirements from a table: a CSV file with a row for each, in the columns of a requirement's keys."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.config import RequirementEntry
from abhv_mc.io.documents import Document, InputError, StrictModel, one_of, validate

_COLUMNS = tuple(RequirementEntry.model_fields)
_NUMBERS = ("below", "above", "probability", "consumer_risk", "producer_risk")


class _Table(StrictModel):
    requirements: tuple[RequirementEntry, ...]


def read_requirements(document: Document) -> Document:
    """The campaign with the entries of its table of requirements in place of the table's path, where it names one.

    Raises :class:`InputError`, in the table's lines and columns, for what is wrong in it.
    """
    data = document.data
    if not isinstance(data, dict) or not isinstance(data.get("requirements"), str):
        return document
    path = document.resolve(str(data["requirements"]))
    if not path.is_file():
        raise document.error(
            ("requirements",), f"'{data['requirements']}', which is not there", "a CSV file, or a list"
        )
    table = _read_table(path)
    validate(table, _Table)  # here, where the places are those of the table
    return replace(document, data={**data, **table.data})  # type: ignore[dict-item]


def _read_table(path: Path) -> Document:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(path, f"a file that cannot be read ({error})", "a CSV file in UTF-8") from None
    reader = csv.reader(text.splitlines())
    heads = [head.strip() for head in next(reader, [])]
    for column, head in enumerate(heads, 1):
        if head not in _COLUMNS:
            raise InputError(path, f"the column '{head}'", one_of(_COLUMNS, head), 1, column)
    if "metric" not in heads:
        raise InputError(path, "no column 'metric'", "a first line with the names of the columns", 1, 1)
    entries: list[Any] = []
    places: dict[tuple[str | int, ...], tuple[int, int]] = {(): (1, 1)}
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) > len(heads):
            raise InputError(path, "more cells than columns", "a cell for each column", reader.line_num, len(heads) + 1)
        entry: dict[str, Any] = {}
        place = ("requirements", len(entries))
        places[place] = (reader.line_num, 1)
        for column, (head, cell) in enumerate(zip(heads, cells, strict=False), 1):
            if cell.strip():
                entry[head] = _value(head, cell.strip())
                places[(*place, head)] = (reader.line_num, column)
        entries.append(entry)
    return Document(path, {"requirements": entries}, places, places)


def _value(head: str, cell: str) -> Any:
    """A cell as YAML would give it: plain numbers, names of controllers as a list, texts."""
    if head == "controllers":
        return cell.replace(";", " ").split()
    if head in _NUMBERS:
        try:
            return float(cell)
        except ValueError:
            return cell  # with a unit or in percent
    return cell
