"""Evaluation of the compiled plant and control laws at single points, in parallel lanes."""

from collections.abc import Callable
from typing import Any, NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.flight.fly_lanes import (
    Active,
    begin_tick,
    control,
    evaluate,
    find_active,
    instruments,
    lean_active,
    named_kernel,
)
from abhv_mc_vehicle.kernel.flight.interface import LANES, has_width
from abhv_mc_vehicle.kernel.flight.navigation import navigate
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuators import N_EFFECTOR_ROWS, STAGE, pass_commands
from abhv_mc_vehicle.kernel.plant.air_data import nominal_density
from abhv_mc_vehicle.kernel.plant.disturbance import calm, density_profile
from abhv_mc_vehicle.kernel.plant.failures import Failures, fail_plant, fail_sensors
from abhv_mc_vehicle.kernel.plant.runge_kutta import Stage
from abhv_mc_vehicle.kernel.plant.state import SUM, XS, X
from abhv_mc_vehicle.kernel.plant.vehicle import NEVER


class PlantAnswer(NamedTuple):
    """Rates and measurements of the plant at given states."""

    rates: Floats  # [point, 14] rates of the states that precede the actuator states
    custom_rates: Floats  # [point, state] rates of custom dynamics
    variables: Floats  # [point, variable] variables of the tables
    # [point, measured] measurements without bias, noise and delay, but with sensor failures
    measured: Floats


@lanes
def _load(Z, row, width, values, numbers, start, n):
    """Load ``values[numbers[start + lane]]`` into the rows of each lane, starting at ``row``.

    Spare lanes repeat the last point.
    """
    for lane in range(width):
        source = numbers[start + min(lane, n - 1)]
        for i in range(values.shape[1]):
            Z[row + i, lane] = values[source, i]


@lanes
def _store(Z, row, values, start, n):
    """Copy rows starting at ``row`` to ``values`` [point, column], from point ``start``."""
    for lane in range(n):
        for i in range(values.shape[1]):
            values[start + lane, i] = Z[row + i, lane]


@lanes
def _fail(plan, memory, width, active, tick):
    """Apply failures to the plant; their code is not compiled if ``active`` is None."""
    if active is not None:
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        fail_plant(
            memory.Z,
            memory.A,
            width,
            active.failures,
            plan.vehicle,
            tick * tick_length,
            tick_length,
        )


@lanes
def _begin_all(plan, memory, before, moving, numbers, find, tick, sensed, acting):
    Z = memory.Z
    width = memory.Z.shape[1]
    for start in range(0, before.shape[0], width):
        n = min(width, before.shape[0] - start)
        _load(Z, 0, width, before, numbers, start, n)
        _load(memory.A, 0, width, moving, numbers, start, n)
        active = find(Z, width, plan)
        begin_tick(plan, memory, width, active, tick)
        _store(Z, 0, sensed, start, n)
        pass_commands(Z, width)
        _fail(plan, memory, width, active, tick)
        _store(Z, 0, acting, start, n)


def make_probe_begin(lean: bool) -> Callable[..., Any]:
    """Return the kernel for a tick's start; ``lean`` is as in ``fly_lanes.make_fly_lanes``."""

    def probe_begin(plan, memory, before, moving, numbers, tick, sensed, acting):
        """Start a tick from memory ``before`` [point, row] and effector memory ``moving``.

        The function fills ``sensed`` [point, row] with the memory after the measurement, and
        ``acting`` [point, row] with the memory after failures of the plant.
        """
        if has_width(memory, LANES):
            find = lean_active if lean else find_active
            _begin_all(plan, memory, before, moving, numbers, find, tick, sensed, acting)

    return named_kernel(probe_begin, lean)


@lanes
def _answer(plan, memory, width, active, centred, tick, answer, start, n):
    """Fill ``answer`` for the states in the lanes."""
    Z = memory.Z
    tick_length = plan.timing.step * plan.timing.steps_per_tick
    for lane in range(width):
        for i in range(s.AILERON):
            Z[SUM + i, lane] = 0.0
    if active is None:
        calm(Z, width)
        evaluate(plan, memory, width, Stage(1.0, 0.0), None)
        navigate(Z, width, tick_length, tick == 0)
    else:
        density_profile(Z, width)
        nominal_density(Z, width, plan.profile)
        if centred:
            for e in range(plan.vehicle.effector_mix.shape[0]):
                for lane in range(width):
                    Z[s.SLOW_EFFECTOR + e, lane] = NEVER
            pass_commands(Z, width)
            fail_plant(
                Z, memory.A, width, active.failures, plan.vehicle, tick * tick_length, tick_length
            )
        possible = active.failures
        failures = Failures(
            possible.surfaces, True, possible.engine, possible.engines, possible.sensors
        )
        forced = Active(
            active.disturbances,
            active.sensor_errors,
            failures,
            True,
            active.misaligned,
            active.warm,
        )
        evaluate(plan, memory, width, Stage(1.0, 0.0), forced)
        navigate(Z, width, tick_length, tick == 0)
        instruments(plan, Z, width, active, 1, True)
        if active.failures.sensors:
            fail_sensors(Z, width, tick * tick_length)
    _store(Z, SUM, answer.rates, start, n)
    _store(Z, s.CUSTOM_RATE, answer.custom_rates, start, n)
    _store(Z, s.VAR, answer.variables, start, n)
    _store(Z, s.MEASURED, answer.measured, start, n)


