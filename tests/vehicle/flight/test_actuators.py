"""Tests of surfaces and effectors against a brute-force integration of the same model.

Its steps are 5 us long.
"""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from short_flights import rows_of, short_plan, write_law

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import BANDWIDTH as BAND
from abhv_mc_vehicle.kernel.plant.actuator_step import COLUMNS, RATE_LIMIT
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH as HIGH_LIMIT
from abhv_mc_vehicle.kernel.plant.actuator_step import LOW as LOW_LIMIT
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.vehicle_simulator.make_plans import describe_end

DT, FINE = 5e-6, 2000  # s, and steps of a tick
SURFACES, RATES = slice(s.AILERON, s.ELEVATOR + 1), slice(s.AILERON_RATE, s.ELEVATOR_RATE + 1)


def move(position, rate, command, bandwidth, damping, fastest, low, high):
    """Return position and rate one tick later, with the limits applied at each step."""
    for _ in range(FINE):
        pull = bandwidth**2 * (command - position) - 2.0 * damping * bandwidth * rate
        rate = np.clip(rate + DT * pull, -fastest, fastest)
        moved = position + DT * rate
        position = np.clip(moved, low, high)
        rate = np.where(moved == position, rate, 0.0)
    return position, rate


@pytest.fixture(scope="module")
def plan():
    """Return the first 0.4 s of the S manoeuvre.

    Its step of bank drives aileron and rudder to their rate limits and stops.
    """
    return short_plan(40)


def test_rate_limits_and_stops_are_followed(plan):
    generator, rows = np.random.default_rng(4), nominal_parameters(16)
    surfaces, dispersed = dict(zip(COLUMNS, plan.vehicle.actuators[0], strict=True)), {}
    for name in ("bandwidth", "damping", "deflection_limit", "rate_limit"):
        rows[:, PARAMETER_INDEX[f"actuator.{name}"]] *= generator.uniform(0.7, 1.3, 16)
        nominal = surfaces["high" if name == "deflection_limit" else name]
        dispersed[name] = nominal * rows[:, PARAMETER_INDEX[f"actuator.{name}"], None, None]
    block = fly(plan, rows, record_every=1, keep_states=True)
    position, rate = block.states[:, :, SURFACES], block.states[:, :, RATES]
    columns = [CHANNEL_INDEX[f"{name}_command_deg"] for name in ("aileron", "rudder", "elevator")]
    command = np.radians(block.history[:, :-1, columns].astype(np.float64))
    limit, fastest = dispersed["deflection_limit"], dispersed["rate_limit"]
    lags = dispersed["bandwidth"], dispersed["damping"]
    expected = move(position[:, :-1], rate[:, :-1], command, *lags, fastest, -limit, limit)
    assert (np.abs(rate[:, 1:]) == fastest).sum() > 30  # at the rate limit,
    assert (np.abs(position[:, 1:]) == limit).sum() > 10  # and at a stop
    assert (np.abs(position[:, 1:]) <= limit).all() and (np.abs(rate[:, 1:]) <= fastest).all()
    # Commands are recorded in single precision; the error of the Euler steps of 5 us is 2e-5 rad.
    assert position[:, 1:] == pytest.approx(expected[0], abs=1e-4)
    assert rate[:, 1:] == pytest.approx(expected[1], abs=0.02)


def test_without_limits_a_flight_with_moving_surfaces_is_of_order_four(plan):
    # With a tick of 0.1 s and a slow actuator the errors exceed rounding. The flight stays within
    # one cell of the tables.
    constants = plan.vehicle.constants._replace(surface_limit=10.0)
    actuators = plan.vehicle.actuators.copy()
    actuators[:3, [LOW_LIMIT, HIGH_LIMIT, RATE_LIMIT, BAND]] = -10.0, 10.0, 1e6, 20.0
    soft = dataclasses.replace(
        plan, vehicle=plan.vehicle._replace(constants=constants, actuators=actuators)
    )

    def simulate(steps):
        timing = plan.timing._replace(step=0.01 / steps, steps_per_tick=steps, ticks=15)
        block = fly(
            dataclasses.replace(soft, timing=timing),
            nominal_parameters(),
            record_every=1,
            keep_states=True,
        )
        return block.states[0]

    exact = simulate(16)
    errors = np.array(
        [np.abs(simulate(steps) - exact)[:, s.ROLL_RATE].max() for steps in (1, 2, 4)]
    )
    assert (errors[:-1] / errors[1:] > 12.0).all()


