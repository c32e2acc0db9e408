"""Samples from a file: what is read, and where what cannot be read stands."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.campaign.sampling.sample_file import read_sample_file
from abhv_mc.io.input_error import InputError
from abhv_mc.plant.parameters import OURS


def test_csv_and_parquet_give_the_same(tmp_path):
    (tmp_path / "s.csv").write_text("flight,aero.lift,aero.drag\n0,0.9,1.1\n1,1.0,1.2\n")
    pq.write_table(pa.table({"aero.lift": [0.9, 1.0], "aero.drag": [1.1, 1.2]}), tmp_path / "s.parquet")
    one, two = (read_sample_file(tmp_path / name, OURS.dispersible) for name in ("s.csv", "s.parquet"))
    assert one.names == two.names == ("aero.lift", "aero.drag")
    assert one.values.tolist() == two.values.tolist() == [[0.9, 1.1], [1.0, 1.2]]


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("aero.lift\n1.0\nx\n", 3, 1, "'x'"),
        ("aero.lift,aero.drag\n1.0,inf\n", 2, 5, "'inf'"),
        ("aero.lft\n1.0\n", 1, None, "column 'aero.lft'"),
        ("flight,aero.lift\n1,1.0\n", 2, None, "does not count up"),
        ("aero.lift,aero.lift\n1,1\n", 1, None, "the column aero.lift twice"),
    ],
)
def test_bad_files_are_refused_in_place(tmp_path, text, line, column, words):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_sample_file(tmp_path / "s.csv", OURS.dispersible)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert words in caught.value.found


def test_a_parquet_file_that_is_none(tmp_path):
    (tmp_path / "s.parquet").write_text("not Parquet")
    with pytest.raises(InputError, match="Parquet"):
        read_sample_file(tmp_path / "s.parquet", OURS.dispersible)
