"""Custom dynamics against independent integrations and eigenvalues, and rejected inputs."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from short_flights import change_vehicle, short_plan

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.timing import Timing
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.probe import plant_states

AREA, CHORD = 8.026848, 2.7432
FREQUENCY, DAMPING, EXCITATION = 20.0, 0.01, 0.05

MODE = """
from abhv_mc.extend import Effect, Sensed, dynamics

@dynamics
def bending(states, motion, air, controls, settings):
    load = air.dynamic_pressure * 8.026848 / motion.mass
    drive = settings.excitation * load * (air.angle_of_attack + controls.elevator)
    w = settings.frequency
    tilt = 0.1 * states.mode
    return Effect(
        rates=(states.mode_rate, drive - 2.0 * settings.damping * w * states.mode_rate - w * w * \
states.mode),
        force=(0.0, 0.0, -settings.lift * air.dynamic_pressure * 8.026848 * tilt),
        moment=(0.0, settings.moment * air.dynamic_pressure * 8.026848 * 2.7432 * tilt, 0.0),
        sensed=Sensed(pitch_rate=settings.gyro_slope * states.mode_rate, angle_of_attack=tilt),
    )
"""
MODE_KEYS = """dynamics:
  file: own.py
  states: {mode: m, mode_rate: m/s}
  settings:
    frequency: 20 rad/s
    damping: 0.01
    excitation: 0.05
    gyro_slope: 0.02 rad/m
    lift: 0.2
    moment: 0.05
"""
# A lateral spring and mass ahead of the centre of gravity, whose mass is part of the vehicle's: its
# force is minus its mass times its relative acceleration, which depends on that force.
SLOSH = """
from abhv_mc.extend import Effect, dynamics

@dynamics
def slosh(states, motion, air, controls, settings):
    felt = motion.acceleration_y - motion.gravity_y + settings.arm * motion.yaw_acceleration
    spring = 2.0 * settings.damping * settings.frequency * states.rate
    spring += settings.frequency * settings.frequency * states.offset
    share = settings.mass * (1.0 / motion.mass + settings.arm * settings.arm / settings.inertia)
    acceleration = -(felt + spring) / (1.0 - share)
    force = -settings.mass * acceleration
    return Effect(
        rates=(states.rate, acceleration),
        force=(0.0, force, 0.0),
        moment=(0.0, 0.0, settings.arm * force),
    )
"""
SLOSH_KEYS = """dynamics:
  file: own.py
  states: {offset: m, rate: m/s}
  settings: {frequency: 15 rad/s, damping: 0.02, mass: 300 kg, arm: 1.5 m, inertia: 12500 kg m2}
