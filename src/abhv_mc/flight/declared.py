"""Metrics that a campaign declares, counted at every control tick as data: a small program, then a statistic of it.

An instruction puts one number of every lane into a register: a channel, a constant, or what an operation makes of
other registers. Registers are rows of the memory of the tables, which nothing else uses at that moment.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.control import columns as ref
from abhv_mc.flight.channels import Signal
from abhv_mc.jit import lanes
from abhv_mc.numerics.angles import larger, smaller
from abhv_mc.numerics.lane_math import sincos
from abhv_mc.numerics.tables import natural
from abhv_mc.plant import state as s
from abhv_mc.vehicle.arrays import Floats, Ints

MAX_METRICS = 48
MAX_REGISTERS = 16


class Operation(IntEnum):
    """What an instruction does."""

    LOAD = 0  # a row of the lane memory, times the constant
    CONSTANT = 1
    ADD = 2
    SUBTRACT = 3
    MULTIPLY = 4
    DIVIDE = 5
    MINIMUM = 6
    MAXIMUM = 7
    ABSOLUTE = 8
    ROOT = 9
    SINE = 10
    COSINE = 11


class DeclaredStatistic(IntEnum):
    """What a declared metric makes of its value in its window."""

    MIN = 0
    MAX = 1
    MAX_ABS = 2
    MEAN = 3
    RMS = 4
    FINAL = 5
    INTEGRAL = 6  # trapezoidal, over time
    PEAK_TO_PEAK = 7
    TRAVEL = 8  # sum of the absolute changes
    TIME_OUTSIDE = 9  # s in which the size of the value is above the limit
    LAST_OUTSIDE = 10  # s; the window's start where it never was
    FIRST_OUTSIDE = 11  # s; the end of the window or of the flight where it never was
    REVERSALS = 12  # times that it turned back by more than the limit


class Declared(NamedTuple):
    """Declared metrics as numbers."""

    code: Ints  # [instruction, 4] operation, register, and its operands: a row or registers
    constant: Floats  # [instruction]
    first: Ints  # [metric + 1] its first instruction
    statistic: Ints  # [metric]
    limit: Floats  # [metric]
    start: Floats  # [metric] s
    end: Floats  # [metric] s
    settled: Ints  # [metric] 1 where only settled stretches count


class DeclaredMetrics(NamedTuple):
    """Declared metrics with their names."""

    names: NDArray[np.str_]  # [metric]
    units: NDArray[np.str_]
    docs: NDArray[np.str_]
    program: Declared

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Name, unit and meaning of each."""
        return tuple(Signal(*words) for words in zip(*(part.tolist() for part in self[:3]), strict=True))


def make_declared(
    code: list[tuple[int, int, int, int]],
    constant: list[float],
    first: list[int],
    rows: list[tuple[int, float, float, float, int]],
) -> Declared:
    """The arrays; ``rows`` hold statistic, limit, start, end and settled of each metric."""
    numbers = np.array(rows, dtype=np.float64).reshape(-1, 5)
    statistic, settled = (np.ascontiguousarray(numbers[:, i].astype(np.int64)) for i in (0, 4))
    limit, start, end = (np.ascontiguousarray(numbers[:, i]) for i in (1, 2, 3))
    return Declared(
        np.array(code, dtype=np.int64).reshape(-1, 4),
        np.array(constant, dtype=np.float64),
        np.array(first, dtype=np.int64),
        statistic,
        limit,
        start,
        end,
        settled,
    )


_NO_WORDS = np.empty(0, dtype=np.str_)
NOTHING_DECLARED = make_declared([], [], [0], [])
NO_METRICS = DeclaredMetrics(_NO_WORDS, _NO_WORDS, _NO_WORDS, NOTHING_DECLARED)

# Rows that each metric keeps: two accumulators, the last value (or the turning sense), the last tick that counted
# (from 1), and how many did.
_A, _B, _C, _TICK, _COUNT = range(5)
ROWS = 5
N_ROWS = ROWS * MAX_METRICS

_LOAD, _CONSTANT, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _MINIMUM, _MAXIMUM, _ABSOLUTE, _ROOT, _SINE, _COSINE = map(
    int, Operation
)
_MIN, _MAX, _MAX_ABS, _MEAN, _RMS, _FINAL, _INTEGRAL, _PEAK, _TRAVEL, _TIME, _LAST, _FIRST, _REVERSALS = map(
    int, DeclaredStatistic
)


@lanes
def update_declared(memory, width, plan, tick, first_row):
    """Add the tick to the declared metrics of the flights that count; their rows of O begin at ``first_row``."""
    Z, T, O, program = memory.Z, memory.T, memory.O, plan.declared
    dt = plan.timing.step * plan.timing.steps_per_tick
    now = tick * dt
    settled = plan.reference[tick, ref.SETTLED] > 0.0
    for m in range(program.statistic.size):
        inside = now >= program.start[m] - 1e-9 and now <= program.end[m] + 1e-9
        if inside and (settled or program.settled[m] == 0):
            value = 0
            for i in range(program.first[m], program.first[m + 1]):
                value = natural(program.code[i, 1])
                calculate(Z, T, program.code[i], program.constant[i], width)
            row = natural(first_row + ROWS * m)
            count_value(O, row, T[value], Z[s.COUNTED], program.statistic[m], program.limit[m], tick, dt, width)


