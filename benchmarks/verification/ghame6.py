"""Replay of a CADAC++ GHAME6 flight (Zipfel) with its deflections and throttle.

Frames: I is inertial; E rotates with the Earth (x through the equator at longitude 0, z through the
north pole) and coincides with I at time 0; N is local north, east, down.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from abhv_mc.array_types import Floats
from abhv_mc.flights.timing import Timing
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX, Vehicle
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.check_rows import Row
from benchmarks.verification.fly_recording import (
    check_times,
    make_motion,
    make_replay_plan,
    read_columns,
    replay,
    wrap_degrees,
)

# Earth of CADAC++: flattening, and J2 from the normalised C20. The meridional part of the J2
# acceleration in the output of CADAC++ has the wrong sign.
CADAC_EARTH = Earth(
    6378137.0, 3.33528106e-3, 3.9860044e14, 4.8416685e-4 * np.sqrt(5.0), 7.292115e-5, -1.0
)
# Ratio of the air density in CADAC++ (column rho) to the standard density at 20 km.
CADAC_DENSITY = 1.0 / 1.0000134861
FULL_MASS = 136077.0  # mass in kg with full tanks
LONGEST_STEP = 0.01  # maximum integration step in s

POSITION = [f"sbii{i}" for i in (1, 2, 3)]  # inertial position in m
VELOCITY = [f"vbii{i}" for i in (1, 2, 3)]  # inertial velocity in m/s
ATTITUDE = [
    f"tbi{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)
]  # rotation from inertial to body axes
RATES = [f"wbib{i}" for i in (1, 2, 3)]  # inertial body rates in rad/s
# aileron, rudder and elevator in deg, and dimensionless throttle
CONTROLS = ["delax", "delrx", "delex", "throttle"]
COMPARED = ["alt", "dvbe", "thtvdx", "alphax", "betax"]

# Differences in an independent replay (DOP853, rtol 1e-10); the tolerances are three times these
# differences.
_REPLAYED = {
    "altitude": ("m", 0.03),
    "speed": ("m/s", 0.0009),
    "flight_path_angle": ("deg", 5e-5),
    "angle_of_attack": ("deg", 4e-5),
    "sideslip": ("deg", 2.4e-4),
    "bank": ("deg", 1.1e-3),
    "roll_rate": ("deg/s", 1.3e-3),
    "pitch_rate": ("deg/s", 6e-5),
    "yaw_rate": ("deg/s", 8e-4),
    "fuel": ("kg", 0.011),
}


@dataclass(frozen=True)
class Recording:
    """Recorded flight in the quantities of abhv-mc, in SI units and radians."""

    times: Floats
    states: Floats  # [time, state] without surfaces and engine
    controls: Floats  # [time, 4] aileron, rudder, elevator, equivalence ratio
    published: dict[str, Floats]  # compared columns in the units of the file


def read_recording(path: Path) -> Recording:
    """Read an evenly spaced time history of CADAC++ GHAME6.

    Raise InputError if the file is invalid.
    """
    needed = ["time", *POSITION, *VELOCITY, *ATTITUDE, *RATES, *CONTROLS, *COMPARED]
    table = read_columns(path, needed, ["vmass", "fmasse"])
    if "vmass" not in table and "fmasse" not in table:
        raise InputError(
            path,
            "the column vmass is missing",
            "the column vmass, or fmasse (mass of the burnt fuel)",
        )
    times = np.array(table["time"])
    check_times(path, times, uniform=True)

    turn = Rotation.from_euler(
        "z", -CADAC_EARTH.rotation_rate * times[:, np.newaxis]
    )  # rotation from I to E
    position = turn.apply(np.array(table[POSITION]))
    carried = np.cross([0.0, 0.0, CADAC_EARTH.rotation_rate], position)
    latitude, longitude, altitude = geodetic_from_ecef(CADAC_EARTH, position)
    ned_from_earth = ned_from_ecef_matrix(latitude, longitude)
    velocity_ned = np.einsum(
        "tij,tj->ti", ned_from_earth, turn.apply(np.array(table[VELOCITY])) - carried
    )
    inertial_from_body = np.swapaxes(np.array(table[ATTITUDE]).reshape(-1, 3, 3), -1, -2)
    ned_from_body = ned_from_earth @ turn.as_matrix() @ inertial_from_body

    states = np.zeros((times.size, s.N_STATES))
    states[:, s.ALTITUDE], states[:, s.LONGITUDE], states[:, s.LATITUDE] = (
        altitude,
        longitude,
        latitude,
    )
    states[:, s.U : s.W + 1] = np.einsum("tji,tj->ti", ned_from_body, velocity_ned)
    states[:, s.Q0 : s.Q3 + 1] = Rotation.from_matrix(ned_from_body).as_quat(
        canonical=True, scalar_first=True
    )
    states[:, s.ROLL_RATE : s.YAW_RATE + 1] = table[RATES]
    states[:, s.MASS] = table["vmass"] if "vmass" in table else FULL_MASS - table["fmasse"]
    controls = np.array(table[CONTROLS])
    controls[:, :3] = np.radians(controls[:, :3])
    return Recording(times, states, controls, {name: np.array(table[name]) for name in COMPARED})


def geodetic_from_ecef(earth: Earth, position: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Convert positions [..., 3] in E (m) to geodetic latitude, longitude and altitude.

    Bowring's iteration of the reduced latitude (Survey Review 23 (1976) 323) is accurate to
    rounding: a few 1e-9 m near the ground, where a double resolves 1e-9 m. The longitude of points
    on the Earth's axis is 0.
    """
    x, y, z = np.moveaxis(np.asarray(position, dtype=np.float64), -1, 0)
    a, f = earth.equatorial_radius, earth.flattening
    b = a * (1.0 - f)
    e2 = f * (2.0 - f)
    second_e2 = e2 / (1.0 - e2)
    rho = np.hypot(x, y)
    sin_lat, cos_lat = _unit(z, (1.0 - e2) * rho)
    for _ in range(20):
        sin_reduced, cos_reduced = _unit((1.0 - f) * sin_lat, cos_lat)
        before = sin_lat, cos_lat
        sin_lat, cos_lat = _unit(z + second_e2 * b * sin_reduced**3, rho - e2 * a * cos_reduced**3)
        if np.all(np.abs(sin_lat * before[1] - cos_lat * before[0]) < 1e-16):
            break
    altitude = rho * cos_lat + z * sin_lat - a * np.sqrt(1.0 - e2 * sin_lat**2)
    return np.arctan2(sin_lat, cos_lat), np.arctan2(y, x), altitude


