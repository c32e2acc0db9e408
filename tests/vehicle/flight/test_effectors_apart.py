"""Flights of a vehicle with effectors against an independent simulation.

It uses inertial Cartesian coordinates and direction cosines in double precision. The law commands
two elevons and a flap by name, and the rudder, which the aerodynamics use directly, as an axis.
"""

import inspect
from collections import namedtuple

import numpy as np
import pytest
from ambiance import Atmosphere
from scipy.spatial.transform import Rotation
from short_flights import cut, rows_of
from verification.independent import World, local_axes

from abhv_mc.extend import Coefficients, Command, Thrust, clamp
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan

VEHICLE = """
name: plank
description: two elevons, a flap and a rudder
reference: {area: 3 m2, span: 2 m, chord: 3 m}
mass:
  start: 1400 kg
  points:
    - {mass: 1400 kg, inertia_xx: 300 kg m2, inertia_yy: 5000 kg m2, inertia_zz: 5200 kg m2,
       inertia_matrix_element_13: 60 kg m2, center_of_gravity_x: 0 m, center_of_gravity_z: 0 m}
surfaces: {bandwidth: 40 rad/s, damping: 0.8, limit: 20 deg, rate_limit: 4000 deg/s}
effectors:
  left: {aileron: -1, elevator: 1, bandwidth: 50 rad/s, damping: 0.7}
  right: {aileron: 1, elevator: 1, bandwidth: 45 rad/s, damping: 0.6}
  flap: {elevator: 0.5, bandwidth: 20 rad/s, damping: 0.9, limits: [-10 deg, 10 deg]}
aerodynamics: {python: plank.py, function: coefficients, frame: stability}
propulsion: {python: plank.py, function: thrust, throttle: [0, 1], bandwidth: 20 rad/s, damping: \
1, rate_limit: 100 /s}
limits: {angle_of_attack: [-10 deg, 20 deg], sideslip: 15 deg}
"""


def coefficients(air, controls, rates):
    alpha, beta = air.angle_of_attack, air.sideslip
    pair, split = controls.left + controls.right, controls.right - controls.left
    roll = -0.06 * beta - 0.3 * rates.roll_rate + 0.05 * rates.yaw_rate
    return Coefficients(
        CL=alpha + 0.05 * pair + 0.1 * controls.flap,
        CD=0.02
        + 0.8 * alpha * alpha
        + 0.1 * (controls.left * controls.left + controls.right * controls.right),
        CY=-0.6 * beta + 0.1 * controls.rudder,
        Cl=roll + 0.02 * split * (1.0 + alpha) + 0.004 * controls.rudder,
        Cm=0.008
        - 0.2 * alpha
        - 1.5 * rates.pitch_rate
        - 0.1 * pair
        - 0.05 * controls.flap * (1.0 + 2.0 * alpha),
        Cn=0.1 * beta - 0.25 * rates.yaw_rate - 0.05 * controls.rudder + 0.002 * split,
    )


def thrust(air, throttle):
    return Thrust(force_x=1.2e5 * throttle * air.density)


def law(measured, reference):
    path = clamp(2e-4 * (reference.altitude - measured.altitude), -0.02, 0.02)
    alpha = reference.angle_of_attack + 0.8 * (path - measured.flight_path_angle)
    elevator = (
        reference.elevator + 0.6 * (measured.angle_of_attack - alpha) + 0.4 * measured.pitch_rate
    )
    aileron = -0.3 * (measured.bank - 0.2) - 0.15 * measured.roll_rate
    throttle = reference.equivalence_ratio + 0.02 * (reference.speed - measured.speed)
    flap = 0.02 - 0.4 * measured.pitch_rate
    rudder, right = 0.5 * measured.yaw_rate + 0.3 * measured.sideslip, elevator + 0.9 * aileron
    return Command(
        9.0,
        rudder,
        9.0,
        throttle=throttle,
        effectors={"left": elevator - aileron, "right": right, "flap": flap},
    )


