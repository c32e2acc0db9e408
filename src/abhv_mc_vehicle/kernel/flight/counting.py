"""Accumulation of the metrics that :mod:`abhv_mc_vehicle.flight.compile_metrics` defines as data.

A lean metric is a statistic of one row of the lane memory and needs one accumulator. Any other
metric is a statistic, in a time window, of a value that a small program computes. Each instruction
of a program sets a register in every lane to a row of the lane memory, a constant, or the result of
an operation on other registers. Registers are rows of the memory for table values, which is unused
while metrics are updated.
"""

import math
from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flights.statistic import MAX_DECLARED, Operation, Statistic
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.numerics.lane_math import larger, sincos, smaller
from abhv_mc_vehicle.kernel.numerics.tables import natural
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ACTUATORS

MAX_LEAN = 42 + 3 * MAX_ACTUATORS  # maximum number of built-in metrics
MAX_PROGRAMS = MAX_DECLARED + MAX_ACTUATORS


class Lean(NamedTuple):
    """Metrics that are statistics of single rows over the complete flight."""

    row: Ints  # [metric] row of the lane memory
    factor: Floats  # [metric] factor applied to the row's value
    statistic: Ints  # [metric] kind of statistic
    empty: Floats  # [metric] value if no tick is counted, and initial value of the accumulator
    settled: Ints  # [metric] 1 if only ticks in settled intervals are counted
    column: Ints  # [metric] column among the flight's metrics


class Programs(NamedTuple):
    """Metrics that are statistics of programs, because of an expression or a time window."""

    code: Ints  # [instruction, 4] operation, register, and operands (a row or registers)
    constant: Floats  # [instruction] constant operand
    first: Ints  # [metric + 1] first instruction of each metric
    factor: Floats  # [metric] factor applied to the changes that TRAVEL sums
    statistic: Ints  # [metric] kind of statistic
    limit: Floats  # [metric] limit of the statistic
    start: Floats  # [metric] start of the window, s
    end: Floats  # [metric] end of the window, s
    settled: Ints  # [metric] 1 if only ticks in settled intervals are counted
    empty: Floats  # [metric] value if no tick is counted
    column: Ints  # [metric] column among the flight's metrics


class Counted(NamedTuple):
    """All metrics of a flight: lean metrics and metric programs."""

    lean: Lean
    programs: Programs


# The rows of a metric program in the observer's memory follow the rows of the lean metrics.
# _A and _B are accumulators, _C is the last value or direction, and _TICK is the number of the last
# counted tick, starting at 1. _COUNT is the number of counted ticks, or NaN if any counted value
# was NaN.
_A, _B, _C, _TICK, _COUNT = range(5)
ROWS = 5
N_ROWS = MAX_LEAN + ROWS * MAX_PROGRAMS

(
    _LOAD,
    _CONSTANT,
    _ADD,
    _SUBTRACT,
    _MULTIPLY,
    _DIVIDE,
    _MINIMUM,
    _MAXIMUM,
    _ABSOLUTE,
    _ROOT,
    _SINE,
    _COSINE,
    *_,
) = map(int, Operation)
(
    _MIN, _MAX, _MAX_ABS, _MEAN, _RMS, _FINAL, _INTEGRAL, _PEAK, _TRAVEL, _TIME, _LAST, _FIRST,
    _REVERSALS, _SUM, _QUANTILE, *_,
) = map(int, Statistic)  # fmt: skip


@lanes
def start_counting(O, width, counted, first_row):
    """Initialize all accumulators, which are the rows of ``O`` starting at ``first_row``."""
    for i in range(N_ROWS):
        for lane in range(width):
            O[first_row + i, lane] = 0.0
    for m in range(counted.lean.empty.size):
        for lane in range(width):
            O[natural(first_row + m), lane] = counted.lean.empty[m]


@lanes
def count_tick(memory, width, plan, samples, flights, n, tick, first_row):
    """Add a tick's values to the metrics of the counted ``flights`` in the first ``n`` lanes.

    The rows of the metrics in ``O`` start at ``first_row``; ``samples`` [quantile, flight, tick]
    stores the values for quantiles.
    """
    Z = memory.Z
    T = memory.T
    O = memory.O
    lean = plan.counted.lean
    programs = plan.counted.programs
    dt = plan.timing.step * plan.timing.steps_per_tick
    now = tick * dt
    settled = plan.reference[tick, ref.SETTLED] > 0.0
    for m in range(lean.row.size):
        if settled or lean.settled[m] == 0:
            out = O[natural(first_row + m)]
            row = Z[natural(lean.row[m])]
            count_row(out, row, lean.factor[m], lean.statistic[m], dt, Z[s.COUNTED], width)
    quantile = 0
    for m in range(programs.statistic.size):
        inside = now >= programs.start[m] - 1e-9 and now <= programs.end[m] + 1e-9
        if inside and (settled or programs.settled[m] == 0):
            value = 0
            for i in range(programs.first[m], programs.first[m + 1]):
                value = natural(programs.code[i, 1])
                calculate(Z, T, programs.code[i], programs.constant[i], width)
            if programs.statistic[m] == _QUANTILE:
                for lane in range(n):
                    if Z[s.COUNTED, lane] > 0.0:
                        samples[quantile, flights[lane], tick] = T[value, lane]
            row = natural(first_row + MAX_LEAN + ROWS * m)
            statistic = programs.statistic[m]
            limit = programs.limit[m]
            factor = programs.factor[m]
            count_value(O, row, T[value], Z[s.COUNTED], statistic, limit, factor, tick, dt, width)
        quantile += 1 if programs.statistic[m] == _QUANTILE else 0


