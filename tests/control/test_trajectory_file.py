"""Recorded trajectories: a number that no flight has is refused in its place."""

import pytest

from abhv_mc.control.trajectory_file import read_trajectory
from abhv_mc.io.input_error import InputError


@pytest.mark.parametrize(
    ("row", "column"),
    [("1,1e300,1400,90", 3), ("1,2e4,1e7,90", 7), ("1,2e4,0,90", 7), ("1,2e4,1,1e9", 9), ("0,2e4,1400,90", 1)],
)
def test_bad_trajectories(tmp_path, row, column):
    (tmp_path / "t.csv").write_text(f"time_s,altitude_m,speed_mps,heading_deg\n0,2e4,1400,90\n{row}\n")
    with pytest.raises(InputError, match=f":3:{column}: "):
        read_trajectory(tmp_path / "t.csv", 1.0)
