"""Tables of wind and density: a number that no air has is refused in its place."""

import pytest

from abhv_mc.control.mission_tables import DENSITY, WIND, read_air_table
from abhv_mc.io.input_error import InputError

AIR = "altitude_m,wind_north_mps,wind_east_mps"
BAD_AIR = [
    (f"{AIR}\n0,1e300,1\n9,1,1\n", ":2:3: '1e300'; expected a magnitude of at most 12000"),
    (f"{AIR}\n0,1,1\n9,nan,1\n", ":3:3: 'nan'; expected a finite number"),
    (f"{AIR}\n5,1,1\n5,1,1\n", ":3:1: the altitude 5 m"),
    (f"{AIR}\n5,1,1\n", "1 rows"),
]


@pytest.mark.parametrize(("text", "words"), BAD_AIR, ids=[words for _, words in BAD_AIR])
def test_bad_winds(tmp_path, text, words):
    (tmp_path / "air.csv").write_text(text)
    with pytest.raises(InputError) as refused:
        read_air_table(tmp_path / "air.csv", WIND)
    assert words in str(refused.value)


@pytest.mark.parametrize("factor", ["0", "-1", "1e4", "inf"])
def test_bad_densities(tmp_path, factor):
    (tmp_path / "air.csv").write_text(f"altitude_m,density_factor\n0,{factor}\n9,1\n")
    with pytest.raises(InputError, match=":2:3: "):
        read_air_table(tmp_path / "air.csv", DENSITY)