@lanes
def count_row(out, row, factor, statistic, dt, counted, width):
    """Add a sample to a lean metric in the counted lanes."""
    if statistic == _RMS:
        for lane in range(width):
            value = row[lane] * factor
            out[lane] += value * value if counted[lane] > 0.0 else 0.0
    elif statistic == _MAX_ABS:
        for lane in range(width):
            out[lane] = (
                larger(out[lane], abs(row[lane] * factor)) if counted[lane] > 0.0 else out[lane]
            )
    elif statistic == _MIN:
        for lane in range(width):
            out[lane] = smaller(out[lane], row[lane] * factor) if counted[lane] > 0.0 else out[lane]
    elif statistic == _MAX:
        for lane in range(width):
            out[lane] = larger(out[lane], row[lane] * factor) if counted[lane] > 0.0 else out[lane]
    elif statistic == _FINAL:
        for lane in range(width):
            out[lane] = row[lane] * factor if counted[lane] > 0.0 else out[lane]
    elif statistic == _SUM:
        for lane in range(width):
            out[lane] += row[lane] * factor if counted[lane] > 0.0 else 0.0
    else:  # The statistic is TIME_OUTSIDE of a nonnegative value, with a limit of zero.
        for lane in range(width):
            out[lane] += dt if counted[lane] > 0.0 and row[lane] > 0.0 else 0.0


@lanes
def calculate(Z, T, instruction, constant, width):
    """Execute one instruction of a metric program in all lanes."""
    operation = instruction[0]
    out = T[natural(instruction[1])]
    if operation == _LOAD:
        row = Z[natural(instruction[2])]
        for lane in range(width):
            out[lane] = row[lane] * constant
    elif operation == _CONSTANT:
        for lane in range(width):
            out[lane] = constant
    else:
        a = T[natural(instruction[2])]
        b = T[natural(instruction[3])]
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
        elif operation == _MINIMUM:  # The result is NaN if either operand is NaN.
            for lane in range(width):
                out[lane] = b[lane] if b[lane] < a[lane] or b[lane] != b[lane] else a[lane]
        elif operation == _MAXIMUM:
            for lane in range(width):
                out[lane] = b[lane] if b[lane] > a[lane] or b[lane] != b[lane] else a[lane]
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
def count_value(O, row, value, counted, statistic, limit, factor, tick, dt, width):
    """Add a sample to a metric computed by a program, in the counted lanes."""
    a = O[row]
    b = O[row + _B]
    c = O[row + _C]
    last = O[row + _TICK]
    count = O[row + _COUNT]
    now = float(tick)
    if statistic in (_MIN, _MAX, _PEAK):
        for lane in range(width):
            x = value[lane]
            begins = count[lane] == 0.0
            low = x if begins else smaller(a[lane], x)
            high = x if begins else larger(b[lane], x)
            a[lane] = low if counted[lane] > 0.0 else a[lane]
            b[lane] = high if counted[lane] > 0.0 else b[lane]
    elif statistic == _MAX_ABS:
        for lane in range(width):
            a[lane] = larger(a[lane], abs(value[lane])) if counted[lane] > 0.0 else a[lane]
    elif statistic in (_MEAN, _RMS, _SUM):
        power = statistic == _RMS
        for lane in range(width):
            x = value[lane]
            a[lane] += (x * x if power else x) if counted[lane] > 0.0 else 0.0
    elif statistic == _FINAL:
        for lane in range(width):
            a[lane] = value[lane] if counted[lane] > 0.0 else a[lane]
    elif statistic in (_INTEGRAL, _TRAVEL):  # Gaps between settled intervals contribute nothing.
        for lane in range(width):
            x = value[lane]
            follows = counted[lane] > 0.0 and count[lane] > 0.0 and last[lane] == now
            step = abs(x - c[lane]) * factor if statistic == _TRAVEL else 0.5 * dt * (x + c[lane])
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
    elif statistic == _REVERSALS:  # ``b`` is the current extreme, ``c`` the direction.
        for lane in range(width):
            x = value[lane]
            begins = count[lane] == 0.0
            turn = x if begins else b[lane]
            sense = c[lane]
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
        ticks = counted[lane] if value[lane] == value[lane] else math.nan
        count[lane] += ticks if counted[lane] > 0.0 else 0.0


@lanes
def finish_counting(O, lane, counted, samples, dt, first_row, out):
    """Compute the metrics ``out`` [metric] of one lane with ``samples`` counted ticks."""
    lean = counted.lean
    programs = counted.programs
    for m in range(lean.row.size):
        a = O[natural(first_row + m), lane]
        out[lean.column[m]] = finish_value(
            lean.statistic[m], a, a, samples, 0.0, 0.0, lean.empty[m]
        )
    for m in range(programs.statistic.size):
        row = natural(first_row + MAX_LEAN + ROWS * m)
        a = O[row, lane]
        b = O[row + _B, lane]
        count = O[row + _COUNT, lane]
        last = (O[row + _TICK, lane] - 1.0) * dt
        value = finish_value(
            programs.statistic[m], a, b, count, programs.start[m], last, programs.empty[m]
        )
        out[programs.column[m]] = value


@lanes
def finish_value(statistic, a, b, count, start, last, empty):
    """Return a metric's value from its accumulators; ``start`` and ``last`` are times, s."""
    inverse = 1.0 / larger(1.0, count)
    value = a
    if statistic == _MAX:
        value = b
    elif statistic == _PEAK:
        value = b - a
    elif statistic == _MEAN:
        value = a * inverse
    elif statistic == _RMS:
        value = math.sqrt(a * inverse)
    elif statistic == _LAST and b == 0.0:
        value = start
    elif statistic == _FIRST and b == 0.0:
        value = last
    return value if count > 0.0 else empty if count == 0.0 else math.nan
