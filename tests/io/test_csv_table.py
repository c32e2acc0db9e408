"""CSV for other programs: formulas are escaped, numbers are not."""

import csv
import io

import pyarrow as pa
import pytest

from abhv_mc.io.csv_table import csv_text, write_batches

TEXTS = ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "a=b", "", "tlc", 'say "=1", twice']
ESCAPED = [f"'{text}" for text in TEXTS[:5]] + TEXTS[5:]


def test_text_that_a_spreadsheet_runs_is_escaped():
    written = csv_text([TEXTS, [-1.5, 2, None, 1e-300, True]])
    first, second = csv.reader(io.StringIO(written, newline=""))
    assert first == ESCAPED
    assert second == ["-1.5", "2", "", "1e-300", "True"]


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string()])
def test_columns_of_a_table_are_escaped_alike(kind, tmp_path):
    values = [-float(i) for i in range(len(TEXTS))]
    batch = pa.record_batch({"text": pa.array(TEXTS, kind), "value": values})
    file = tmp_path / "t.csv"
    write_batches(file, batch.schema, [batch, batch])
    with file.open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["text", "value"] and len(rows) == 1 + 2 * len(TEXTS)
    assert [row[0] for row in rows[1 : 1 + len(TEXTS)]] == ESCAPED
    assert [float(row[1]) for row in rows[1 : 1 + len(TEXTS)]] == values
