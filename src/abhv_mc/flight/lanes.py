"""The compiled flight: ``width`` flights abreast, tick by tick, from the start to the end of the mission.

One kernel serves every vehicle, mission, controller and gain: they are arguments. A lane never looks at
another lane, so a flight is the same bit for bit whatever flies beside it.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.control import tlc
from abhv_mc.control.lqr import lqr_tick
from abhv_mc.control.recorded import recorded_tick
from abhv_mc.control.tlc import tlc_tick
from abhv_mc.flight import observe
from abhv_mc.flight.navigation import navigate
from abhv_mc.flight.observe import finish_metrics, judge, measure, record, record_states, start_observing
from abhv_mc.flight.sensors import sense
from abhv_mc.flight.start import start_flights
from abhv_mc.jit import lanes, standalone
from abhv_mc.plant import state as s
from abhv_mc.plant.actuators import prepare_actuators, run_actuators, set_actuators
from abhv_mc.plant.aerodynamics import Cells, build_up, look_up
from abhv_mc.plant.air_data import air_data, deflections
from abhv_mc.plant.disturbance import any_lane, disturb
from abhv_mc.plant.equations import equations_of_motion, finish_step, runge_kutta_stage
from abhv_mc.vehicle.arrays import Floats, Ints

LANES = 16
CLOSING = 500  # ticks after which flights close ranks
TOGETHER = 256  # flights that do: what they remember stays near the processor

_LINE = 64  # bytes of a line of the cache

# Which law flies: the integers that the kernel compares.
TLC, LQR, RECORDED = range(3)
LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED}

Z_ROWS = s.LAW + tlc.N_ROWS
KEPT_ROWS = Z_ROWS + observe.N_ROWS


@lanes
def evaluate(Z, T, width, vehicle, earth, cells, stage):
    """One Runge-Kutta stage at ``XS``."""
    air_data(Z, width, vehicle, earth)
    deflections(Z, width, vehicle)
    look_up(Z, T, width, vehicle.tables, cells)
    build_up(Z, T, width, vehicle.build_up, vehicle.build_up.factor)
    equations_of_motion(Z, width, vehicle, earth, stage)


@lanes
def fly_ticks(
    Z,
    T,
    O,
    width,
    scratch,
    unit_factors,
    vehicle,
    trim,
    effectiveness,
    earth,
    law,
    reference,
    gains,
    settings,
    limits,
    step,
    steps_per_tick,
    ticks,
    first_tick,
    end,
    record_every,
    flights,
    n,
    history,
    states,
):
    """One group of flights from ``first_tick`` to before tick ``end``, or until none of them flies."""
    cells, _, _ = scratch
    tick_length = step * steps_per_tick
    for tick in range(first_tick, end):
        navigate(Z, width, tick_length, tick == 0)
        disturb(Z, width, tick * tick_length, tick_length, tick == 0)
        sense(Z, width, tick_length, tick)
        if law == TLC:
            tlc_tick(
                Z,
                T,
                width,
                vehicle,
                trim,
                effectiveness,
                earth,
                reference,
                gains,
                settings,
                tick,
                tick_length,
                tick == 0,
                scratch,
                unit_factors,
            )
        elif law == LQR:
            lqr_tick(Z, width, vehicle, earth, reference, gains, settings, tick)
        else:
            recorded_tick(Z, width, gains, tick)
        flying = True
        for evaluation in range(4 * steps_per_tick):  # one loop, so that its code is there once
            stage = evaluation % 4
            evaluate(Z, T, width, vehicle, earth, cells, runge_kutta_stage(stage, step))
            if evaluation == 0:
                judge(Z, O, width, limits, tick)
                measure(Z, O, width, vehicle, reference, tick, tick_length)
                if record_every > 0 and tick % record_every == 0:
                    record(Z, history, flights, n, tick // record_every)
                    if states.shape[1] > 0:
                        record_states(Z, states, flights, n, tick // record_every)
                flying = tick < ticks and any_lane(O, width, observe.ALIVE, 0.0)
                if not flying:
                    break
            if stage == 0:
                run_actuators(Z, width, vehicle.constants, step, law == RECORDED)
            elif stage == 2:
                set_actuators(Z, width)
            elif stage == 3:
                finish_step(Z, width, O[observe.ALIVE])
        if not flying:
            break


@lanes
def fly_groups(
    Z,
    T,
    O,
    width,
    kept,
    order,
    scratch,
    unit_factors,
    vehicle,
    trim,
    effectiveness,
    earth,
    law,
    reference,
    gains,
    settings,
    limits,
    step,
    steps_per_tick,
    ticks,
    record_every,
    parameters,
    initial_state,
    metrics,
    outcome,
    end_tick,
    history,
    states,
):
    """Every flight, in groups of ``width`` abreast, in memory that the caller allocated.

    As many flights as ``kept`` [flight, row] has room for fly a while group by group; then those still flying close
    ranks: a lane whose flight has ended is taken by another. ``order`` [flight] is room for their numbers.
    """
    together = 1 < width < parameters.shape[0]  # otherwise there is nobody to close ranks with
    for first in range(0, parameters.shape[0], kept.shape[0]):
        flying = min(kept.shape[0], parameters.shape[0] - first)
        for i in range(flying):
            order[i] = first + i
        for first_tick in range(0, ticks + 1, CLOSING if together else ticks + 1):
            end = min(first_tick + CLOSING, ticks + 1) if together else ticks + 1
            still_flying = 0
            for group in range(0, flying, width):
                n = min(width, flying - group)
                flights = order[group : group + n]
                if first_tick == 0:
                    start_lanes(Z, width, parameters, flights, n)
                    start_flights(Z, width, initial_state)
                    prepare_actuators(Z, width, vehicle.constants, step)
                    start_observing(Z, O, width)
                else:
                    fetch_lanes(Z, O, width, kept, group, n)
                fly_ticks(
                    Z,
                    T,
                    O,
                    width,
                    scratch,
                    unit_factors,
                    vehicle,
                    trim,
                    effectiveness,
                    earth,
                    law,
                    reference,
                    gains,
                    settings,
                    limits,
                    step,
                    steps_per_tick,
                    ticks,
                    first_tick,
                    end,
                    record_every,
                    flights,
                    n,
                    history,
                    states,
                )
                for lane in range(n):
                    flight = flights[lane]
                    if O[observe.ALIVE, lane] > 0.0 and end <= ticks:
                        keep_lane(Z, O, lane, kept, still_flying)  # at or before its own place, already fetched
                        order[still_flying] = flight
                        still_flying += 1
                    else:
                        finish_metrics(O, lane, metrics[flight])
                        outcome[flight] = int(O[observe.OUTCOME, lane])
                        end_tick[flight] = int(O[observe.END, lane])
            flying = still_flying


@lanes
def start_lanes(Z, width, parameters, flights, n):
    """Clear the lanes and give each its flight's parameters; spare lanes repeat the last flight, unseen."""
    for i in range(Z_ROWS):
        for lane in range(width):
            Z[i, lane] = 0.0
    for lane in range(width):
        flight = flights[min(lane, n - 1)]
        for i in range(s.N_PARAMETERS):
            Z[s.P + i, lane] = parameters[flight, i]


