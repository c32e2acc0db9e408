import numpy as np
import pytest

from abhv_mc.vehicle.arrays import CHUNK, FIXED_TABLE_ROWS, VARIABLES
from abhv_mc.vehicle.evaluate import evaluate_tables
from abhv_mc.vehicle.pack import Axis, Table, make_constant, pack_tables


def draw_table(generator, names, grids):
    axes = tuple(Axis(VARIABLES.index(name), grids[name]) for name in names)
    return Table(axes, generator.normal(size=[axis.grid.size for axis in axes]))


def test_equal_axes_share_a_group_and_a_search_whatever_their_order():
    generator = np.random.default_rng(1)
    grids = {"mach": np.array([1.0, 2.0, 4.0]), "angle_of_attack": np.array([0.0, 0.1]), "mass": np.array([5.0, 9.0])}
    tables = [
        draw_table(generator, ("mach", "angle_of_attack"), grids),
        draw_table(generator, ("angle_of_attack", "mach"), grids),
        draw_table(generator, ("mach",), grids),
        draw_table(generator, ("mass",), grids),
    ]
    packed, rows = pack_tables(tables, {"inertia_xx": 3})
    assert packed.axis_variable.size == 3
    assert packed.group_start.size == 3
    assert rows[1] == rows[0] + 1
    assert packed.fixed_row[FIXED_TABLE_ROWS.index("inertia_xx")] == rows[3]
    # The same Mach grid with another node is another axis.
    tables.append(draw_table(generator, ("mach",), {"mach": np.array([1.0, 2.5, 4.0])}))
    assert pack_tables(tables, {})[0].axis_variable.size == 4


def test_groups_are_padded_with_rows_of_zeros():
    table = Table((Axis(1, np.array([0.0, 1.0, 3.0])),), np.array([1.0, 2.0, 3.0]))
    packed, rows = pack_tables([table] * 3, {})
    assert (packed.group_width % CHUNK == 0).all()
    assert packed.n_rows == packed.group_width.sum()
    values = evaluate_tables(packed, np.ones((len(VARIABLES), 1)))[:, 0]
    spare = np.setdiff1d(np.arange(packed.n_rows), np.concatenate([rows, packed.fixed_row]))
    assert spare.size > 0
    assert not values[spare].any()
    assert packed.inverse_step.tolist() == [1.0, 0.5, 0.0]


@pytest.mark.parametrize("with_mass", [True, False])
def test_what_a_vehicle_lacks_is_constant_everywhere(with_mass):
    axis = Axis(VARIABLES.index("mass"), np.array([10.0, 20.0]))
    tables = [Table((axis,), np.array([1.0, 3.0]))] if with_mass else [make_constant(4.0)]
    packed, rows = pack_tables(tables, {"inertia_yy": 0})
    variables = np.zeros((len(VARIABLES), 3))
    variables[0] = 1.0
    variables[VARIABLES.index("mass")] = [0.0, 15.0, 1e9]
    found = evaluate_tables(packed, variables)
    for i, name in enumerate(FIXED_TABLE_ROWS):
        if name != "inertia_yy":
            assert found[packed.fixed_row[i]].tolist() == [float(name == "specific_impulse")] * 3
    assert found[rows[0]].tolist() == ([1.0, 2.0, 3.0] if with_mass else [4.0] * 3)
    assert packed.axis_variable.tolist() == [VARIABLES.index("mass") if with_mass else VARIABLES.index("one")]
