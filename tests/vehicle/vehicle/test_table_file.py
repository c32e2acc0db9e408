"""Table files: axes and units, matrices, and errors with their location."""

import numpy as np
import pytest

from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES
from abhv_mc_vehicle.vehicle.table_file import parse_role, read_table

GOOD = "mach,alpha_deg,value\n4,-1,1\n4,0,2\n4,2,3\n6,-1,4\n6,0,5\n6,2,6\n"


def read(tmp_path, text, columns=None, effectors=()):
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_table(
        path,
        {name: parse_role(role, effectors) for name, role in (columns or {}).items()},
        effectors,
    )


def test_axes_become_radians_and_values_stay(tmp_path):
    table = read(tmp_path, GOOD)
    mach, alpha = table.axes
    assert [VARIABLES[axis.variable] for axis in table.axes] == ["mach", "angle_of_attack"]
    assert mach.grid.tolist() == [4.0, 6.0]
    assert alpha.grid == pytest.approx(np.radians([-1.0, 0.0, 2.0]), rel=1e-15)
    assert table.values.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_columns_by_the_vehicle_file_comments_and_blank_lines(tmp_path):
    text = (
        '# TM-1\nphi,delta,ct,note\n\n0,-10,1.5,"a, q 1900 psf"\n0,10,2.5,b\n1,-10,3.5,c\n# '
        "more\n1,10,4.5,d\n"
    )
    columns = {"delta": "right_elevon deg", "ct": "value", "note": "ignore"}
    table = read(tmp_path, text, columns, ("left_elevon", "right_elevon"))
    assert [VARIABLES[axis.variable] for axis in table.axes] == ["equivalence_ratio", "effector_1"]
    assert table.axes[1].grid == pytest.approx(np.radians([-10.0, 10.0]))
    assert table.values.tolist() == [[1.5, 2.5], [3.5, 4.5]]


@pytest.mark.parametrize(
    ("text", "columns", "grid"),
    [
        ("\ufeffaltitude_km,value\n20,1\n30,2\n", {}, [2e4, 3e4]),  # a byte order mark
        (
            "alpha_deg,value\n0,1\n0.5,2\n",
            {"alpha_deg": "angle_of_attack rad"},
            [0.0, 0.5],
        ),  # the vehicle file says otherwise
        (
            "alpha_deg,value\n0,1\n30,2\n",
            {"alpha_deg": "angle_of_attack"},
            [0.0, np.pi / 6.0],
        ),  # the unit of the name
        (
            "altitude_m,value\n0,1\n50,2\n",
            {"altitude_m": "altitude m"},
            [0.0, 50.0],
        ),  # few metres, insisted on
    ],
)
def test_axes_in_other_units(tmp_path, text, columns, grid):
    assert read(tmp_path, text, columns).axes[0].grid == pytest.approx(grid)


@pytest.mark.parametrize(
    ("head", "role", "narrow", "wide"),
    [("altitude_m", "altitude m", 199.0, 200.0), ("alpha_deg", "angle_of_attack deg", 0.99, 1.0)],
)
def test_a_narrow_axis_needs_a_declared_unit(tmp_path, head, role, narrow, wide):
    texts = [f"mach,{head},value\n4,0,1\n4,{end},2\n6,0,3\n6,{end},4\n" for end in (narrow, wide)]
    for columns in ({}, {head: role.split()[0]}, {"mach": "mach"}):
        with pytest.raises(InputError) as caught:
            read(tmp_path, texts[0], columns)
        assert (caught.value.line, caught.value.column) == (2, 3)
        assert np.ptp(read(tmp_path, texts[1], columns).axes[1].grid) > 0.0
    for text in texts:
        assert np.ptp(read(tmp_path, text, {head: role}).axes[1].grid) > 0.0


@pytest.mark.parametrize(
    ("head", "least", "most"),
    [
        ("mach", 0, 50),
        ("phi", 0, 20),
        ("altitude_km", -1, 200),
        ("mass_kg", 0.001, 1e7),
        ("beta_deg", -180, 180),
    ],
)
def test_the_bounds_of_a_plausible_axis_are_inside(tmp_path, head, least, most):
    grid = read(tmp_path, f"{head},value\n{least},1\n{most},2\n").axes[0].grid
    assert grid[1] - grid[0] > 0.0
    for low, high in ((least - 0.01, most), (least, 1.001 * most)):
        with pytest.raises(InputError):
            read(tmp_path, f"{head},value\n{low},1\n{high},2\n")