"""
LAW = "lqr"


def write_vehicle(folder, function=MODE, keys=MODE_KEYS, limits=""):
    """Write the shipped vehicle with custom dynamics and return its path."""
    (folder / "own.py").write_text(function, encoding="utf-8")
    start = "limits: # a flight terminates outside these\n"
    return change_vehicle(folder, (start, keys + start + limits), name="abhv")


def plan_of(vehicle, seconds=10.0, mission="s_manoeuvre"):
    return short_plan(round(seconds * 100), LAW, mission, vehicle)


def at_step(plan, step):
    """Return the plan with another integrator step at the same control rate."""
    steps = round(plan.timing.tick / step)
    return replace(plan, timing=Timing(plan.timing.tick / steps, steps, plan.timing.ticks))


def at_rate(plan, rate):
    """Return the plan at a higher control rate, with reference and gains held between its ticks."""
    factor = round(rate * plan.timing.tick)
    rows = {
        name: np.repeat(getattr(plan, name), factor, axis=0)[
            : plan.timing.ticks * factor + 1
        ].copy()
        for name in ("reference", "gains")
    }
    timing = Timing(plan.timing.tick / factor, 1, plan.timing.ticks * factor)
    return replace(plan, timing=timing, **rows)


def states_of(plan, ticks, **initial):
    saved = fly_until(plan, parameters_of(plan, **initial), ticks)
    return saved.rows[0, s.CUSTOM_STATE : s.CUSTOM_STATE + plan.vehicle.foreign.states]


def parameters_of(plan, **initial):
    """Return a nominal row with settings and initial values of custom states."""
    code = plan.vehicle_code
    names = [*(setting.name for setting in code.settings), *(start.name for start in code.starts)]
    values = dict(
        zip(names, [*plan.vehicle.foreign.settings, *[0.0] * len(code.starts)], strict=True)
    )
    values |= {name.replace("__", "."): value for name, value in initial.items()}
    return np.hstack([nominal_parameters(), [list(values.values())]])


@pytest.fixture(scope="module")
def mode(tmp_path_factory):
    return write_vehicle(tmp_path_factory.mktemp("mode"))


@pytest.fixture(scope="module")
def slosh(tmp_path_factory):
    return write_vehicle(tmp_path_factory.mktemp("slosh"), SLOSH, SLOSH_KEYS)


def test_states_follow_an_independent_integration(mode):
    plan = at_rate(plan_of(mode), 2000.0)
    block = fly(plan, parameters_of(plan, initial__mode=0.01), 1, keep_states=True)
    x, t = block.states[0], block.times
    speed = np.linalg.norm(x[:, s.U : s.W + 1], axis=1)
    density = np.array([atmosphere(h)[0] for h in x[:, s.ALTITUDE]])
    load = 0.5 * density * speed**2 * AREA / x[:, s.MASS]
    alpha = np.arctan2(x[:, s.W], x[:, s.U])
    drive = CubicSpline(t, EXCITATION * load * (alpha + x[:, s.ELEVATOR]))

    def rates(time, y):
        return y[1], drive(time) - 2.0 * DAMPING * FREQUENCY * y[1] - FREQUENCY**2 * y[0]

    names = [channel.name for channel in plan.channels]
    flown = block.history[0][:, [names.index("state.mode"), names.index("state.mode_rate")]]
    start = [plan.initial_state[s.N_STATES] + 0.01, 0.0]
    integrated = solve_ivp(rates, (0.0, t[-1]), start, "DOP853", t, rtol=1e-11, atol=1e-14).y.T
    np.testing.assert_allclose(
        flown, integrated, rtol=0.0, atol=1e-6 * np.abs(integrated).max(axis=0).min()
    )
    assert np.abs(integrated[:, 0]).max() > 0.009


MODES, MODE_DAMPING, MODE_EXCITATION, SLOPE = np.array([19.0, 53.0, 108.0]), 0.02, 0.01, 0.12


@pytest.fixture(scope="module")
def flexible():
    """Return the plan of the shipped flexible vehicle for 10 s."""
    return short_plan(1000, "lqr_robust_abhv", "flexible", "flexible")


# Rows of the lane memory: the inputs of the modes, then displacement and rate of each mode.


def test_the_flexible_vehicle_has_the_eigenvalues_of_its_equations(flexible):
    """Modes with analytic coupling to the linear model of the rigid vehicle."""
    point = flown_points(flexible, parameters_of(flexible), 0.02).points
    rigid = make_flight_plan("flexible", {"base": "flexible", "dynamics": None}, "lqr_robust_abhv")
    A = np.zeros((16, 16))
    A[:10, :10] = linearize(rigid, point._replace(custom=point.custom[:, :0])).plant_A[0]
    speed, alpha, mass = point.path[0, 1], point.path[0, 4], point.mass[0]
    force = 0.5 * atmosphere(float(point.path[0, 0]))[0] * speed**2 * AREA
    inertia = np.interp(mass, [3084.812, 3224.812], [11576.80704, 11871.65086])
    for i, w in zip((10, 12, 14), MODES, strict=True):
        A[i, i + 1], A[i + 1, i], A[i + 1, i + 1] = 1.0, -(w**2), -2.0 * MODE_DAMPING * w
        A[i + 1, 4] = MODE_EXCITATION * force / mass
        lift = 0.2 * SLOPE * force / mass
        A[1, i] = -lift * np.sin(alpha)
        A[2, i] = lift * np.cos(alpha) / speed
        A[4, i] = -lift * np.cos(alpha) / speed
        A[8, i] = 0.05 * SLOPE * force * CHORD / inertia
    ours, theirs = (
        np.linalg.eigvals(matrix) for matrix in (A, linearize(flexible, point).plant_A[0])
    )
    for frequency, tolerance in zip((*MODES, 1.84), (1e-6, 1e-6, 1e-6, 1e-5), strict=True):
        pole = ours[np.abs(ours - 1j * frequency).argmin()]
        assert np.abs(theirs - pole).min() < tolerance, pole


@pytest.mark.parametrize("kind", ["mode", "slosh"])
def test_order_of_the_method(kind, request):
    plan, start = plan_of(request.getfixturevalue(kind), 2.0), {}
    start = {"initial__mode": 0.01} if kind == "mode" else {"initial__offset": 0.05}
    best = states_of(at_step(plan, 0.3125e-3), 200, **start)
    steps = np.array([5e-3, 2.5e-3, 1.25e-3])
    errors = [np.abs(states_of(at_step(plan, h), 200, **start) - best).max() for h in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.7 < order < 4.2, (order, errors)


def test_start_is_an_equilibrium_of_all_states(mode):
    plan = plan_of(mode, mission="level")
    fixed = replace(plan, law="recorded", gains=np.zeros((len(plan.gains), 8)), lean=False)
    fixed.gains[:, :4] = plan.initial_state[[s.AILERON, s.RUDDER, s.ELEVATOR, s.ETA]]
    saved = fly_until(fixed, nominal_parameters(), 1)
    moved = saved.rows[0, s.CUSTOM_STATE : s.CUSTOM_STATE + 2]
    start = plan.initial_state[s.N_STATES :]
    assert start[0] > 1e-4
    assert start[1] == pytest.approx(0.0, abs=1e-15)
    scale = start[0] * np.array([1.0, FREQUENCY])
    np.testing.assert_allclose(moved / scale, start / scale, rtol=0.0, atol=1e-5)
    # The nose bends up, which lifts and pitches: the trim is another one than the rigid vehicle's.
    rigid = make_flight_plan("level", "abhv", LAW).initial_state
    assert abs(plan.initial_state[s.ELEVATOR] - rigid[s.ELEVATOR]) > 1e-6


@pytest.mark.parametrize("lanes", [LANES, pytest.param(1, marks=pytest.mark.thorough)])
def test_flights_do_not_depend_on_their_lanes(mode, lanes):
    plan = plan_of(mode, 3.0)
    rows = np.repeat(parameters_of(plan), 40, axis=0)
    rows[:, len(PARAMETERS)] *= np.linspace(0.9, 1.1, 40)
    abreast, alone = fly(plan, rows, 10), fly(plan, rows[7:8], 10, lanes)
    assert np.array_equal(abreast.history[7], alone.history[0], equal_nan=True)
    assert np.array_equal(abreast.metrics[7], alone.metrics[0], equal_nan=True)
    assert not np.array_equal(abreast.metrics[7], abreast.metrics[8])
    # A flight that continues from saved memory is the same, too.
    saved = fly_until(plan, rows[7:8], 150)
    continued = fly(plan, rows[7:8], 10, start=saved).history[0, 15:]
    assert np.array_equal(continued, alone.history[0, 15:], equal_nan=True)


def test_a_state_past_its_limit_ends_the_flight(tmp_path):
    plan = plan_of(write_vehicle(tmp_path, limits="  state.mode: 2 cm\n"), 3.0)
    block = fly(plan, np.vstack([parameters_of(plan), parameters_of(plan, initial__mode=0.03)]))
    assert block.outcome.tolist() == [Outcome.OK, Outcome.STATE_LIMIT]


def test_linear_model_has_the_mode(mode):
    plan = plan_of(mode, 3.0)
    trajectory = flown_points(plan, parameters_of(plan), 1.0)
    linear = linearize(plan, trajectory.points)
    names = plant_states(plan.vehicle)
    assert names[-2:] == ("state.mode", "state.mode_rate")
    x = trajectory.points
    density = atmosphere(float(x.path[0, 0]))[0]
    q_bar = 0.5 * density * x.path[0, 1] ** 2
    load = q_bar * AREA / x.mass[0]
    A = linear.plant_A[0]
    # Analytic rows of the mode and its effect on flight path and pitch.
    np.testing.assert_allclose(A[11, 10:], [-(FREQUENCY**2), -2 * DAMPING * FREQUENCY], rtol=1e-7)
    np.testing.assert_allclose(A[11, 4], EXCITATION * load, rtol=1e-6)
    np.testing.assert_allclose(linear.plant_B[0][11, 2], EXCITATION * load, rtol=1e-6)
    inertia = 11966.877  # kg m2
    np.testing.assert_allclose(A[8, 10], 0.05 * q_bar * AREA * CHORD * 0.1 / inertia, rtol=1e-5)
    sense = linear.sense[0]
    np.testing.assert_allclose(sense[4, -2:], [0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(sense[8, -2:], [0.0, 0.02], atol=1e-9)
    # The sampled model is the exponential of the continuous one: the mode's eigenvalue is there.
    poles = np.log(np.linalg.eigvals(linear.A[0]).astype(complex)) / plan.timing.tick
    coupled = np.linalg.eigvals(A)
    bending_pole = coupled[np.abs(coupled - 1j * FREQUENCY).argmin()]
    assert np.abs(poles - bending_pole).min() < 1e-6


ERRORS = {
    "rates": (
        "rates=(states.mode_rate, ",
        "rates=(states.mode_rate, 0.0, ",
        "3 rates for 2 states",
    ),
    "other rates": (
        "    tilt =",
        "    if states.mode > 2.0:\n        return Effect(rates=(0.0,))\n    tilt =",
        "1 rate for 2 states",
    ),
    "nothing": (
        "    tilt =",
        "    if states.mode > 2.0:\n        return None\n    tilt =",
        "'return None'",
    ),
    "text": ("rates=(states.mode_rate,", "rates=('m',", "rates=('m', "),
    "one number": ("rates=(states.mode_rate, drive", "rates=(drive", "rates=1"),
    "two": ("@dynamics", "@dynamics\ndef other(states):\n    pass\n\n@dynamics", "2 functions"),
    "nan": ("tilt = 0.1 * states.mode", "tilt = 0.1 * (1e308 * 1e308 * 0.0)", "not finite"),
    "short force": ("force=(0.0, 0.0,", "force=(0.0,", "force=(0.0, -"),
    "side force": ("force=(0.0, 0.0,", "force=(0.0, 1e308 * 1e308 * 0.0,", "force along y"),
    "sensed": ("angle_of_attack=tilt", "bank=1e308 * 1e308", "sensed bank"),
    "setting": ("settings.damping", "settings.dampng", "settings.dampng"),
    "state": ("tilt = 0.1 * states.mode", "tilt = 0.1 * states.mod", "states.mod"),
    "name": ("tilt = 0.1 *", "tilt = slope *", "the name 'slope'"),
    "argument": ("air, controls, settings", "air, controls, setings", "'setings'"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_a_wrong_function_is_rejected_with_its_line(tmp_path, case):
    old, new, fragment = ERRORS[case]
    assert old in MODE
    vehicle = write_vehicle(tmp_path, MODE.replace(old, new))
    with pytest.raises(InputError) as caught:
        make_flight_plan("level", str(vehicle), LAW)
    assert fragment in str(caught.value)
    assert caught.value.file == str(tmp_path / "own.py") or Path(caught.value.file).name == "own.py"
    assert caught.value.line is not None


def test_a_state_without_equilibrium_needs_a_start(tmp_path):
    wall = "rates=(states.mode_rate, 0.02 * load)"
    function = MODE[: MODE.index("rates=")] + wall + ")\n"
    vehicle = write_vehicle(tmp_path, function)
    with pytest.raises(InputError, match="equilibrium"):
        make_flight_plan("level", str(vehicle), LAW)
    keys = MODE_KEYS.replace("{mode: m,", "{mode: {unit: m, start: 1 cm},").replace(
        "mode_rate: m/s", "mode_rate: {unit: m/s, start: 0.5 m/s}"
    )
    plan = make_flight_plan("level", str(write_vehicle(tmp_path, function, keys)), LAW)
    assert plan.initial_state[s.N_STATES :].tolist() == [0.01, 0.5]


def test_a_step_too_long_for_the_states_is_rejected(tmp_path):
    def keys(frequency):
        return MODE_KEYS.replace("frequency: 20", f"frequency: {frequency}")

    plan = make_flight_plan("level", str(write_vehicle(tmp_path, keys=keys(60.0))), LAW)
    assert any(re.search(r"\b60 rad/s\b.*\b10 ms\b", warning) for warning in plan.warnings)
    with pytest.raises(InputError, match=r"at most 1\.6 ms"):
        make_flight_plan("level", str(write_vehicle(tmp_path, keys=keys(250.0))), LAW)
