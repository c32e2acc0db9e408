"""Surfaces in flight against a brute-force integration of the same hybrid model in steps of 5 us; the engine's fuel."""

import dataclasses

import numpy as np
import pytest
from short_flights import short_plan

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.one_flight.given import make_flight_plan

TICKS = 40
FINE = 2000  # steps of a tick


@pytest.fixture(scope="module")
def plan():
    """The first 0.4 s of the S manoeuvre, whose step of bank drives aileron and rudder to rate limit and stop."""
    return short_plan(TICKS)


@pytest.fixture(scope="module")
def parameters():
    generator = np.random.default_rng(4)
    rows = nominal_parameters(16)
    for name in ("bandwidth", "damping", "deflection_limit", "rate_limit"):
        rows[:, PARAMETER_INDEX[f"actuator.{name}"]] *= generator.uniform(0.7, 1.3, 16)
    return rows


def integrate(plan, parameters, block, dt):
    """Positions and rates ``[flight, tick, surface]`` one tick after each recorded state, limits step by step."""
    constants = plan.vehicle.constants

    def factor(name):
        return parameters[:, PARAMETER_INDEX[f"actuator.{name}"], np.newaxis, np.newaxis]

    bandwidth = constants.surface_bandwidth * factor("bandwidth")
    friction = 2.0 * constants.surface_damping * factor("damping") * bandwidth
    fastest = constants.surface_rate_limit * factor("rate_limit")
    limit = constants.surface_limit * factor("deflection_limit")
    names = ("aileron", "rudder", "elevator")
    columns = [CHANNEL_INDEX[f"{name}_command_deg"] for name in names]
    command = np.radians(block.history[:, :-1, columns].astype(np.float64))
    position = block.states[:, :-1, s.AILERON : s.ELEVATOR + 1].copy()
    rate = block.states[:, :-1, s.AILERON_RATE : s.ELEVATOR_RATE + 1].copy()
    for _ in range(FINE):
        rate = np.clip(rate + dt * (bandwidth**2 * (command - position) - friction * rate), -fastest, fastest)
        moved = position + dt * rate
        position = np.clip(moved, -limit, limit)
        rate = np.where(moved == position, rate, 0.0)
    return position, rate, fastest, limit


def test_rate_limits_and_stops_are_followed(plan, parameters):
    block = fly(plan, parameters, record_every=1, keep_states=True)
    position, rate, fastest, limit = integrate(plan, parameters, block, plan.timing.tick / FINE)
    flown = block.states[:, 1:, s.AILERON : s.ELEVATOR + 1]
    flown_rate = block.states[:, 1:, s.AILERON_RATE : s.ELEVATOR_RATE + 1]
    assert (np.abs(flown_rate) == fastest).sum() > 30  # at the rate limit,
    assert (np.abs(flown) == limit).sum() > 10  # and at a stop
    assert (np.abs(flown) <= limit).all()
    assert (np.abs(flown_rate) <= fastest).all()
    # commands are recorded in single precision, and Euler's steps of 5 us err by 2e-5 rad
    assert flown == pytest.approx(position, abs=1e-4)
    assert flown_rate == pytest.approx(rate, abs=0.02)


def test_half_a_step_changes_next_to_nothing_where_limits_are_met(plan, parameters):
    fine = dataclasses.replace(plan, timing=plan.timing._replace(step=0.5 * plan.timing.step, steps_per_tick=2))
    states, finer = (fly(p, parameters, record_every=1, keep_states=True).states for p in (plan, fine))
    surfaces, rates = slice(s.AILERON, s.ELEVATOR + 1), slice(s.ROLL_RATE, s.YAW_RATE + 1)
    assert np.degrees(np.abs(states - finer)[:, :, surfaces]).max() < 5e-3
    assert np.degrees(np.abs(states - finer)[:, :, rates]).max() < 2e-2


def test_without_limits_a_flight_with_moving_surfaces_is_of_order_four(plan):
    # A tick of 0.1 s and a slow actuator, so that errors stand out of the rounding; within one cell of the tables.
    constants = plan.vehicle.constants._replace(surface_limit=10.0, surface_rate_limit=1e6, surface_bandwidth=20.0)
    soft = dataclasses.replace(plan, vehicle=plan.vehicle._replace(constants=constants))

    def flown(steps):
        timing = plan.timing._replace(step=0.01 / steps, steps_per_tick=steps, ticks=15)
        block = fly(dataclasses.replace(soft, timing=timing), nominal_parameters(), record_every=1, keep_states=True)
        return block.states[0]

    exact = flown(16)
    errors = np.array([np.abs(flown(steps) - exact)[:, s.ROLL_RATE].max() for steps in (1, 2, 4)])
    assert (errors[:-1] / errors[1:] > 12.0).all()


def test_without_an_empty_mass_the_engine_runs_and_the_mass_stays():
    """It flew with its engine off, and nothing said so."""
    plan = make_flight_plan("level", {"base": "ghame_x", "mass.empty": None})
    block = fly(plan, nominal_parameters(), 100)
    assert block.outcome[0] == Outcome.OK
    assert np.ptp(block.history[0, :, CHANNEL_INDEX["mass_kg"]]) == 0.0
    assert block.metrics[0, METRIC_INDEX["fuel_used_kg"]] == 0.0
    assert block.metrics[0, METRIC_INDEX["speed_error_max_mps"]] < 1.0  # with its engine off it loses 20 m/s a second
    assert block.metrics[0, METRIC_INDEX["equivalence_ratio_min"]] > 0.9
    assert any("burns no fuel" in warning for warning in plan.warnings)


@pytest.mark.parametrize(("parameter", "ratio"), [("propulsion.thrust", 1.0), ("propulsion.specific_impulse", 1.05)])
def test_thrust_is_dispersed_at_the_same_fuel_flow(parameter, ratio):
    """In the first control period the engine has not yet answered: both flights burn at the same equivalence ratio."""
    plan = make_flight_plan("level", "ghame_x")
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX[parameter]] = 1.05
    states = fly(plan, parameters, 1, keep_states=True).states
    nominal, dispersed = states[:, 0, s.MASS] - states[:, 1, s.MASS]
    assert nominal > 0.01  # kg in 10 ms
    assert nominal / dispersed == pytest.approx(ratio, rel=1e-5)