@lanes
def keep_lane(Z, O, lane, kept, place):
    """Put everything that a flight remembers into its place."""
    row = kept[place]
    for i in range(Z_ROWS):
        row[i] = Z[i, lane]
    for i in range(observe.N_ROWS):
        row[Z_ROWS + i] = O[i, lane]


@lanes
def fetch_lanes(Z, O, width, kept, first, n):
    """Flights from their places back into the lanes; spare lanes repeat the last."""
    for lane in range(width):
        row = kept[first + min(lane, n - 1)]
        for i in range(Z_ROWS):
            Z[i, lane] = row[i]
        for i in range(observe.N_ROWS):
            O[i, lane] = row[Z_ROWS + i]


class Room(NamedTuple):
    """The memory that flights abreast work in."""

    Z: Floats  # [row, lane] everything that a flight remembers, see abhv_mc.plant.state
    O: Floats  # [row, lane] what is observed
    T: Floats  # [table row, lane]
    cells: Cells
    trim_hints: Ints  # [axis, lane]
    high: Floats  # [table row]
    unit_factors: Ints  # [term]
    kept: Floats  # [flight, row] what flights remember while others fly
    order: Ints  # [flight] their numbers


def make_room(capacity: int, terms: int) -> Room:
    """Memory for ``capacity`` lanes and a vehicle whose coefficients have so many ``terms``."""
    return Room(
        Z=allocate((Z_ROWS, capacity)),
        O=allocate((observe.N_ROWS, capacity)),
        T=allocate((s.MAX_TABLE_ROWS, capacity)),
        cells=Cells(
            allocate((s.MAX_AXES, capacity), np.int64),
            allocate((s.MAX_AXES, capacity)),
            allocate((s.MAX_AXES,), np.int64),
            allocate((s.MAX_AXES,), np.int64),
            allocate((4, capacity)),
            allocate((s.MAX_TABLE_ROWS,)),
        ),
        trim_hints=allocate((3, capacity), np.int64),
        high=allocate((s.MAX_TABLE_ROWS,)),
        unit_factors=allocate((terms,), np.int64),
        kept=allocate((TOGETHER, KEPT_ROWS)),
        order=allocate((TOGETHER,), np.int64),
    )