FUNCTIONS = "\n\n".join(
    [
        "from abhv_mc.extend import Coefficients, Thrust\n",
        *map(inspect.getsource, (coefficients, thrust)),
    ]
)
LAW = (
    "from abhv_mc.extend import Command, clamp, controller\n\n\n@controller\n"
    f"{inspect.getsource(law)}"
)
CASES = (
    {},
    {"atmosphere.density": 1.05},
    {"wind.north": 15.0},
    {"aero.lift": 1.04},
    {"aero.drag": 1.1},
    {"aero.pitching_moment": 1.1},
    {"aero.rolling_moment.sideslip": 1.3},
    {"aero.rolling_moment.aileron": 0.7},
    {"control.aileron_effectiveness": 0.6},
    {"control.effector_0_effectiveness": 0.8},
    {"mass.total": 1.03},
    {"mass.inertia_yy": 1.2},
    {"mass.center_of_gravity_x": 0.02},
    {"actuator.bandwidth": 0.7},
    {"propulsion.thrust": 1.05},
    {"failure.effector_2.stuck_time": 3.0, "failure.effector_2.stuck_at": 0.03},
)
Air, Rates = (
    namedtuple("Air", "angle_of_attack sideslip"),
    namedtuple("Rates", "roll_rate pitch_rate yaw_rate"),
)
Controls, Row = namedtuple("Controls", "left right flap rudder"), namedtuple("Row", REFERENCE)
Seen = namedtuple(
    "Seen", ("altitude", "speed", "flight_path_angle", *Air._fields, "bank", *Rates._fields)
)
STEPS = 2  # of a control tick
MIX = np.array(
    [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 0.0, 0.5], [0.0, 1.0, 0.0]]
)  # left, right, flap, rudder
BANDWIDTH, DAMPING = np.array([50.0, 45.0, 20.0, 40.0, 20.0]), np.array([0.7, 0.6, 0.9, 0.8, 1.0])
LIMIT = np.radians([20.0, 20.0, 10.0, 20.0])


def value(name, nominal=1.0):
    """A parameter of each flight."""
    return np.array([case.get(name, nominal) for case in CASES])


def dispersed_coefficients(alpha, beta, hats, positions):
    """Return the dispersed coefficients.

    Dispersions of the aileron act on the antisymmetric deflection of the elevons, not on the flap
    or the rudder.
    """

    def evaluate(left, right, sideslip=beta):
        c = coefficients(Air(alpha, sideslip), Controls(left, right, *positions[2:]), Rates(*hats))
        return np.array([c.CL, c.CD, c.CY, c.Cl, c.Cm, c.Cn])

    left, right = positions[:2]
    share = 0.5 * (right - left)  # antisymmetric deflection
    k = value("control.aileron_effectiveness") - 1.0
    left, right = value("control.effector_0_effectiveness") * (left - k * share), right + k * share
    total = evaluate(left, right)
    # Without the antisymmetric deflection, and without sideslip.
    without_aileron, without_sideslip = (
        evaluate(positions[0] + share, positions[1] - share),
        evaluate(left, right, 0.0 * beta),
    )
    total[3] += (value("aero.rolling_moment.aileron") - 1.0) * (total[3] - without_aileron[3])
    sideslip = value("aero.rolling_moment.sideslip") - 1.0
    total[3] += sideslip * (total[3] - without_sideslip[3]) * (sideslip != 0.0)
    return total


