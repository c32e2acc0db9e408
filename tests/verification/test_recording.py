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