@lanes
def calculate(Z, T, code, constant, width):
    """One instruction in all lanes."""
    operation, out = code[0], T[natural(code[1])]
    if operation == _LOAD:
        row = Z[natural(code[2])]
        for lane in range(width):
            out[lane] = row[lane] * constant
    elif operation == _CONSTANT:
        for lane in range(width):
            out[lane] = constant
    else:
        a, b = T[natural(code[2])], T[natural(code[3])]
        if operation == _ADD:
            for lane in range(width):
                out[lane] = a[lane] + b[lane]
        elif operation == _SUBTRACT:
            for lane in range(width):
                out[lane] = a[lane] - b[lane]
        elif operation == _MULTIPLY:
            for lane in range(width):
                out[lane] = a[lane] * b[lane]
        elif operation == _DIVIDE:
            for lane in range(width):
                out[lane] = a[lane] / b[lane]
        elif operation == _MINIMUM:
            for lane in range(width):
                out[lane] = smaller(a[lane], b[lane])
        elif operation == _MAXIMUM:
            for lane in range(width):
                out[lane] = larger(a[lane], b[lane])
        elif operation == _ABSOLUTE:
            for lane in range(width):
                out[lane] = abs(a[lane])
        elif operation == _ROOT:
            for lane in range(width):
                x = a[lane]
                out[lane] = math.sqrt(x) if x >= 0.0 else math.nan
        else:
            for lane in range(width):
                sine, cosine = sincos(a[lane])
                out[lane] = sine if operation == _SINE else cosine


@lanes
def count_value(O, row, value, counted, statistic, limit, tick, dt, width):
    """One sample of one metric, in the lanes that count."""
    a, b, c, last, count = O[row], O[row + _B], O[row + _C], O[row + _TICK], O[row + _COUNT]
    now = float(tick)
    if statistic in (_MIN, _MAX, _PEAK):
        for lane in range(width):
            x, begins = value[lane], count[lane] == 0.0
            low = x if begins else smaller(a[lane], x)
            high = x if begins else larger(b[lane], x)
            a[lane] = low if counted[lane] > 0.0 else a[lane]
            b[lane] = high if counted[lane] > 0.0 else b[lane]
    elif statistic == _MAX_ABS:
        for lane in range(width):
            a[lane] = larger(a[lane], abs(value[lane])) if counted[lane] > 0.0 else a[lane]
    elif statistic in (_MEAN, _RMS):
        power = statistic == _RMS
        for lane in range(width):
            x = value[lane]
            a[lane] += (x * x if power else x) if counted[lane] > 0.0 else 0.0
    elif statistic == _FINAL:
        for lane in range(width):
            a[lane] = value[lane] if counted[lane] > 0.0 else a[lane]
    elif statistic in (_INTEGRAL, _TRAVEL):  # nothing across a gap between settled stretches
        for lane in range(width):
            x = value[lane]
            follows = counted[lane] > 0.0 and count[lane] > 0.0 and last[lane] == now
            step = abs(x - c[lane]) if statistic == _TRAVEL else 0.5 * dt * (x + c[lane])
            a[lane] += step if follows else 0.0
            c[lane] = x
    elif statistic in (_TIME, _LAST, _FIRST):
        for lane in range(width):
            outside = counted[lane] > 0.0 and abs(value[lane]) > limit
            before = a[lane]
            latest = now * dt if statistic == _LAST or b[lane] == 0.0 else before
            after = before + dt if statistic == _TIME else latest
            a[lane] = after if outside else before
            b[lane] = 1.0 if outside else b[lane]
    else:  # _REVERSALS: b is the turning point so far, c the sense in which it moves
        for lane in range(width):
            x = value[lane]
            begins = count[lane] == 0.0
            turn, sense = (x if begins else b[lane]), c[lane]
            moved = x - turn
            starts = sense == 0.0 and abs(moved) > limit
            turns = moved * sense < 0.0 and abs(moved) > limit
            follows = starts or turns or moved * sense > 0.0
            counts = counted[lane] > 0.0
            a[lane] += 1.0 if turns and counts else 0.0
            b[lane] = (x if follows else turn) if counts else b[lane]
            c[lane] = (1.0 if moved > 0.0 else -1.0) if counts and (starts or turns) else sense
    for lane in range(width):
        last[lane] = now + 1.0 if counted[lane] > 0.0 else last[lane]
        count[lane] += counted[lane]


@lanes
def finish_declared(O, lane, program, dt, first_row, first_out, out):
    """The declared metrics of one lane, into ``out`` from ``first_out``; NaN where its window was never reached."""
    for m in range(program.statistic.size):
        row = natural(first_row + ROWS * m)
        a, b, count = O[row, lane], O[row + _B, lane], O[row + _COUNT, lane]
        statistic = program.statistic[m]
        value = a
        if statistic == _MAX:
            value = b
        elif statistic == _PEAK:
            value = b - a
        elif statistic == _MEAN:
            value = a / count
        elif statistic == _RMS:
            value = math.sqrt(a / count) if count > 0.0 else math.nan
        elif statistic == _LAST and b == 0.0:
            value = program.start[m]
        elif statistic == _FIRST and b == 0.0:
            value = (O[row + _TICK, lane] - 1.0) * dt
        out[first_out + m] = value if count > 0.0 else math.nan