COUNT, IDEAL = 16, 3
NUMBER = np.arange(COUNT)
MIX = np.column_stack([0.1 * NUMBER, np.full(COUNT, 0.5), np.ones(COUNT)])
LOW, HIGH, FASTEST = -5.0 - NUMBER, 6.0 + NUMBER, 40.0 + 20.0 * NUMBER  # deg, deg/s
BANDWIDTH, DAMPING = 20.0 + 4.0 * NUMBER, 0.5 + 0.03 * NUMBER
LAW = """
from typing import NamedTuple
from abhv_mc.extend import Command, controller

@controller{how}
def law(time, reference):
    step = 0.0 if time < 0.05 else 0.2 if time < 0.3 else -0.3
    return Command(
        0.01, 0.02, reference.elevator, equivalence_ratio=reference.equivalence_ratio,
        effectors={{{given}}},
    )
"""
HALF = ", ".join(f'"flap_{i}": step' for i in range(0, COUNT, 2))


def make_plan(folder, commands=HALF, how=""):
    """Return the plan of a law that commands half of sixteen effectors directly."""
    effectors = {}
    for i, (low, high, fastest, bandwidth) in enumerate(
        np.column_stack([LOW, HIGH, FASTEST, BANDWIDTH]).tolist()
    ):
        lags = {
            "rate": f"{fastest} deg/s",
            "bandwidth": f"{bandwidth} rad/s",
            "damping": float(DAMPING[i]),
        }
        keys = dict(zip(("aileron", "rudder", "elevator"), MIX[i].tolist(), strict=True))
        keys |= {"limits": [f"{low} deg", f"{high} deg"]} | (
            {"ideal": True} if i == IDEAL else lags
        )
        effectors[f"flap_{i}"] = keys
    law = write_law(folder, LAW.format(given=commands, how=how))
    return short_plan(60, law, "level", {"base": "ghame_x", "effectors": effectors})


@pytest.fixture(scope="module")
def sixteen(tmp_path_factory):
    return make_plan(tmp_path_factory.mktemp("effectors"))


def positions(plan, ticks, parameters):
    """Return the deflections [tick, flight, effector] at some ticks."""
    first = s.variable_row("effector_0")
    saved, rows = None, []
    for tick in ticks:
        saved = fly_until(plan, parameters, tick, saved)
        rows.append(saved.rows[:, first : first + COUNT].copy())
    return np.array(rows)


def test_sixteen_effectors_move_by_their_own_limits_rates_and_lags(sixteen):
    low, high, fastest = np.radians([LOW, HIGH, 0.8 * FASTEST])
    position, rate = (
        np.clip(MIX[:, 2] * sixteen.initial_state[s.ELEVATOR], low, high),
        np.zeros(COUNT),
    )
    expected = []
    for tick in range(60):
        command = MIX @ [0.01, 0.02, sixteen.reference[tick, REFERENCE.index("elevator")]]
        command[::2] = 0.0 if tick < 5 else 0.2 if tick < 30 else -0.3
        command = np.clip(command, low, high)
        position, rate = move(position, rate, command, 1.2 * BANDWIDTH, DAMPING, fastest, low, high)
        position[IDEAL], rate[IDEAL] = command[IDEAL], 0.0
        expected.append(position)
    ticks = np.array([6, 12, 30, 36, 60])
    simulated = positions(
        sixteen, ticks.tolist(), rows_of({"actuator.bandwidth": 1.2, "actuator.rate_limit": 0.8})
    )[:, 0]
    # The unit is rad. The largest error is that of a stop met within a step of the brute force.
    assert np.abs(simulated - np.array(expected)[ticks - 1]).max() < 2e-4


def test_an_effector_sticks_is_slow_and_loses_effectiveness(sixteen):
    cases = (
        {},
        {"stuck_time": 0.1},
        {"slow_time": 0.0, "rate_limit": 0.1},
        {"loss_time": 0.0, "effectiveness": 0.4},
    )
    parameters = rows_of(
        *({f"failure.effector_14.{name}": x for name, x in case.items()} for case in cases)
    )
    deflection = positions(sixteen, [10, 11, 20, 60], parameters)[:, :, 14]
    assert np.ptp(deflection[:, 1]) < 1e-12 < np.ptp(deflection[:, 0])
    assert deflection[2, 2] - deflection[0, 2] == pytest.approx(
        0.1 * np.radians(FASTEST[14]) * 0.1, rel=1e-3
    )
    assert deflection[:, 3] == pytest.approx(0.4 * deflection[:, 0], rel=1e-12)


def test_a_law_in_plain_python_commands_the_same(tmp_path, sixteen):
    plain = make_plan(tmp_path, how="(compiled=False)")
    assert np.array_equal(
        *(positions(plan, [20], nominal_parameters()) for plan in (plain, sixteen))
    )


