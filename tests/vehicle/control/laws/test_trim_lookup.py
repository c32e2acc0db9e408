"""Look-up of trim data against scipy, from other cells, on nodes and outside of the tables."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from abhv_mc_vehicle.control.design.trim_tables import make_trim_tables
from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.laws.trim_lookup import TRIM_ROWS, look_up_trim, make_trim_cells
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import variable_row
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

WIDTH = 12
ROUNDS = 40
FIRST = s.LAW
_MACH = variable_row("mach")


@kernel
def look_up(trim, cells, points, results):
    """Look up five numbers [round, 5, lane] at points [round, 3, lane], from the previous cells."""
    Z = np.zeros((s.LAW + 5, WIDTH))
    for turn in range(points.shape[0]):
        for lane in range(WIDTH):
            Z[_MACH, lane] = points[turn, 0, lane]
            Z[s.ALPHA_CMD, lane] = points[turn, 1, lane]
            Z[s.CMD_ETA, lane] = points[turn, 2, lane]
        look_up_trim(Z, WIDTH, trim, cells, s.ALPHA_CMD, s.CMD_ETA, FIRST)
        for i in range(5):
            for lane in range(WIDTH):
                results[turn, i, lane] = Z[FIRST + i, lane]


@pytest.fixture(scope="module")
def trim():
    vehicle = load_vehicle(Path(__file__).parents[4] / "configs" / "vehicle" / "ghame_x.yaml")
    return make_trim_tables(vehicle, 20e3, (1350.0, 1450.0))


def axes_of(trim):
    starts = zip(trim.axis_start, trim.axis_length, strict=True)
    return [trim.grid[start : start + length] for start, length in starts]


def values_of(trim, name):
    """Return one table over its axes."""
    shape = [len(axis) for axis in axes_of(trim)]
    nodes = np.indices(shape).reshape(3, -1)
    corners = trim.group_start[0] + trim.group_stride[0] @ nodes
    return trim.data[corners + TRIM_ROWS.index(name)].reshape(shape)


def draw_points(trim):
    """Draw rounds that move within cells, jump, are on nodes and leave the tables."""
    generator = np.random.default_rng(5)
    points = np.empty((ROUNDS, 3, WIDTH))
    for i, axis in enumerate(axes_of(trim)):
        span = axis[-1] - axis[0]
        points[:, i] = generator.uniform(axis[0], axis[-1], (ROUNDS, WIDTH))
        points[10:20, i] = points[9, i] + np.linspace(0.0, 0.01, 10)[:, None] * span
        points[20:25, i] = generator.choice(axis, (5, WIDTH))
        points[25:30, i] = generator.choice(
            [axis[0] - span, axis[0], axis[-1], axis[-1] + span], (5, WIDTH)
        )
    return points


def test_trim_data_and_slopes_agree_with_scipy_for_any_previous_cell(trim):
    points = draw_points(trim)
    warm, cold = np.empty((2, ROUNDS, 5, WIDTH))
    look_up(trim, make_trim_cells(WIDTH), points, warm)
    for turn in range(ROUNDS):
        look_up(trim, make_trim_cells(WIDTH), points[turn : turn + 1], cold[turn : turn + 1])
    assert np.array_equal(warm, cold)

    axes = axes_of(trim)
    inside = np.stack(
        [np.clip(points[:, i], axis[0], axis[-1]) for i, axis in enumerate(axes)], axis=-1
    )
    for i, name in enumerate(("lift", "drag", "thrust")):
        exact = RegularGridInterpolator(axes, values_of(trim, name))(inside)
        assert warm[:, i] == pytest.approx(exact, rel=1e-12, abs=1e-14)
    cell = np.clip(
        np.searchsorted(axes[1], inside[:20, ..., 1], side="right") - 1, 0, len(axes[1]) - 2
    )
    ends = [
        np.stack([inside[:20, ..., 0], axes[1][cell + end], inside[:20, ..., 2]], axis=-1)
        for end in (0, 1)
    ]
    for i, name in ((3, "lift"), (4, "thrust")):
        low, high = (RegularGridInterpolator(axes, values_of(trim, name))(end) for end in ends)
        assert warm[:20, i] == pytest.approx(
            (high - low) / np.diff(axes[1])[cell], rel=1e-9, abs=1e-12
        )
