"""Invariants of a flight without forces: energy, angular momentum, unit quaternion."""

import numpy as np
from scipy.spatial.transform import Rotation
from verification.shown import check

from abhv_mc.flights.timing import Timing
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_fixed, make_variables
from benchmarks.verification.check_rows import Row
from benchmarks.verification.fly_recording import make_replay_plan, make_start, replay
from benchmarks.verification.ghame6 import ned_from_ecef_matrix

STEP, TICKS = 0.01, 6000
_RATES = tuple(np.radians((10.0, 20.0, 30.0)))


def test_invariants():
    """Simulate a GHAME tumbling through the vacuum for 60 s.

    Its inertia matrix is full.
    """
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "ghame.yaml")
    states = fly_in_vacuum(vehicle, STEP, TICKS)
    times = np.linspace(0.0, STEP * TICKS, TICKS + 1)
    position, velocity, body = to_inertial(states, times)
    inertia = _inertia(vehicle)
    rates = states[:, s.ROLL_RATE : s.YAW_RATE + 1]
    momentum = np.einsum("tij,tj->ti", body, rates @ inertia)

    quantities = {
        "energy of the motion": (orbital_energy(position, velocity), 1e-9),
        "polar angular momentum of the motion": (np.cross(position, velocity)[:, 2], 1e-9),
        "energy of the rotation": (0.5 * np.einsum("ti,ij,tj->t", rates, inertia, rates), 1e-9),
        "angular momentum in inertial axes": (momentum, 1e-9),
        "quaternion norm": (np.linalg.norm(states[:, s.Q0 : s.Q3 + 1], axis=1), 1e-14),
    }
    check(
        [
            Row("no forces", "conserved", name, "relative", _drift(values), tolerance)
            for name, (values, tolerance) in quantities.items()
        ]
    )


def fly_in_vacuum(vehicle, step, ticks):
    """States ``[tick, state]`` without air or engine, from 20 km, 1400 m/s, tumbling."""
    start = make_start(
        20e3, (600.0, 1200.0, -300.0), 1.0, _RATES, vehicle.constants.mass_start, latitude=0.5
    )
    parameters = nominal_parameters()[0]
    parameters[PARAMETER_INDEX["atmosphere.density"]] = 0.0
    plan = make_replay_plan(vehicle, WGS84, start, np.zeros((ticks + 1, 4)), Timing(step, 1, ticks))
    return replay(plan, parameters)


def ecef_from_geodetic(earth, latitude, longitude, altitude):
    """Position ``[..., 3]``, m, in E of a geodetic latitude, longitude and altitude."""
    latitude, longitude, altitude = np.broadcast_arrays(latitude, longitude, altitude)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    e2 = earth.flattening * (2.0 - earth.flattening)
    prime_vertical = earth.equatorial_radius / np.sqrt(1.0 - e2 * sin_lat**2)
    rho = (prime_vertical + altitude) * cos_lat
    z = (prime_vertical * (1.0 - e2) + altitude) * sin_lat
    return np.stack([rho * np.cos(longitude), rho * np.sin(longitude), z], axis=-1)


def to_inertial(states, times):
    """Return inertial position, velocity ``[time, 3]`` and body axes ``[time, 3, 3]``.

    The axes are inertial from body; the Earth is WGS-84.
    """
    latitude, longitude = states[:, s.LATITUDE], states[:, s.LONGITUDE]
    ned_from_body = Rotation.from_quat(states[:, s.Q0 : s.Q3 + 1], scalar_first=True).as_matrix()
    earth_from_ned = np.swapaxes(ned_from_ecef_matrix(latitude, longitude), -1, -2)
    earth_from_body = earth_from_ned @ ned_from_body
    position = ecef_from_geodetic(WGS84, latitude, longitude, states[:, s.ALTITUDE])
    velocity = np.einsum("tij,tj->ti", earth_from_body, states[:, s.U : s.W + 1])
    turn = Rotation.from_euler("z", (WGS84.rotation_rate * times)[:, np.newaxis])
    carried = np.cross([0.0, 0.0, WGS84.rotation_rate], position)
    return turn.apply(position), turn.apply(velocity + carried), turn.as_matrix() @ earth_from_body


def orbital_energy(position, velocity):
    """Return the energy in the central and J2 field, J/kg.

    It is the sum of kinetic and potential energy, from inertial motion ``[time, 3]``.
    """
    r = np.linalg.norm(position, axis=1)
    p2 = 1.5 * (position[:, 2] / r) ** 2 - 0.5
    potential = (
        -WGS84.gravitational_parameter
        / r
        * (1.0 - WGS84.j2 * (WGS84.equatorial_radius / r) ** 2 * p2)
    )
    return np.asarray(0.5 * np.einsum("ti,ti->t", velocity, velocity) + potential)


def _inertia(vehicle):
    """Inertia matrix at the start."""
    fixed = evaluate_fixed(vehicle, make_variables(vehicle, mass=vehicle.constants.mass_start))
    xx, yy, zz, xz = (float(fixed[f"inertia_{name}"][0]) for name in ("xx", "yy", "zz", "13"))
    return np.array([[xx, 0.0, xz], [0.0, yy, 0.0], [xz, 0.0, zz]])


def _drift(values):
    """Largest change since the start, relative to the start."""
    change = np.atleast_2d((values - values[0]).T)
    return float(np.linalg.norm(change, axis=0).max() / np.linalg.norm(values[0]))