@lanes
def _answer_all(
    plan, memory, centred, acting, flight, states, custom, positions, numbers, find, tick, answer
):
    Z = memory.Z
    width = memory.Z.shape[1]
    for start in range(0, states.shape[0], width):
        n = min(width, states.shape[0] - start)
        _load(Z, 0, width, acting, flight, start, n)
        _load(Z, X, width, states, numbers, start, n)
        _load(Z, XS, width, states, numbers, start, n)
        _load(Z, s.CUSTOM_STATE, width, custom, numbers, start, n)
        _load(Z, s.CUSTOM_STAGE, width, custom, numbers, start, n)
        for lane in range(width):
            for e in range(positions.shape[1]):
                memory.A[e * N_EFFECTOR_ROWS + STAGE, lane] = positions[
                    numbers[start + min(lane, n - 1)], e
                ]
        _answer(plan, memory, width, find(Z, width, plan), centred, tick, answer, start, n)


def make_probe_plant(lean: bool) -> Callable[..., Any]:
    """Return the kernel for the plant at given states; ``lean`` is as in ``make_fly_lanes``."""

    def probe_plant(
        plan, memory, centred, acting, flight, states, custom, positions, numbers, tick, answer
    ):
        """Fill ``answer`` for ``states`` [point, state] and memory ``acting`` [flight, row].

        ``custom`` [point, state] contains custom states, and ``positions`` [point, effector] the
        positions of effectors with actuators. ``flight`` [point] and ``numbers`` [point] are the
        rows of each point in ``acting`` and in ``states``. Slow effectors keep their deflections;
        if ``centred`` is true, their deflections follow the mix of the state.
        """
        if has_width(memory, LANES):
            find = lean_active if lean else find_active
            _answer_all(
                plan,
                memory,
                centred,
                acting,
                flight,
                states,
                custom,
                positions,
                numbers,
                find,
                tick,
                answer,
            )

    return named_kernel(probe_plant, lean)


@lanes
def _law_all(plan, memory, active, tick, rows, numbers, before, after, seen):
    Z = memory.Z
    width = memory.Z.shape[1]
    for start in range(0, before.shape[0], width):
        n = min(width, before.shape[0] - start)
        for lane in range(width):
            source = numbers[start + min(lane, n - 1)]
            for i in range(rows.size):
                Z[rows[i], lane] = before[source, i]
            Z[s.P, lane] = 1.0  # factor on the nominal vehicle's terms
        control(plan, memory, width, plan.law, active, tick)
        for lane in range(n):
            for i in range(rows.size):
                after[start + lane, i] = Z[rows[i], lane]
            for i in range(s.N_VARIABLES):
                seen[start + lane, i] = Z[s.VAR + i, lane]
            for i in range(3):
                seen[start + lane, s.N_VARIABLES + i] = Z[s.COMMANDS + i, lane]
            for i in range(4):
                seen[start + lane, s.N_VARIABLES + 3 + i] = Z[s.CMD + i, lane]
            for e in range(seen.shape[1] - s.N_VARIABLES - 7):
                seen[start + lane, s.N_VARIABLES + 7 + e] = Z[s.EFFECTOR_COMMAND + e, lane]


def make_probe_law(lean: bool) -> Callable[..., Any]:
    """Return the kernel for a control law's tick; ``lean`` is as in ``make_fly_lanes``."""

    def probe_law(plan, memory, tick, rows, numbers, before, after, seen):
        """Compute a control tick, from memory rows ``before`` to ``after``, both [point, row]."""
        if has_width(memory, LANES):
            _law_all(
                plan,
                memory,
                None if lean else plan.user_code,
                tick,
                rows,
                numbers,
                before,
                after,
                seen,
            )

    return named_kernel(probe_law, lean)
