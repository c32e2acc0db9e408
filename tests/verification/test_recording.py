"""Reading other people's CSV."""

import numpy as np
import pytest

from abhv_mc.io.input_error import InputError
from abhv_mc.verification.recording import check_times, read_columns


def test_named_columns_come_with_all_their_digits(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("time, b ,text,b2\n0,0.1234567890123456789,x,1\n1,-2.5E7,y,2\n")
    columns = read_columns(file, ["b", "time"])
    assert columns["b"].tolist() == [0.1234567890123456789, -2.5e7]
    assert columns["time"].tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "match", "place"),
    [
        ("time,b\n0,1\n1,x\n", "'x'", (3, 3)),
        ("time,b\n0,1\n1,\n", "an empty cell", (3, 3)),
        ("time,b\n0,1\n1,inf\n", "'inf'", (3, 3)),
        ("time,c\n0,1\n1,2\n", "no column b", (1, None)),
        ("time,b,b\n0,1,2\n1,2,3\n", "2 columns b", (1, None)),
        ("time,b\n0,1\n", "1 rows", (None, None)),
        ("time,b\n0,1\n1,2,3,4\n", "4 cells", (3, None)),
        ("", "no rows", (1, None)),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path, text, match, place):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=match) as refused:
        read_columns(file, ["time", "b"])
    assert (refused.value.line, refused.value.column) == place


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(tmp_path / "none.csv", ["time"])


def test_times(tmp_path):
    check_times(tmp_path, np.array([0.0, 0.1, 0.2 + 1e-10]), uniform=True)
    with pytest.raises(InputError, match="rise") as refused:
        check_times(tmp_path, np.array([0.0, 0.1, 0.1]))
    assert refused.value.line == 4
    with pytest.raises(InputError, match="evenly"):
        check_times(tmp_path, np.array([0.0, 0.1, 0.25]), uniform=True)