def test_an_effectors_command_that_is_no_number_ends_the_flight_by_its_name(tmp_path):
    commands = '"flap_2": 0.1, "flap_4": 1e300 * 1e300 - 1e300 * 1e300 if time > 0.1 else step'
    plan = make_plan(tmp_path, commands, "(compiled=False)")
    block = fly(plan, nominal_parameters(1))
    assert block.outcome[0] == Outcome.NOT_FINITE
    assert "effector flap_4 at 0.11 s" in describe_end(
        plan, nominal_parameters(1), Outcome.NOT_FINITE
    )


SLACK_LAW = """
import math
from abhv_mc.extend import Command, controller

@controller
def law(time, reference):
    step = 0.06 * math.sin(9.0 * time) + (0.05 if time > 0.3 else 0.0)
    return Command(
        0.0, 0.0, reference.elevator, equivalence_ratio=0.5 + 4.0 * step,
        effectors={{{given}}},
    )
"""
ZONE, PLAY = 0.004, 0.006  # rad
LAGS = {"bandwidth": "40 rad/s", "rate": "100 rad/s"}
KINDS = {
    "second_order": LAGS | {"damping": 0.6},
    "first_order": LAGS | {"rate": "0.4 rad/s"},
    "ideal": {},
}
SLACKS = [
    {name: f"{size} rad" for name, size in (("dead_zone", zone), ("backlash", play)) if size}
    for zone in (0.0, ZONE)
    for play in (0.0, PLAY)
]


def command_at(time):
    return 0.06 * np.sin(9.0 * time) + np.where(time > 0.3, 0.05, 0.0)


def integrate_actuator(kind, zone, play, commands, start, bandwidth=40.0, fastest=0.4, length=0.01):
    """Return the position after each tick.

    scipy integrates the actuator with resolved kinks; the play operator on a fine grid gives the
    position of the surface.
    """
    actuator, rate, surface, surface_positions = start, 0.0, start, []
    for command in commands.tolist():
        fine = np.linspace(0.0, length, 1001)

        def pull(x, command=command):
            return command - x - np.clip(command - x, -zone, zone)

        if kind == "ideal":
            path = np.full(fine.size, command + np.clip(actuator - command, -zone, zone))
        else:
            derivatives = {
                "second_order": lambda _, y: [
                    y[1],
                    bandwidth**2 * pull(y[0]) - 1.2 * bandwidth * y[1],
                ],
                "first_order": lambda _, y: [
                    np.clip(bandwidth * pull(y[0]), -fastest, fastest),
                    0.0,
                ],
            }
            path, rates = solve_ivp(
                derivatives[kind],
                (0.0, length),
                [actuator, rate],
                "DOP853",
                fine,
                rtol=1e-11,
                atol=1e-13,
                max_step=1e-3,
            ).y
            rate = rates[-1]
        actuator = path[-1]
        for x in path:
            surface = min(max(surface, x - play), x + play)
        surface_positions.append(surface)
    return np.array(surface_positions)


def test_each_kind_of_actuator_with_dead_zone_and_backlash_follows_its_equation(tmp_path):
    effectors, assignments, expected, ticks = {}, [], [], 60
    for kind, dynamics in KINDS.items():
        for slack in SLACKS:
            name = f"flap_{len(effectors)}"
            assignments.append(f'"{name}": step')
            effectors[name] = {"kind": kind, "elevator": 1.0, "limits": ["-1 rad", "1 rad"]}
            effectors[name] |= dynamics | slack
    law = write_law(tmp_path, SLACK_LAW.format(given=", ".join(assignments)))
    engine = {"throttle_kind": "first_order", "bandwidth": "10 rad/s", "damping": None}
    engine |= {"rate_limit": "1.5 1/s", "dead_zone": 0.02, "backlash": 0.03}
    vehicle = {"base": "ghame_x", "effectors": effectors}
    vehicle |= {f"propulsion.{name}": value for name, value in engine.items()}
    plan = short_plan(ticks, law, "level", vehicle)
    start, throttle = plan.initial_state[[s.ELEVATOR, s.ETA]]
    commands = command_at(0.01 * np.arange(ticks))
    for kind in KINDS:
        for slack in SLACKS:
            zone, play = ZONE * ("dead_zone" in slack), 0.5 * PLAY * ("backlash" in slack)
            expected.append(integrate_actuator(kind, zone, play, commands, start))
    throttle_commands = 0.5 + 4.0 * commands
    expected.append(
        integrate_actuator("first_order", 0.02, 0.015, throttle_commands, throttle, 10.0, 1.5)
    )
    saved, simulated = None, []
    for tick in range(1, ticks + 1):
        saved = fly_until(plan, nominal_parameters(), tick, saved)
        first = s.variable_row("effector_0")
        deflections = saved.rows[0, first : first + len(effectors)]
        simulated.append(np.append(deflections, saved.rows[0, s.X + s.ETA]))
    errors = np.abs(np.array(simulated) - np.array(expected).T)
    assert errors.max() < 1e-6, errors.max(axis=0)
