"""The compiled plant and laws asked at single points, many abreast: rates of a state, one tick of a law's own code."""

from typing import NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc.kernel.flight.fly_lanes import Active, begin_tick, control, evaluate, find_active, instruments
from abhv_mc.kernel.flight.interface import LANES
from abhv_mc.kernel.flight.memory import has_width
from abhv_mc.kernel.flight.navigation import navigate
from abhv_mc.kernel.jit import kernel, lanes
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.actuators import pass_commands
from abhv_mc.kernel.plant.air_profile import nominal_density
from abhv_mc.kernel.plant.disturbance import density_profile
from abhv_mc.kernel.plant.equations import Stage
from abhv_mc.kernel.plant.failures import Failures, fail_plant, fail_sensors
from abhv_mc.kernel.plant.parameter_names import NEVER
from abhv_mc.kernel.plant.state import SUM, XS, X


class PlantAnswer(NamedTuple):
    """What the plant makes of states, and the sensors."""

    rates: Floats  # [point, 14] of the states before the actuators'
    variables: Floats  # [point, variable] of the tables
    measured: Floats  # [point, measured] without bias, noise and delay; a frozen measurement as it is


@lanes
def _load(Z, row, width, values, numbers, start, n):
    """Columns of ``values[numbers[start + lane]]`` into the rows from ``row``; spare lanes repeat the last."""
    for lane in range(width):
        source = numbers[start + min(lane, n - 1)]
        for i in range(values.shape[1]):
            Z[row + i, lane] = values[source, i]


@kernel
def probe_begin(plan, memory, before, numbers, tick, sensed, acting):
    """The tick's beginning, from the lane memory ``before`` [point, row] it.

    ``sensed`` [point, row] is the memory with the tick's measurement, ``acting`` with what has failed in the plant.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        for start in range(0, before.shape[0], width):
            n = min(width, before.shape[0] - start)
            _load(Z, 0, width, before, numbers, start, n)
            active = find_active(Z, width, plan)
            begin_tick(plan, memory, width, active, tick)
            for lane in range(n):
                for i in range(before.shape[1]):
                    sensed[start + lane, i] = Z[i, lane]
            pass_commands(Z, width)
            fail_plant(Z, memory.A, width, active.failures, plan.vehicle, tick * tick_length, tick_length)
            for lane in range(n):
                for i in range(before.shape[1]):
                    acting[start + lane, i] = Z[i, lane]


@kernel
def probe_plant(plan, memory, held, acting, flight, states, numbers, tick, answer):
    """Fill ``answer`` for ``states`` [point, state] of flights with the lane memory ``acting`` [flight, row].

    ``flight`` [point] says whose; ``numbers`` [point] counts the points. Slow effectors stay where they are or, with
    ``held``, are where the state's mix puts them at the beginning of a tick.
    """
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        rates, variables, measured = answer.rates, answer.variables, answer.measured
        tick_length = plan.timing.step * plan.timing.steps_per_tick
        for start in range(0, states.shape[0], width):
            n = min(width, states.shape[0] - start)
            _load(Z, 0, width, acting, flight, start, n)
            _load(Z, X, width, states, numbers, start, n)
            _load(Z, XS, width, states, numbers, start, n)
            active = find_active(Z, width, plan)
            for lane in range(width):
                for i in range(s.AILERON):
                    Z[SUM + i, lane] = 0.0
            density_profile(Z, width)
            nominal_density(Z, width, plan.profile)
            if held:
                for e in range(plan.vehicle.effectors.shape[0]):
                    for lane in range(width):
                        Z[s.SLOW_EFFECTOR + e, lane] = NEVER
                pass_commands(Z, width)
                fail_plant(Z, memory.A, width, active.failures, plan.vehicle, tick * tick_length, tick_length)
            found = active.failures
            failures = Failures(found.surfaces, True, found.engine, found.engines, found.sensors)
            moving = Active(active.disturbances, active.sensor_errors, failures, True)
            evaluate(plan, memory, width, Stage(1.0, 0.0), moving)
            navigate(Z, width, tick_length, tick == 0)
            instruments(plan, Z, width, active, 1)
            if active.failures.sensors:
                fail_sensors(Z, width, tick * tick_length)
            for lane in range(n):
                for i in range(rates.shape[1]):
                    rates[start + lane, i] = Z[SUM + i, lane]
                for i in range(variables.shape[1]):
                    variables[start + lane, i] = Z[s.VAR + i, lane]
                for i in range(measured.shape[1]):
                    measured[start + lane, i] = Z[s.MEASURED + i, lane]


@kernel
def probe_law(plan, memory, tick, rows, numbers, before, after, seen):
    """A tick of the plan's law from the memory rows ``before`` [point, row] to ``after``; the measurement is there."""
    if has_width(memory, LANES):
        Z, width = memory.Z, memory.Z.shape[1]
        for start in range(0, before.shape[0], width):
            n = min(width, before.shape[0] - start)
            for lane in range(width):
                source = numbers[start + min(lane, n - 1)]
                for i in range(rows.size):
                    Z[rows[i], lane] = before[source, i]
                Z[s.P, lane] = 1.0  # the factor of the nominal vehicle's terms
            control(plan, memory, width, plan.law, plan.user_code, tick)
            for lane in range(n):
                for i in range(rows.size):
                    after[start + lane, i] = Z[rows[i], lane]
                for i in range(s.N_VARIABLES):
                    seen[start + lane, i] = Z[s.VAR + i, lane]
                for i in range(3):
                    seen[start + lane, s.N_VARIABLES + i] = Z[s.COMMANDS + i, lane]
                for i in range(4):
                    seen[start + lane, s.N_VARIABLES + 3 + i] = Z[s.CMD + i, lane]
