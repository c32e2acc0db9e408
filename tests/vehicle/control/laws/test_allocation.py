"""Compiled moment and its slopes against the design model, with slopes by complex steps."""

from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abhv_mc_vehicle.control.design.design_model import Environment, slope, wrench_at
from abhv_mc_vehicle.kernel.flight.interface import UserCode
from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.laws.allocation import moment_slope, nominal_moment, side_force_slope
from abhv_mc_vehicle.kernel.laws.tlc import N_ROWS, SLOPES, nominal_vehicle
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import INPUTS, N_INPUTS, make_cells
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.vehicle.file import pack_vehicle, read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import make_variables

# Parts of the kernel's plan and memory that the nominal vehicle needs.
Plan = namedtuple("Plan", "vehicle effectiveness unit_factors user_code")
Memory = namedtuple("Memory", "Z T cells high")
CONFIGS = Path(__file__).parents[4] / "configs" / "vehicle"
N = 24
AIR = Environment(22e3, 0.0646, 296.4, 9.74, 6.4e6, 0.0)
_CAPACITY = N
_NO_FUNCTIONS = UserCode(0, 0, 0, 0)
_Z_ROWS = s.LAW + N_ROWS
# side force is the third coefficient
_SIDE_BY_SIDESLIP = SLOPES + INPUTS.index("sideslip") + 2 * N_INPUTS


@kernel
def compute(vehicle, effectiveness, cells, width, variables, density, speed, moments, slopes, side):
    """Compute moments [axis, lane], slopes [axis, deflection, lane] and CY by sideslip [lane]."""
    Z = np.zeros((_Z_ROWS, _CAPACITY))
    T = np.zeros((s.MAX_TABLE_ROWS, _CAPACITY))
    high = np.empty(s.MAX_TABLE_ROWS)
    unit_factors = np.zeros(vehicle.build_up.factor.size, dtype=np.int64)
    for lane in range(width):
        Z[s.P, lane] = 1.0
        for i in range(s.N_VARIABLES):
            Z[s.VAR + i, lane] = variables[i, lane]
    nominal_vehicle(
        Plan(vehicle, effectiveness, unit_factors, _NO_FUNCTIONS),
        Memory(Z, T, cells, high),
        width,
        None,
    )
    for lane in range(width):
        q_bar = 0.5 * density * speed[lane] * speed[lane]
        moments[0, lane], moments[1, lane], moments[2, lane] = nominal_moment(
            Z, lane, vehicle.constants, density, q_bar, speed[lane]
        )
        for d in range(3):
            x, y, z = moment_slope(Z, lane, vehicle.constants, q_bar, SLOPES, d)
            slopes[0, d, lane], slopes[1, d, lane], slopes[2, d, lane] = x, y, z
        side[lane] = Z[_SIDE_BY_SIDESLIP, lane]


def draw_points(vehicle, mach):
    """Draw points inside of cells."""
    generator = np.random.default_rng(7)
    spread = {
        "angle_of_attack": (0.0, 0.15),
        "sideslip": (-0.05, 0.05),
        "equivalence_ratio": (0.3, 1.4),
    }
    spread |= dict.fromkeys(("aileron", "rudder", "elevator"), (-0.14, 0.14))
    spread |= dict.fromkeys(("roll_rate_hat", "pitch_rate_hat", "yaw_rate_hat"), (-1e-3, 1e-3))
    points = {name: generator.uniform(*ends, N) for name, ends in {"mach": mach, **spread}.items()}
    return points | {
        "altitude": np.full(N, AIR.altitude),
        "mass": np.full(N, 0.9 * vehicle.constants.mass_start),
    }


def wrench_of(vehicle, point, sideslip, deflections):
    speed = point["mach"] * AIR.sound_speed
    half_span, half_chord = (
        vehicle.constants.span / (2.0 * speed),
        vehicle.constants.chord / (2.0 * speed),
    )
    rates = (
        point["roll_rate_hat"] / half_span,
        point["pitch_rate_hat"] / half_chord,
        point["yaw_rate_hat"] / half_span,
    )
    zero = np.atleast_1d(0.0 * sideslip + 0.0 * deflections[0])  # of the points' shape
    alpha, eta = point["angle_of_attack"] + zero, point["equivalence_ratio"] + zero
    return wrench_at(
        vehicle, AIR, point["mass"], speed, alpha, sideslip + zero, rates, deflections, eta
    )