def _unit(y: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return the sine and cosine of the polar angle of the point (x, y)."""
    length = np.hypot(x, y)
    return y / length, x / length


def ned_from_ecef_matrix(latitude: ArrayLike, longitude: ArrayLike) -> Floats:
    """Return C_NE [..., 3, 3], the rotation from E to local north, east, down."""
    latitude, longitude = np.broadcast_arrays(latitude, longitude)
    sin_lat, cos_lat, sin_lon, cos_lon = (
        np.sin(latitude),
        np.cos(latitude),
        np.sin(longitude),
        np.cos(longitude),
    )
    rows = (
        (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
        (-sin_lon, cos_lon, 0.0 * latitude),
        (-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def verify_ghame6(path: Path, scale: float = 1.0) -> list[Row]:
    """Replay a recorded flight and return verification rows; `scale` multiplies tolerances."""
    recording = read_recording(path)
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "ghame.yaml")
    flown = fly_recording(vehicle, recording)
    ours, theirs = _quantities(flown), _quantities(recording.states)
    published = recording.published
    # CADAC++ computes altitude by a truncated series; remove the initial offset.
    theirs["altitude"] = published["alt"] - published["alt"][0] + ours["altitude"][0]
    theirs["speed"] = published["dvbe"]
    theirs["flight_path_angle"] = published["thtvdx"]
    theirs["angle_of_attack"] = published["alphax"]
    theirs["sideslip"] = published["betax"]
    rows = []
    for name, (unit, difference) in _REPLAYED.items():
        error = ours[name] - theirs[name]
        if unit == "deg":
            error = wrap_degrees(error)
        rows.append(
            Row(
                path.name,
                "CADAC++",
                name,
                unit,
                float(np.abs(error).max()),
                3.0 * scale * difference,
            )
        )
    return rows


def fly_recording(vehicle: Vehicle, recording: Recording) -> Floats:
    """Simulate with the recorded controls and return the states [time, state]."""
    times = recording.times
    spacing = float(times[-1] - times[0]) / (times.size - 1)
    steps = max(1, int(np.ceil(spacing / LONGEST_STEP - 1e-6)))
    timing = Timing(spacing / steps, steps, times.size - 1)
    parameters = nominal_parameters()[0]
    published, exact = float(recording.published["alt"][0]), float(recording.states[0, s.ALTITUDE])
    density = CADAC_DENSITY * atmosphere(published)[0] / atmosphere(exact)[0]
    parameters[PARAMETER_INDEX["atmosphere.density"]] = density
    plan = make_replay_plan(vehicle, CADAC_EARTH, recording.states[0], recording.controls, timing)
    return replay(plan, parameters)


def _quantities(states: Floats) -> dict[str, Floats]:
    """Return the compared quantities, in degrees, for states [time, state] without wind."""
    motion = make_motion(states)
    north, east, down = motion.velocity_ned.T
    u, v, w = states[:, s.U : s.W + 1].T
    speed = np.sqrt(u * u + v * v + w * w)
    alpha, beta = np.arctan2(w, u), np.arcsin(v / speed)
    # Bank is the roll angle of the wind axes (x along the velocity).
    wind_from_body = Rotation.from_euler("YZ", np.stack([alpha, -beta], axis=-1))
    wind = Rotation.from_quat(states[:, s.Q0 : s.Q3 + 1], scalar_first=True) * wind_from_body.inv()
    return {
        "altitude": motion.altitude,
        "speed": speed,
        "flight_path_angle": np.degrees(np.arctan2(-down, np.hypot(north, east))),
        "angle_of_attack": np.degrees(alpha),
        "sideslip": np.degrees(beta),
        "bank": np.degrees(wind.as_euler("ZYX")[:, 2]),
        "roll_rate": np.degrees(motion.rates[:, 0]),
        "pitch_rate": np.degrees(motion.rates[:, 1]),
        "yaw_rate": np.degrees(motion.rates[:, 2]),
        "fuel": states[0, s.MASS] - motion.mass,
    }
