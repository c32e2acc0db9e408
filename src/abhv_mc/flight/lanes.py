"""The compiled flight: ``width`` flights abreast, tick by tick, from the start to the end of the mission.

One kernel serves every vehicle, mission, controller and gain: they are arguments. A lane never looks at
another lane, so a flight is the same bit for bit whatever flies beside it.
"""

from collections.abc import Callable

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
from abhv_mc.jit import kernel, lanes
from abhv_mc.plant import state as s
from abhv_mc.plant.actuators import prepare_actuators, run_actuators, set_actuators
from abhv_mc.plant.aerodynamics import Cells, build_up, look_up
from abhv_mc.plant.air_data import air_data, deflections
from abhv_mc.plant.disturbance import any_lane, disturb
from abhv_mc.plant.equations import equations_of_motion, finish_step, runge_kutta_stage

LANES = 16

# Which law flies: the integers that the kernel compares.
TLC, LQR, RECORDED = range(3)
LAWS = {"tlc": TLC, "lqr": LQR, "recorded": RECORDED}

_Z_ROWS = s.LAW + tlc.N_ROWS


@lanes
def evaluate(Z, T, width, vehicle, earth, cells, stage):
    """One Runge-Kutta stage at ``XS``."""
    air_data(Z, width, vehicle, earth)
    deflections(Z, width, vehicle)
    look_up(Z, T, width, vehicle.tables, cells)
    build_up(Z, T, width, vehicle.build_up, vehicle.build_up.factor)
    equations_of_motion(Z, width, vehicle, earth, stage)


@lanes
def fly_groups(
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
    record_every,
    parameters,
    initial_state,
    metrics,
    outcome,
    end_tick,
    history,
    states,
):
    """Every group of ``width`` flights, one after another, in lane memory that the caller allocated."""
    flights = parameters.shape[0]
    cells, _, _ = scratch
    is_recorded = law == RECORDED
    tick_length = step * steps_per_tick
    for first in range(0, flights, width):
        n = min(width, flights - first)
        for i in range(_Z_ROWS):
            for lane in range(width):
                Z[i, lane] = 0.0
        for lane in range(width):
            flight = first + min(lane, n - 1)  # spare lanes repeat the last flight, unseen
            for i in range(s.N_PARAMETERS):
                Z[s.P + i, lane] = parameters[flight, i]
        start_flights(Z, width, initial_state)
        prepare_actuators(Z, width, vehicle.constants, step)
        start_observing(Z, O, width)
        for tick in range(ticks + 1):
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
                        record(Z, width, history, first, n, tick // record_every)
                        if states.shape[1] > 0:
                            record_states(Z, states, first, n, tick // record_every)
                    flying = tick < ticks and any_lane(O, width, observe.ALIVE, 0.0)
                    if not flying:
                        break
                if stage == 0:
                    run_actuators(Z, width, vehicle.constants, step, is_recorded)
                elif stage == 2:
                    set_actuators(Z, width)
                elif stage == 3:
                    finish_step(Z, width, O[observe.ALIVE])
            if not flying:
                break
        finish_metrics(O, width, metrics, first, n)
        for lane in range(n):
            outcome[first + lane] = int(O[observe.OUTCOME, lane])
            end_tick[first + lane] = int(O[observe.END, lane])


def make_fly_lanes(capacity: int) -> Callable[..., None]:
    """The compiled flight for ``capacity`` lanes (compiled at its first call, cached on disk).

    The kernel takes the number of lanes again at run time: a constant row length tells the compiler that rows do not
    overlap, but loops of a constant length are unrolled into scalar code before they could become vectors.
    """

    @kernel
    def fly_lanes(
        width,
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
        """Fly every row of ``parameters`` [flight, parameter]; fill the arrays behind ``initial_state``.

        ``states`` [flight, sample, state] may have no samples; then no state is kept.
        """
        Z = np.empty((_Z_ROWS, capacity))
        O = np.empty((observe.N_ROWS, capacity))
        T = np.empty((s.MAX_TABLE_ROWS, capacity))
        cells = Cells(
            np.zeros((s.MAX_AXES, capacity), dtype=np.int64),
            np.zeros((s.MAX_AXES, capacity)),
            np.zeros(s.MAX_AXES, dtype=np.int64),
            np.zeros(s.MAX_AXES, dtype=np.int64),
            np.empty((4, capacity)),
            np.empty(s.MAX_TABLE_ROWS),
        )
        trim_hints = np.zeros((3, capacity), dtype=np.int64)
        high = np.empty(s.MAX_TABLE_ROWS)
        unit_factors = np.zeros(vehicle.build_up.factor.size, dtype=np.int64)
        fly_groups(
            Z,
            T,
            O,
            width,
            (cells, trim_hints, high),
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
        )

    return fly_lanes