def load(name, *, off_axis):
    """Load a shipped vehicle.

    ``off_axis`` moves its centre of gravity and sets drag in wind axes.
    """
    file = read_vehicle_file(CONFIGS / f"{name}.yaml")
    if not off_axis:
        return pack_vehicle(file, PARAMETER_INDEX)
    moved = {"center_of_gravity_x": -1.3, "center_of_gravity_z": 0.7}
    points = tuple(point.model_copy(update=moved) for point in file.mass_points)
    vehicle = pack_vehicle(replace(file, mass_points=points), PARAMETER_INDEX)
    return vehicle._replace(constants=vehicle.constants._replace(drag_in_wind_axes=1.0))


def look_at(vehicle, point):
    """Return moments, their slopes and the slope of CY by :func:`compute`."""
    moments, slopes, side = np.empty((3, N)), np.empty((3, 3, N)), np.empty(N)
    effectiveness, cells = make_effectiveness(vehicle), make_cells(_CAPACITY)
    variables, speed = make_variables(vehicle, **point), point["mach"] * AIR.sound_speed
    compute(vehicle, effectiveness, cells, N, variables, AIR.density, speed, moments, slopes, side)
    return moments, slopes, side


@pytest.mark.parametrize("off_axis", [False, True])
@pytest.mark.parametrize("name", ["ghame_x_coupled", "winged_cone"])
def test_moment_effectiveness_and_side_force_slope_are_the_design_models(name, off_axis):
    vehicle = load(name, off_axis=off_axis)
    point = draw_points(vehicle, (4.1, 14.5))
    moments, slopes, _ = look_at(vehicle, point)

    deflections = np.stack([point[axis] for axis in INPUTS[:3]])
    expected = wrench_of(vehicle, point, point["sideslip"], deflections).moment
    scale = np.abs(expected).max()
    assert moments == pytest.approx(expected, rel=1e-10, abs=1e-10 * scale)

    for lane in range(N):
        lane_point = {key: value[lane] for key, value in point.items()}
        jacobian = slope(
            lambda x, lane_point=lane_point: (
                wrench_of(vehicle, lane_point, lane_point["sideslip"], x).moment
            ),
            deflections[:, lane],
        )
        assert slopes[:, :, lane] == pytest.approx(
            jacobian, rel=1e-9, abs=1e-9 * np.abs(jacobian).max()
        )

    # The slope of the side force without sideslip, thrust, aileron and rudder.
    point |= dict.fromkeys(("sideslip", "equivalence_ratio", "aileron", "rudder"), np.zeros(N))
    _, _, side = look_at(vehicle, point)

    for lane in range(N):
        lane_point = {key: value[lane] for key, value in point.items()}
        alpha = lane_point["angle_of_attack"]
        deflections = np.array([0.0, 0.0, lane_point["elevator"]])

        def wind_side_force(x, lane_point=lane_point, alpha=alpha, deflections=deflections):
            force = wrench_of(
                vehicle, lane_point, x[0], deflections[:, None] + 0.0 * x
            ).force  # eta 0: no thrust
            forward = force[0] * np.cos(alpha) + force[2] * np.sin(alpha)
            return np.stack([force[1] * np.cos(x[0]) - forward * np.sin(x[0])])

        expected = slope(wind_side_force, [0.0])[0, 0]
        force = wrench_of(vehicle, lane_point, 0.0, deflections).force[:, 0]
        q_s = (
            0.5 * AIR.density * (lane_point["mach"] * AIR.sound_speed) ** 2 * vehicle.constants.area
        )
        drag = -(force[0] * np.cos(alpha) + force[2] * np.sin(alpha)) / q_s
        assert side_force_slope(vehicle.constants, q_s, side[lane], drag) == pytest.approx(
            expected, rel=1e-9
        )
