"""CSV tables for other programs, without cells that spreadsheets would run as formulas.

Spreadsheets evaluate a cell that begins with ``= + - @`` or a tab as a formula (CWE-1236). Text
cells of this kind therefore get a leading apostrophe; numbers are unchanged.
"""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow as pa

_FORMULA = r"^[=+\-@\t]"


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(_escape, row) for row in rows)
    return text.getvalue()


def write_batches(path: Path, schema: "pa.Schema", batches: "Iterable[pa.RecordBatch]") -> None:
    """Write the record batches of a table to a CSV file."""
    import pyarrow as pa
    import pyarrow.csv as arrow_csv

    with arrow_csv.CSVWriter(path, schema) as writer:
        for batch in batches:
            columns = [_escape_column(column) for column in batch.cast(schema).columns]
            writer.write_batch(pa.record_batch(columns, schema=schema))


def _escape(cell: Any) -> Any:
    return f"'{cell}" if isinstance(cell, str) and re.match(_FORMULA, cell) else cell


def _escape_column(column: "pa.Array") -> "pa.Array":
    import pyarrow.compute as pc
    import pyarrow.types as kinds

    if not (kinds.is_string(column.type) or kinds.is_large_string(column.type)):
        return column
    return pc.replace_substring_regex(column, f"({_FORMULA})", r"'\1")
