import numpy as np

from abhv_mc.kernel.plant.vehicle import FIXED_TABLE_ROWS, VARIABLES
from abhv_mc.vehicle.pack import Axis, Table, pack_tables


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