def allocate(shape: tuple[int, ...], dtype: Any = np.float64) -> Any:
    """Zeros, eight bytes each, that start where a line of the processor's cache does."""
    size = math.prod(shape)
    wider = np.zeros(size + _LINE // 8, dtype)
    first = -wider.ctypes.data % _LINE // 8
    return wider[first : first + size].reshape(shape)


def make_fly_lanes(capacity: int) -> Callable[..., None]:
    """The compiled flight for ``capacity`` lanes (compiled at its first call, kept on disk).

    The number of lanes is a constant of the machine code, but for numba a number as any other: functions for each
    constant would be optimized each by itself, and small loops unrolled into scalar code before they became vectors.
    """

    @standalone
    def fly_lanes(
        vehicle,
        trim,
        effectiveness,
        earth,
        law,
        reference,
        gains,
        settings,
        limits,
        step,
        steps_per_tick,
        ticks,
        record_every,
        parameters,
        initial_state,
        metrics,
        outcome,
        end_tick,
        history,
        states,
        room,
    ):
        """Fly every row of ``parameters`` [flight, parameter]; fill the arrays behind ``initial_state``.

        ``states`` [flight, sample, state] may have no samples; then no state is kept. ``room``: for ``capacity``.
        """
        cells = room.cells
        # These are so by construction; compared, they are constants to LLVM from here on.
        if (
            room.Z.shape[1] == capacity
            and room.O.shape[1] == capacity
            and room.T.shape[1] == capacity
            and cells.cell.shape[1] == capacity
            and cells.fraction.shape[1] == capacity
            and cells.weight.shape[1] == capacity
            and room.trim_hints.shape[1] == capacity
        ):
            fly_groups(
                room.Z,
                room.T,
                room.O,
                room.Z.shape[1],
                room.kept,
                room.order,
                (cells, room.trim_hints, room.high),
                room.unit_factors,
                vehicle,
                trim,
                effectiveness,
                earth,
                law,
                reference,
                gains,
                settings,
                limits,
                step,
                steps_per_tick,
                ticks,
                record_every,
                parameters,
                initial_state,
                metrics,
                outcome,
                end_tick,
                history,
                states,
            )

    return fly_lanes