class Flights:
    """State of all cases: positions and velocities [3, flight], attitudes [3, 3, flight]."""

    def __init__(self, plan):
        self.plan, self.world = plan, World()
        x = plan.initial_state
        r = self.world.place(x[s.LATITUDE], x[s.LONGITUDE], x[s.ALTITUDE])
        local = Rotation.from_quat(x[s.Q0 : s.Q3 + 1], scalar_first=True).as_matrix()
        body = self.axes(r[:, None])[0][:, :, 0].T @ local
        v = body @ x[s.U : s.W + 1] + np.cross(self.world.omega, r)
        positions = np.clip(MIX[:, 2] * x[s.ELEVATOR], -LIMIT, LIMIT)
        moving = np.column_stack([[*positions, x[s.ETA]], np.zeros(5)]).ravel()
        row = np.concatenate([r, v, body.ravel(), x[s.ROLL_RATE : s.YAW_RATE + 1], moving])
        self.x = np.tile(row[:, None], (1, len(CASES)))
        self.mass = 1400.0 * value("mass.total")
        inertia = np.array([[300.0, 0.0, 60.0], [0.0, 5000.0, 0.0], [60.0, 0.0, 5200.0]])
        self.J = np.repeat(inertia[:, :, None], len(CASES), axis=2)
        self.J[1, 1] *= value("mass.inertia_yy")
        self.inverse = np.moveaxis(np.linalg.inv(np.moveaxis(self.J, 2, 0)), 0, 2)

    def axes(self, r):
        """Return north, east and down as rows [3, 3, flight], and the geodetic altitude."""
        lat, h = self.world.geodetic(r)
        return local_axes(lat, np.arctan2(r[1], r[0])), h

    def relative(self, x):
        """Return the velocity relative to the Earth, Earth-centred axes."""
        return x[3:6] - np.cross(self.world.omega, x[:3].T).T

    def rate(self, x, command):
        body, omega = x[6:15].reshape(3, 3, -1), x[15:18]
        axes, h = self.axes(x[:3])
        wind = axes[0] * value("wind.north", 0.0)
        u, v, w = np.einsum("jif,jf->if", body, self.relative(x) - wind)
        speed = np.sqrt(u * u + v * v + w * w)
        alpha, beta = np.arctan2(w, u), np.arcsin(v / speed)
        p, q, r = omega - np.einsum("jif,j->if", body, self.world.omega)
        hats = p * 2.0 / (2.0 * speed), q * 3.0 / (2.0 * speed), r * 2.0 / (2.0 * speed)
        density = Atmosphere(h).density * value("atmosphere.density")
        c = dispersed_coefficients(alpha, beta, hats, x[18:26:2])
        for i, name in ((0, "aero.lift"), (1, "aero.drag"), (4, "aero.pitching_moment")):
            c[i] *= value(name)
        pressure = 0.5 * density * speed**2 * 3.0
        ahead, down = (
            c[0] * np.sin(alpha) - c[1] * np.cos(alpha),
            -c[0] * np.cos(alpha) - c[1] * np.sin(alpha),
        )
        force = pressure * np.array([ahead, c[2], down])
        force[0] += 1.2e5 * x[26] * density * value("propulsion.thrust")
        moment = pressure * np.array([2.0 * c[3], 3.0 * c[4], 2.0 * c[5]])
        arm = np.zeros((3, len(CASES)))
        arm[0] = -value("mass.center_of_gravity_x", 0.0)
        moment += np.cross(arm, force, axis=0)
        spin = np.einsum("ijf,jf->if", self.J, omega)
        zero = 0.0 * omega[0]
        turning = np.array(
            [[zero, -omega[2], omega[1]], [omega[2], zero, -omega[0]], [-omega[1], omega[0], zero]]
        )
        derivative = np.empty_like(x)
        derivative[:3], derivative[3:6] = (
            x[3:6],
            self.world.gravity(x[:3]) + np.einsum("ijf,jf->if", body, force) / self.mass,
        )
        derivative[6:15] = np.einsum("ijf,jkf->ikf", body, turning).reshape(9, -1)
        derivative[15:18] = np.einsum(
            "ijf,jf->if", self.inverse, moment - np.cross(omega, spin, axis=0)
        )
        bandwidth = BANDWIDTH[:, None] * np.where(
            np.arange(5)[:, None] < 4, value("actuator.bandwidth"), 1.0
        )
        derivative[18::2] = x[19::2]
        derivative[19::2] = (
            bandwidth**2 * (command - x[18::2]) - 2.0 * DAMPING[:, None] * bandwidth * x[19::2]
        )
        return derivative

    def command(self, x, tick):
        """Return the commands of left, right, flap, rudder and throttle."""
        axes, h = self.axes(x[:3])
        relative = self.relative(x)
        north, east, down = np.einsum("ijf,jf->if", axes, relative)
        v = np.sqrt(north**2 + east**2 + down**2)
        body = x[6:15].reshape(3, 3, -1)
        along, right, below = np.einsum("jif,jf->if", body, relative)
        alpha, beta = np.arctan2(below, along), np.arcsin(right / v)
        to_down = np.einsum("jf,jif->if", axes[2], body)
        ahead = np.cos(alpha) * to_down[0] + np.sin(alpha) * to_down[2]
        level = np.cos(beta) * to_down[1] - np.sin(beta) * ahead
        bank = np.arctan2(level, np.cos(alpha) * to_down[2] - np.sin(alpha) * to_down[0])
        measurements = np.array([h, v, np.arcsin(-down / v), alpha, beta, bank, *x[15:18]])
        commands = [
            law(Seen(*row), Row(*self.plan.reference[tick])) for row in measurements.T.tolist()
        ]
        deflections = np.array(
            [[*command.effectors.values(), command.rudder] for command in commands]
        ).T
        stuck = tick * 0.01 >= value("failure.effector_2.stuck_time", np.inf) - 1e-9
        deflections[2] = np.where(stuck, value("failure.effector_2.stuck_at", 0.0), deflections[2])
        deflections = np.clip(deflections, -LIMIT[:, None], LIMIT[:, None])
        return np.vstack(
            [deflections, np.clip([command.throttle for command in commands], 0.0, 1.0)]
        )

    def fly(self, ticks):
        """Return the state [row, flight] at the last tick."""
        x, step = self.x, 0.01 / STEPS
        for tick in range(ticks):
            command = self.command(x, tick)
            for _ in range(STEPS):
                k1 = self.rate(x, command)
                k2 = self.rate(x + 0.5 * step * k1, command)
                k3 = self.rate(x + 0.5 * step * k2, command)
                x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + self.rate(x + step * k3, command))
        return x


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plank")
    (folder / "plank.py").write_text(FUNCTIONS, encoding="utf-8")
    (folder / "plank.yaml").write_text(VEHICLE, encoding="utf-8")
    return make_flight_plan("level", folder / "plank.yaml", law)