ROWS = "4,-1,1\n4,0,2\n4,2,3\n6,-1,4\n6,0,5\n6,2,6\n"
MATRIX = "mach\\alpha_deg;-1;0;2\n4;1;2;3\n6;4;5;6\n"


@pytest.mark.parametrize(
    "text",
    [
        "mach,alpha_deg,value\n" + "\n".join(ROWS.split()[::-1]),
        MATRIX,
        MATRIX.replace(";", ","),
        MATRIX.replace(";", "\t"),
        "alpha [deg]\\mach,4,6\n-1,1,4\n0,2,5\n2,3,6\n",
    ],
)
def test_shuffled_rows_and_matrices_equal_the_tidy_table(tmp_path, text):
    table, expected = read(tmp_path, text), read(tmp_path, GOOD)
    if VARIABLES[table.axes[0].variable] == "mach":
        assert table.values.tolist() == expected.values.tolist()
    else:
        assert table.values.T.tolist() == expected.values.tolist()
    grids = {axis.variable: axis.grid.tolist() for axis in table.axes}
    assert grids == {axis.variable: axis.grid.tolist() for axis in expected.axes}


def test_blocks_of_a_matrix_are_a_third_axis(tmp_path):
    second = MATRIX.replace("1;2;3", "7;8;9")
    table = read(tmp_path, f"altitude_km = 20\n{MATRIX}\naltitude_km; 30;;\n{second}")
    names = [VARIABLES[axis.variable] for axis in table.axes]
    assert names == ["altitude", "mach", "angle_of_attack"]
    assert table.axes[0].grid.tolist() == [2e4, 3e4]
    assert table.values[0].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert table.values[1].tolist() == [[7.0, 8.0, 9.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("text", "line", "column", "fragment"),
    [
        (GOOD.replace("6,0,5\n", ""), 6, None, "mach 6, alpha_deg 0"),  # hole
        (GOOD.replace("4,2,3", "4,-2,3"), 5, None, "mach 4, alpha_deg 2"),  # other points
        ("mach\\alpha_deg,-1,0\n4,1\n", 2, None, "2 cells"),  # short row of a matrix
        ("mach\\alpha_deg,-1,0\n4,1,2\n6,1,x\n", 3, 5, "'x' in"),  # word in a matrix
        ("altitude_km = 1\nmach\\alpha_deg;-1;0\n4;1;2\n6;;2\n", 4, 3, "'' in"),  # hole in a matrix
        ("mach\\alpha_deg,-1,900\n4,1,2\n6,1,3\n", 2, None, "alpha_deg"),  # head of a matrix
        ("a\nmach\\alpha_deg,-1,0\n4,1,2\n", 1, None, "'name = number'"),  # block without value
        (GOOD.replace("4,2,3", "4,0,3"), 4, None, "repeats"),  # duplicate point
        (GOOD.replace("6,0,5", "6,0,nan"), 6, 5, "'nan'"),  # nan
        (GOOD.replace("6,0,5", "6,0"), 6, None, "2 cells"),  # short row
        (GOOD.replace("alpha_deg", "alhpa_deg"), 1, 6, "'alhpa_deg'"),  # unknown column
        (GOOD.replace("alpha_deg", "alpha"), 1, 6, "unit"),  # angle without unit
        (GOOD.replace("value", "mach"), 1, 16, "mach"),  # axis twice
        ("mach,alpha_deg,value\n4,0,1\n4,1,2\n", 2, 1, "mach"),  # axis of one
        (
            "mach,alpha_rad,value\n4,0,1\n4,12,2\n6,0,1\n6,12,2\n",
            3,
            3,
            "angle_of_attack is 12",
        ),  # deg as rad
        (
            "mach,alpha_deg,value\n4,0,1\n4,.2,2\n6,0,1\n6,.2,2\n",
            2,
            3,
            "only 0.2 deg",
        ),  # rad as deg
        ("mach,value\n1200,1\n1800,2\n", 2, 1, "mach is 1200"),  # speed as mach
        ("altitude_m,value\n20,1\n30,2\n", 2, 1, "only 10 m"),  # km as metres
        (GOOD, 1, None, "'delta'"),  # a description of no column
        (b"mach,value\n4,\xff\n", None, None, "utf-8"),  # bytes
    ],
)
def test_errors_give_their_location(tmp_path, text, line, column, fragment):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, {"delta": "elevator deg"} if "delta" in fragment else {})
    assert (caught.value.line, caught.value.column) == (line, column)
    assert fragment in f"{caught.value.found} {caught.value.expected}"
    assert caught.value.file.endswith("table.csv")
