"""Compiled simulation of ``width`` flights in parallel lanes, tick by tick.

Vehicle, mission, controller and gains are arguments of one kernel. Lanes are independent: the
results of a flight do not depend on the flights in other lanes, and are bit-identical in any
grouping. The arguments are three named tuples: the plan
(:class:`abhv_mc_vehicle.kernel.flight.interface.KernelPlan`), the working memory
(:class:`abhv_mc_vehicle.kernel.flight.interface.Memory`) and the results
(:class:`abhv_mc_vehicle.kernel.flight.interface.KernelResults`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from abhv_mc_vehicle.kernel.flight import observe
from abhv_mc_vehicle.kernel.flight.counting import count_tick, finish_counting
from abhv_mc_vehicle.kernel.flight.derived import derive, follow_ripples
from abhv_mc_vehicle.kernel.flight.interface import (
    LQR,
    PYTHON,
    RECORDED,
    TLC,
    Z_ROWS,
    copy_lanes,
    end_spare_lanes,
    has_width,
)
from abhv_mc_vehicle.kernel.flight.navigation import measure_air, measure_more, navigate
from abhv_mc_vehicle.kernel.flight.observe import (
    check_limits,
    finish_flights,
    follow_extremes,
    keep_extremes,
    record,
    record_states,
    start_observing,
)
from abhv_mc_vehicle.kernel.flight.sensors import (
    DELAY_TIME,
    SensorErrors,
    active_sensor_errors,
    add_biases,
    lag_and_scale,
    sense,
)
from abhv_mc_vehicle.kernel.flight.start import face_air, start_flights
from abhv_mc_vehicle.kernel.jit import kernel, lanes
from abhv_mc_vehicle.kernel.jit_pointer import call_address
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.lqr import lqr_tick
from abhv_mc_vehicle.kernel.laws.tlc import tlc_tick
from abhv_mc_vehicle.kernel.laws.user import call_user, user_tick
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import AXES, FIRST_EFFECTOR, IDEAL, KIND
from abhv_mc_vehicle.kernel.plant.actuators import (
    command_ideal,
    pass_commands,
    place_actuator,
    prepare_actuators,
    run_actuators,
    set_actuators,
)
from abhv_mc_vehicle.kernel.plant.aerodynamics import build_up, look_up
from abhv_mc_vehicle.kernel.plant.air_data import (
    air_data,
    choose_member,
    deflections,
    is_warm,
    move_air,
    nominal_density,
)
from abhv_mc_vehicle.kernel.plant.disturbance import (
    Disturbances,
    active_disturbances,
    any_lane,
    calm,
    disturb,
)
from abhv_mc_vehicle.kernel.plant.effectors import (
    begin_effectors,
    count_driven,
    end_effectors,
    finish_effectors,
    leave_effectors,
    place_effectors,
    run_effectors,
    set_effectors,
    start_effectors,
)
from abhv_mc_vehicle.kernel.plant.failures import (
    Failures,
    fail_plant,
    fail_sensors,
    possible_failures,
    start_failures,
    watch_inlet,
)
from abhv_mc_vehicle.kernel.plant.foreign import (
    add_sensed,
    add_thrust,
    find_dispersed,
    finish_states,
    foreign_coefficients,
    foreign_thrust,
    is_misaligned,
    keep_motion,
    load_settings,
    run_dynamics,
    start_states,
    turn_thrust,
)
from abhv_mc_vehicle.kernel.plant.runge_kutta import (
    equations_of_motion,
    finish_step,
    runge_kutta_stage,
)

COMPACTION = 500  # number of ticks after which lanes of ended flights are reassigned


class Active(NamedTuple):
    """Effects that are active in any lane; inactive effects are not computed.

    Callers pass None for flights in calm air without failures, without sensor errors other than
    biases, with a built-in control law, and with a vehicle that is defined by tables and whose
    effectors have no actuators. Code for the effects is then not compiled.
    """

    disturbances: Disturbances
    sensor_errors: SensorErrors
    failures: Failures
    windy: bool  # whether there is wind, a gust or turbulence
    misaligned: bool  # whether the thrust is misaligned
    warm: bool  # whether the air has a non-standard temperature


@lanes
def find_active(Z, width, plan):
    """Determine the active effects from flight parameters, vehicle and mission."""
    disturbances = active_disturbances(Z, width)
    return Active(
        disturbances,
        active_sensor_errors(Z, width),
        possible_failures(Z, width, plan.vehicle.constants),
        disturbances.windy or plan.profile.shape[0] > 0,
        is_misaligned(Z, width),
        is_warm(Z, width, plan.profile),
    )


@lanes
def lean_active(Z, width, plan):
    """Return None; this function replaces :func:`find_active` in lean kernels."""
    return None


@lanes
def instruments(plan, Z, width, active, tick, evaluated):
    """Compute measurements relative to the air, and additional ones for custom control laws.

    ``evaluated`` is true if the forces at the tick's state have already been evaluated.
    """
    sensing = plan.vehicle.constants.sensing
    more = plan.user_code.more > 0 or active.sensor_errors.changed
    dynamic = plan.user_code.dynamics != 0
    against_air = active.windy and sensing.angle_of_attack + sensing.sideslip + sensing.speed > 0
    if active.windy and (against_air or more) and not evaluated:
        move_air(Z, width, plan.profile)
    if against_air:
        measure_air(Z, width, sensing)
    if more:
        measure_more(Z, width, plan.reference, tick, active.warm)
    if dynamic:
        add_sensed(Z, width, s.N_SEEN if more else s.N_MEASURED)


@lanes
def begin_tick(plan, memory, width, active, tick):
    """Compute motion, air data and measurements at a control tick.

    Sensor effects of custom dynamics are taken from the last integrator stage.
    """
    move(plan, memory, width, active, tick)
    measure(plan, memory, width, active, tick, False)


@lanes
def move(plan, memory, width, active, tick):
    """Compute motion and air data at a control tick."""
    Z = memory.Z
    tick_length = plan.timing.step * plan.timing.steps_per_tick
    navigate(Z, width, tick_length, tick == 0)
    calm(Z, width)
    if active is not None:
        span = plan.vehicle.constants.span
        disturb(Z, width, span, active.disturbances, tick * tick_length, tick_length, tick == 0)
        nominal_density(Z, width, plan.profile)


@lanes
def measure(plan, memory, width, active, tick, evaluated):
    """Compute the measurement at a control tick, with sensor errors and sensor failures."""
    Z = memory.Z
    tick_length = plan.timing.step * plan.timing.steps_per_tick
    if active is not None:
        instruments(plan, Z, width, active, tick, evaluated)
        if active.sensor_errors.changed:
            lag_and_scale(Z, width, active.sensor_errors, tick_length, tick)
    add_biases(Z, width)
    if active is not None:
        sense(Z, width, active.sensor_errors, tick_length, tick)
        if active.failures.sensors:
            fail_sensors(Z, width, tick * tick_length)


@lanes
def evaluate(plan, memory, width, stage, active):
    """Evaluate one Runge-Kutta stage at the state ``XS``."""
    Z = memory.Z
    T = memory.T
    vehicle = plan.vehicle
    if active is not None and active.windy:
        move_air(Z, width, plan.profile)
    air_data(Z, width, vehicle, plan.earth, active is not None and active.warm)
    deflections(Z, width)
    if active is None:
        set_effectors(Z, width, vehicle.effector_mix)
    else:
        place_effectors(Z, memory.A, width, vehicle, active.failures.effectors, -1)
    look_up(Z, T, width, vehicle.tables, memory.cells)
    if active is not None and plan.user_code.aerodynamics != 0:
        foreign_coefficients(Z, memory.A, width, vehicle, plan.user_code, active.failures.effectors)
    else:
        build_up(Z, T, width, vehicle.build_up, vehicle.build_up.factor)
    if active is not None and plan.user_code.propulsion != 0:
        foreign_thrust(Z, width, vehicle, plan.user_code)
    if active is not None and plan.user_code.dynamics != 0:
        keep_motion(Z, width)
    equations_of_motion(Z, width, vehicle, plan.earth, stage, active)
    if active is not None and plan.user_code.propulsion != 0:
        add_thrust(Z, width, stage)
    if active is not None and active.misaligned:
        turn_thrust(Z, width, vehicle, plan.user_code.propulsion != 0, stage)
    if active is not None and plan.user_code.dynamics != 0:
        run_dynamics(Z, width, vehicle, plan.user_code, stage)


@lanes
def recorded_tick(plan, memory, width, tick):
    """Set surfaces and engine to recorded values, and the command rows to recorded rates."""
    Z = memory.Z
    gains = plan.gains
    for lane in range(width):
        for i in range(3):
            place_actuator(Z, lane, s.AILERON + i, gains[tick, i])
            Z[s.CMD + i, lane] = gains[tick, 4 + i]
        place_actuator(Z, lane, s.ETA, gains[tick, 3])
        Z[s.CMD_ETA, lane] = gains[tick, 7]


@lanes
def control(plan, memory, width, law, active, tick):
    """Compute the commands of the plan's control law.

    A custom filter of the measurement, if there is one, is called first.
    """
    if active is not None and law != PYTHON and plan.user_code.address != 0:
        call_user(plan, memory, tick)
    if law == TLC:
        tlc_tick(plan, memory, width, active, tick)
    elif law == LQR or active is None:
        lqr_tick(plan, memory, width, tick)
    elif law == PYTHON:
        user_tick(plan, memory, width, tick)
    else:
        recorded_tick(plan, memory, width, tick)


@lanes
def observe_tick(plan, memory, results, width, active, flights, n, tick):
    """Check limits and update metrics of ``flights`` in the first ``n`` lanes at a tick."""
    Z = memory.Z
    O = memory.O
    reference = plan.reference
    dt = plan.timing.step * plan.timing.steps_per_tick
    inlet = plan.vehicle.constants.inlet
    if active is not None and inlet.unstarts > 0.0:
        watch_inlet(Z, width, inlet, tick * plan.timing.step * plan.timing.steps_per_tick)
    derive(Z, width, reference, plan.vehicle, tick)
    follow_ripples(Z, width, reference[tick, ref.SETTLED], tick, dt)
    if active is not None and plan.user_code.channels != 0:
        call_address(plan.user_code.channels, 0, Z, reference, plan.gains, plan.settings, tick, dt)
    ended = check_limits(Z, O, width, plan.observed, plan.vehicle.foreign.states, tick)
    if ended > 0.0 or tick == plan.timing.ticks:
        finish_flights(Z, O, width, tick == plan.timing.ticks, dt)
    count_tick(memory, width, plan, results.samples, flights, n, tick, observe.FIRST_METRIC)


@lanes
def record_tick(plan, memory, results, flights, n, tick):
    """Record a sample of ``flights`` in the first ``n`` lanes if it is due at the tick."""
    if plan.record_every > 0 and tick % plan.record_every == 0:
        sample = tick // plan.record_every
        record(memory.Z, plan.observed, results.history, flights, n, sample)
        if results.states.shape[1] > 0:
            record_states(memory.Z, results.states, flights, n, sample)


@lanes
def bin_tick(plan, memory, results, width, tick, first, last):
    """Update the channels' extremes at a control tick, if extremes are requested.

    ``first`` and ``last`` are true at the group's first and last tick.
    """
    every = plan.record_every
    if results.low.shape[0] > 0:
        follow_extremes(memory.Z, memory.E, plan.observed, width, first or tick % every == 0)
        if last or (tick + 1) % every == 0:
            keep_extremes(
                memory.E,
                plan.observed,
                results.low[tick // every],
                results.high[tick // every],
                width,
            )


@lanes
def begin_control(plan, memory, width, law, active, tick, evaluated):
    """Compute measurement, commands and failures at a control tick."""
    Z = memory.Z
    A = memory.A
    tick_length = plan.timing.step * plan.timing.steps_per_tick
    measure(plan, memory, width, active, tick, evaluated)
    control(plan, memory, width, law, active, tick)
    pass_commands(Z, width)
    if active is not None:
        fail_plant(Z, A, width, active.failures, plan.vehicle, tick * tick_length, tick_length)
    if law != RECORDED:
        command_ideal(Z, Z, width, plan.vehicle.actuators, 0, FIRST_EFFECTOR)
    if active is not None:
        begin_effectors(Z, A, width, plan.vehicle)


@lanes
def senses_forces(plan):
    """Return whether the measurement depends on the forces at the tick's state.

    This is the case if the vehicle has custom dynamics or the control law reads the specific force.
    """
    return plan.user_code.dynamics != 0 or plan.user_code.more > 1


@lanes
def keeps_forces(plan, law, active):
    """Return whether the forces at a tick's state are independent of the tick's commands.

    The forces depend on the commands if any actuator is ideal or a failure is possible. The result
    is also False if a nominal vehicle is evaluated, because this overwrites rows of the forces.
    """
    failures = active.failures
    ideal = False
    for i in range(FIRST_EFFECTOR + count_driven(plan.vehicle)):
        ideal |= plan.vehicle.actuators[i, KIND] == IDEAL
    nominal = law in (TLC, RECORDED) or plan.user_code.onboard > 0
    fails = failures.surfaces or failures.effectors or failures.engine or failures.engines
    return not (ideal or nominal or fails)


@lanes
def fly_ticks(plan, memory, results, width, law, active, first_tick, end, flights, n):
    """Simulate a group of flights from ``first_tick`` to the tick before ``end``."""
    Z = memory.Z
    O = memory.O
    A = memory.A
    step = plan.timing.step
    steps_per_tick = plan.timing.steps_per_tick
    first = 0
    once = False
    if active is not None and senses_forces(plan):
        # Forces are evaluated before the measurement; the first stage reuses them if possible.
        first = -1
        once = keeps_forces(plan, law, active)
    for tick in range(first_tick, end):
        move(plan, memory, width, active, tick)
        flying = True
        for evaluation in range(
            first, 4 * steps_per_tick
        ):  # A single loop covers all stages, so that their code is generated only once.
            stage = evaluation % 4 if evaluation >= 0 else -1
            if evaluation == 0:
                begin_control(plan, memory, width, law, active, tick, first < 0)
            if evaluation != 0 or not once:
                formula = runge_kutta_stage(0 if once and stage < 0 else stage, step)
                evaluate(plan, memory, width, formula, active)
            if evaluation == 0:
                observe_tick(plan, memory, results, width, active, flights, n, tick)
                record_tick(plan, memory, results, flights, n, tick)
                flying = tick < plan.timing.ticks and any_lane(O, width, observe.ALIVE, 1, 0.0)
                bin_tick(
                    plan,
                    memory,
                    results,
                    width,
                    tick,
                    tick == first_tick,
                    not flying or tick + 1 == end,
                )
                if not flying:
                    break
            if stage == 0:
                actuators = plan.vehicle.actuators
                recorded = law == RECORDED
                run_actuators(Z, Z, width, actuators, 0, FIRST_EFFECTOR, step, recorded, active)
                if active is not None:
                    run_effectors(Z, A, width, plan.vehicle, step, active)
            elif stage == 2:
                set_actuators(Z, width)
                if active is not None:
                    end_effectors(A, width, plan.vehicle)
            elif stage == 3:
                finish_step(Z, width, step, O[observe.ALIVE])
                if active is not None:
                    finish_states(Z, width, plan.vehicle.foreign.states, step, O[observe.ALIVE])
                    finish_effectors(Z, A, width, plan.vehicle, O[observe.ALIVE])
        if not flying:
            break


@lanes
def fly_groups(plan, memory, results, width, law, find, first_flight, last_flight):
    """Simulate flights from ``first_flight`` to the one before ``last_flight`` in groups.

    Flights start at the start of the mission or from lane memory that is saved in the plan. If the
    results save the lane memory, flights stop before the measurement of the last tick, from where
    other flights continue. Groups are simulated in turn for ``COMPACTION`` ticks; the flights that
    have not ended are then distributed to new groups.
    """
    saved = memory.saved
    order = memory.order
    keeps = results.saved.shape[1] > 0
    O = memory.O
    dt = plan.timing.step * plan.timing.steps_per_tick
    delayed = False
    for flight in range(first_flight, last_flight):
        delayed |= plan.parameters[flight, DELAY_TIME - s.P] > 0.0
    start = plan.first_tick
    last = plan.timing.ticks if keeps else plan.timing.ticks + 1
    compacted = (
        1 < width < last_flight - first_flight
    )  # With a single lane or a single group, there are no lanes to reassign.
    for first in range(first_flight, last_flight, saved.shape[0]):
        flying = min(saved.shape[0], last_flight - first)
        for i in range(flying):
            order[i] = first + i
        for first_tick in range(
            start, max(last, start + 1), COMPACTION if compacted else max(last, 1)
        ):
            end = min(first_tick + COMPACTION, last) if compacted else last
            still_flying = 0
            for group in range(0, flying, width):
                n = min(width, flying - group)
                flights = order[group : group + n]
                if first_tick > start:
                    copy_lanes(memory, plan, saved, first, flights, n, delayed, False)
                elif plan.start.shape[0] > 0:
                    copy_lanes(memory, plan, plan.start, 0, flights, n, delayed, False)
                else:
                    start_lanes(plan, memory, width, find, flights, n)
                active = find(memory.Z, width, plan)
                fly_ticks(plan, memory, results, width, law, active, first_tick, end, flights, n)
                if end < last:
                    copy_lanes(memory, plan, saved, first, flights, n, delayed, True)
                if keeps:
                    copy_lanes(memory, plan, results.saved, 0, flights, n, delayed, True)
                for lane in range(n):
                    flight = flights[lane]
                    if O[observe.ALIVE, lane] > 0.0 and end < last:
                        order[still_flying] = flight
                        still_flying += 1
                    else:
                        metrics = results.metrics[flight]
                        samples = O[observe.SAMPLES, lane]
                        finish_counting(
                            O, lane, plan.counted, samples, dt, observe.FIRST_METRIC, metrics
                        )
                        results.outcome[flight] = int(O[observe.OUTCOME, lane])
                        results.end_tick[flight] = int(O[observe.END, lane])
            flying = still_flying


@lanes
def start_lanes(plan, memory, width, find, flights, n):
    """Initialize every lane for its flight; spare lanes repeat the last flight."""
    Z = memory.Z
    for i in range(Z_ROWS):
        for lane in range(width):
            Z[i, lane] = 0.0
    for lane in range(width):
        flight = flights[min(lane, n - 1)]
        for i in range(s.N_PARAMETERS):
            Z[s.P + i, lane] = plan.parameters[flight, i]
    load_settings(Z, width, plan.parameters, flights, n)
    start_flights(Z, width, plan.initial_state)
    start_failures(Z, width)
    actuators = plan.vehicle.actuators
    step = plan.timing.step
    # The three axes have identical actuators.
    prepare_actuators(Z, Z, width, actuators, AXES - 1, FIRST_EFFECTOR, step)
    leave_effectors(Z, width, plan.vehicle)
    start_active(plan, memory, width, find(Z, width, plan))
    start_observing(Z, memory.O, width, plan.counted)
    end_spare_lanes(memory, width, n)


@lanes
def start_active(plan, memory, width, active):
    """Initialize the active effects, and the effectors with actuators."""
    Z = memory.Z
    if active is not None:
        choose_member(Z, width, plan.profile)
        if active.windy and plan.vehicle.constants.sensing.sideslip > 0:
            move_air(Z, width, plan.profile)
            face_air(Z, width)
        if plan.user_code.aerodynamics != 0:
            find_dispersed(Z, width)
        foreign = plan.vehicle.foreign
        start_states(Z, width, foreign.states, foreign.settings.size, plan.initial_state)
        start_effectors(Z, memory.A, width, plan.vehicle, plan.timing.step)


def make_fly_lanes(capacity: int, lean: bool = False) -> Callable[..., None]:
    """Return the simulation kernel for ``capacity`` lanes, compiled at the first call.

    The kernel's machine code is cached. A ``lean`` kernel takes half the time to compile, and
    simulates flights without the effects in :class:`Active`, with bit-identical results. LLVM
    treats the number of lanes as a constant. Numba does not, because it would optimize functions
    for each constant separately and unroll small loops into scalar code.
    """

    def fly_lanes(plan, memory, results):
        """Simulate one flight for each row of the plan's parameters, in ``capacity`` lanes."""
        # The caller has checked the width; this condition makes it a constant for LLVM.
        if has_width(memory, capacity):
            width = memory.Z.shape[1]
            flights = plan.parameters.shape[0]
            fly_groups(
                plan,
                memory,
                results,
                width,
                plan.law,
                lean_active if lean else find_active,
                0,
                flights,
            )

    return named_kernel(fly_lanes, lean)


def named_kernel(function: Callable[..., Any], lean: bool) -> Callable[..., Any]:
    """Return a kernel whose name in the cache distinguishes lean from full kernels."""
    function.__name__ += "_lean" if lean else ""
    function.__qualname__ += "_lean" if lean else ""
    return kernel(function)
