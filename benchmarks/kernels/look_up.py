"""All tables of GHAME-X for all lanes: in one cell, in different cells, and lane by lane."""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.bench.speed import make_work
from abhv_mc.flight.plan import LANES
from abhv_mc.jit import kernel
from abhv_mc.plant import state as s
from abhv_mc.plant.aerodynamics import look_up, make_cells
from abhv_mc.plant.state import variable_row
from benchmarks.timing import measure_ratio

CALLS = 2000
_ONE, _MACH, _ALPHA = (variable_row(name) for name in ("one", "mach", "angle_of_attack"))
_ROWS = s.LAW


@kernel
def look_up_often(width, tables, cells, mach, alpha, calls):
    """Look up ``calls`` times for ``width`` of the lanes."""
    Z = np.zeros((_ROWS, LANES))
    T = np.zeros((s.MAX_TABLE_ROWS, LANES))
    total = 0.0
    for call in range(calls):
        for lane in range(width):
            Z[_ONE, lane] = 1.0
            Z[_MACH, lane] = mach[lane] + 1e-6 * call
            Z[_ALPHA, lane] = alpha[lane]
        look_up(Z, T, width, tables, cells)
        total += T[0, 0]
    return total


ONE_CELL = np.full(LANES, 4.72), np.full(LANES, 0.031)
CELLS = np.linspace(2.0, 12.0, LANES), np.linspace(0.0, 0.3, LANES)
COMPARED = {  # what: (lanes, Mach numbers and angles, calls) of the slower and of the faster
    f"one lane, {LANES} times / {LANES} lanes in one cell": ((1, ONE_CELL, LANES * CALLS), (LANES, ONE_CELL, CALLS)),
    f"{LANES} lanes in different cells / in one": ((LANES, CELLS, CALLS), (LANES, ONE_CELL, CALLS)),
}


def measure_look_up(compared: str) -> float:
    """The ratio of times."""
    plans, _ = make_work(1)
    tables, cells = plans["lqr"].vehicle.tables, make_cells(LANES)
    slow, fast = COMPARED[compared]

    def call(width: int, points: tuple[Floats, Floats], calls: int) -> float:
        return float(look_up_often(width, tables, cells, *points, calls))

    return measure_ratio(lambda: call(*slow), lambda: call(*fast))