def test_the_flights_are_those_of_an_independent_integration(plan):
    ticks = 500
    plan = cut(plan, ticks)
    block = fly(plan, rows_of(*CASES), ticks, keep_states=True)
    assert (block.outcome == 0).all()
    independent, ours = Flights(plan), block.states[:, -1].T
    x = independent.fly(ticks)
    h = independent.axes(x[:3])[1]
    assert np.abs(h - ours[s.ALTITUDE]).max() < 2e-3  # m
    body = x[6:15].reshape(3, 3, -1)
    u, v, w = np.einsum("jif,jf->if", body, independent.relative(x))
    for expected, simulated in ((w / u, ours[s.W] / ours[s.U]), (v / u, ours[s.V] / ours[s.U])):
        assert np.degrees(np.abs(np.arctan(expected) - np.arctan(simulated))).max() < 2e-3  # deg
    assert np.degrees(np.abs(x[15:18] - ours[s.ROLL_RATE : s.YAW_RATE + 1])).max() < 2e-3
    axes = np.linalg.pinv(MIX) @ x[18:26:2]
    assert np.degrees(np.abs(axes - ours[s.AILERON : s.ELEVATOR + 1])).max() < 2e-3


def test_a_law_of_effectors_has_the_usage_of_the_axes_that_they_make(plan):
    plan = cut(plan, 300)
    block = fly(plan, rows_of({}), 1)
    channels = {
        channel.name: block.history[0, :, i].astype(float)
        for i, channel in enumerate(plan.channels)
    }
    names = {metric.name: i for i, metric in enumerate(plan.metrics)}
    deflections = np.array(
        [channels[f"{name}_deg"] for name in ("left", "right", "flap", "rudder_effector")]
    )
    axes = np.linalg.pinv(MIX) @ deflections
    for name, deflection in zip(("aileron", "rudder", "elevator"), axes, strict=True):
        np.testing.assert_allclose(channels[f"{name}_deg"], deflection, atol=1e-5)
        rms = np.sqrt(np.mean((deflection - deflection[0]) ** 2))
        assert block.metrics[0, METRIC_INDEX[f"{name}_rms_deg"]] == pytest.approx(
            rms, rel=1e-4, abs=1e-9
        )
    assert block.metrics[0, METRIC_INDEX["aileron_rms_deg"]] > 0.1
    commands = np.array(
        [channels[f"{name}_command_deg"] for name in ("left", "right", "flap", "rudder_effector")]
    )
    np.testing.assert_allclose(
        channels["elevator_command_deg"], (np.linalg.pinv(MIX) @ commands)[2], atol=1e-5
    )
    for name, row in (("left", deflections[0]), ("flap", deflections[2])):
        usage = {
            end: block.metrics[0, names[f"{name}_{end}"]]
            for end in ("rms_deg", "max_deg", "travel_deg")
        }
        assert usage["rms_deg"] == pytest.approx(np.sqrt(np.mean(row**2)), rel=1e-5)
        assert usage["max_deg"] == pytest.approx(np.abs(row).max(), rel=1e-5)
        assert usage["travel_deg"] == pytest.approx(np.abs(np.diff(row)).sum(), rel=1e-4)
    assert block.metrics[0, names["flap_saturation_s"]] == 0.0
