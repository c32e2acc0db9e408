"""Tests of misaligned thrust, of tables and of a function, against a rotated vector."""

from dataclasses import replace

import numpy as np
import pytest
from short_flights import rows_of, short_plan

from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_fixed, evaluate_tables, make_variables

UP, RIGHT = 0.02, -0.03  # rad
MORE = 1.0  # relative increase of thrust, from which its force is computed
ASIDE = 0.02  # centre of gravity, m
STEP = 1e-6  # s, so short that the rotation does not turn the velocity


@pytest.mark.parametrize(
    ("inputs", "arm"),
    [
        (("tlc", "level", "abhv"), (0.0, 0.0, 0.16736612)),
        (("f16_autopilot", "f16_level", "f16"), (0.0, 0.0, 0.0)),
    ],
)
def test_a_misaligned_thrust_turns_about_the_point_where_it_acts(inputs, arm):
    plan = short_plan(1, *inputs)
    plan = replace(plan, timing=plan.timing._replace(step=STEP, steps_per_tick=1))
    moved = {"mass.center_of_gravity_y": ASIDE}
    rows = rows_of(
        moved,
        moved | {"propulsion.thrust": 1.0 + MORE},
        moved | {"thrust.inclination": UP, "thrust.azimuth": RIGHT},
    )
    flown = fly(plan, rows, 1, keep_states=True).states
    rates, states = (flown[:, 1] - flown[:, 0]) / STEP, flown[:, 0]
    mass = states[0, s.MASS]
    variables = make_variables(plan.vehicle, mass=mass)
    fixed = evaluate_fixed(plan.vehicle, variables, evaluate_tables(plan.vehicle.tables, variables))
    value = {name: float(values[0]) for name, values in fixed.items()}
    inertia = np.diag([value[f"inertia_{axis}"] for axis in ("xx", "yy", "zz")])
    inertia[0, 2] = inertia[2, 0] = value["inertia_13"]
    speed, spin = slice(s.U, s.W + 1), slice(s.ROLL_RATE, s.YAW_RATE + 1)
    force = mass * (rates[1, speed] - rates[0, speed]) / MORE
    assert np.linalg.norm(force) > 100.0
    up = np.array([[np.cos(UP), 0.0, np.sin(UP)], [0.0, 1.0, 0.0], [-np.sin(UP), 0.0, np.cos(UP)]])
    right = np.array(
        [[np.cos(RIGHT), -np.sin(RIGHT), 0.0], [np.sin(RIGHT), np.cos(RIGHT), 0.0], [0.0, 0.0, 1.0]]
    )
    turned = right @ up @ force - force
    assert turned[1] < 0.0 and turned[2] < 0.0  # to the left and upward
    lever = np.array(arm) - [value["center_of_gravity_x"], ASIDE, value["center_of_gravity_z"]]
    moment = inertia @ (rates[1, spin] - rates[0, spin]) / MORE
    assert moment == pytest.approx(np.cross(lever, force), abs=1e-4 * np.linalg.norm(force))
    size = np.linalg.norm(turned)
    assert mass * (rates[2, speed] - rates[0, speed]) == pytest.approx(turned, abs=1e-4 * size)
    moment = inertia @ (rates[2, spin] - rates[0, spin])
    assert moment == pytest.approx(np.cross(lever, turned), abs=1e-4 * size)
    assert np.abs(moment).max() > 0.01 * size
