"""The compiled flight: ``width`` flights abreast, tick by tick, from the start to the end of the mission.

One kernel serves every vehicle, mission, controller and gain: they are arguments. A lane never looks at
another lane, so a flight is the same bit for bit whatever flies beside it.
"""

from collections.abc import Callable

from abhv_mc.control.lqr import lqr_tick
from abhv_mc.control.recorded import recorded_tick
from abhv_mc.control.tlc import tlc_tick
from abhv_mc.flight import observe
from abhv_mc.flight.memory import Z_ROWS, has_width
from abhv_mc.flight.navigation import navigate
from abhv_mc.flight.observe import finish_metrics, judge, measure, record, record_states, start_observing
from abhv_mc.flight.sensors import find_faults, sense
from abhv_mc.flight.start import start_flights
from abhv_mc.jit import kernel, lanes
from abhv_mc.plant import state as s
from abhv_mc.plant.actuators import prepare_actuators, run_actuators, set_actuators
from abhv_mc.plant.aerodynamics import build_up, look_up
from abhv_mc.plant.air_data import air_data, deflections, move_air
from abhv_mc.plant.disturbance import any_lane, disturb, find_unrest
from abhv_mc.plant.equations import equations_of_motion, finish_step, runge_kutta_stage

CLOSING = 500  # ticks after which flights close ranks

# Which law flies: the integers that the kernel compares.
TLC, LQR, RECORDED = range(3)
LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED}


@lanes
def evaluate(Z, T, width, vehicle, earth, cells, stage, windy):
    """One Runge-Kutta stage at ``XS``."""
    if windy:
        move_air(Z, width)
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
    unrest, faults = find_unrest(Z, width), find_faults(Z, width)
    for tick in range(first_tick, end):
        navigate(Z, width, tick_length, tick == 0)
        disturb(Z, width, unrest, tick * tick_length, tick_length, tick == 0)
        sense(Z, width, faults, tick_length, tick)
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
            evaluate(Z, T, width, vehicle, earth, cells, runge_kutta_stage(stage, step), unrest.windy)
            if evaluation == 0:
                judge(Z, O, width, limits, tick)
                measure(Z, O, width, vehicle, reference, tick, tick_length)
                if record_every > 0 and tick % record_every == 0:
                    record(Z, history, flights, n, tick // record_every)
                    if states.shape[1] > 0:
                        record_states(Z, states, flights, n, tick // record_every)
                flying = tick < ticks and any_lane(O, width, observe.ALIVE, 1, 0.0)
                if not flying:
                    break
            if stage == 0:
                run_actuators(Z, width, vehicle.constants, step, law == RECORDED)
            elif stage == 2:
                set_actuators(Z, width)
            elif stage == 3:
                finish_step(Z, width, step, O[observe.ALIVE])
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


def make_fly_lanes(capacity: int) -> Callable[..., None]:
    """The compiled flight for ``capacity`` lanes (compiled at its first call, kept on disk).

    The number of lanes is a constant of the machine code, but for numba a number as any other: functions for each
    constant would be optimized each by itself, and small loops unrolled into scalar code before they became vectors.
    """

    @kernel
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
        memory,
    ):
        """Fly every row of ``parameters`` [flight, parameter]; fill the arrays behind ``initial_state``.

        ``states`` [flight, sample, state] may have no samples; then no state is kept. ``memory``: for ``capacity``.
        """
        if has_width(memory, capacity):  # which is so by construction, and a constant to LLVM from here on
            fly_groups(
                memory.Z,
                memory.T,
                memory.O,
                memory.Z.shape[1],
                memory.kept,
                memory.order,
                (memory.cells, memory.trim, memory.high),
                memory.unit_factors,
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
