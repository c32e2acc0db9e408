"""A control law of one's own: a cascade of loops for path, attitude and body rates.

A flight calls ``law`` at every control tick. What it names as an argument it gets: ``measured``
(what the sensors say), ``reference`` (the mission), ``memory``, ``settings``, ``gains``,
``onboard`` (the nominal vehicle), ``time``, ``dt``. Everything is a number in SI and radians. See
docs/tutorials/own-controller.md.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.signal import place_poles

from abhv_mc.extend import Command, clamp, controller, cos, wrap

GRAVITY = 9.73  # m/s2, at 20 km
WEIGHTS = np.diag(
    [1.0, 10.0, 0.1, 0.1]
)  # of bank, sideslip, roll and yaw rate; aileron and rudder have 10 each


class Settings(NamedTuple):
    """What the YAML file beside this one may set; without it these hold."""

    path: float = 2.0  # 1/s, flight path angle to angle of attack
    altitude: float = 0.1  # 1/s, altitude to flight path angle
    heading: float = 0.2  # 1/s, heading to bank
    speed: float = 0.06  # s/m, speed to equivalence ratio
    bank_limit: float = 1.2  # rad


class Memory(NamedTuple):
    """What the law keeps from tick to tick: it starts with these values, one set a flight."""

    altitude: float = 0.0  # integral of the altitude error, m s
    speed: float = 0.0  # integral of the speed error, m


class Gains(NamedTuple):
    """Values that ``design`` computes before the campaign.

    Each is an array [tick] or one number.
    """

    elevator_by_angle_of_attack: np.ndarray
    elevator_by_pitch_rate: np.ndarray
    aileron_by_bank: np.ndarray
    aileron_by_sideslip: np.ndarray
    aileron_by_roll_rate: np.ndarray
    aileron_by_yaw_rate: np.ndarray
    rudder_by_bank: np.ndarray
    rudder_by_sideslip: np.ndarray
    rudder_by_roll_rate: np.ndarray
    rudder_by_yaw_rate: np.ndarray


def design(model, settings):
    """Gains along the mission.

    Runs once, as plain Python: any library may be used here, and only here.
    """
    times = np.arange(0.0, model.time[-1] + 5.0, 5.0)
    rows = []
    for time in times:
        plant = model.linearize(time)
        A, B = plant.take(("angle_of_attack", "pitch_rate"), ("elevator",))
        pitch = place_poles(A, B, [-2.5 + 2.0j, -2.5 - 2.0j]).gain_matrix
        A, B = plant.take(("bank", "sideslip", "roll_rate", "yaw_rate"), ("aileron", "rudder"))
        lateral = (
            B.T @ solve_continuous_are(A, B, WEIGHTS, 10.0 * np.eye(2)) / 10.0
        )  # an LQR, for its margins
        rows.append([*pitch.ravel(), *lateral.ravel()])
    return Gains(*(np.interp(model.time, times, column) for column in np.transpose(rows)))


@controller(units={"path": "1/s", "altitude": "1/s", "heading": "1/s", "bank_limit": "rad"})
def law(measured, reference, memory, settings, gains, dt):
    """One tick of one flight.

    Compiled: numbers and named tuples only, no lists, prints or imports in here.
    """
    # Path: altitude to flight path angle, that to angle of attack; heading to bank; speed to
    # equivalence ratio.
    rise = measured.altitude - reference.altitude
    speed = measured.speed - reference.speed
    path_cmd = (
        reference.flight_path_angle
        - settings.altitude * (rise + 0.05 * memory.altitude) / measured.speed
    )
    alpha = reference.angle_of_attack - settings.path * (measured.flight_path_angle - path_cmd)
    alpha = clamp(alpha, -0.01, 0.2)
    turn = -settings.heading * wrap(measured.heading - reference.heading)
    bank = reference.bank + turn * measured.speed / GRAVITY * cos(reference.bank) * cos(
        reference.bank
    )
    bank = clamp(bank, -settings.bank_limit, settings.bank_limit)
    eta = reference.equivalence_ratio - settings.speed * (speed + 0.1 * memory.speed)

    # Attitude and rates: state feedback about the coordinated turn.
    weight = GRAVITY / measured.speed
    turning = weight * bank  # rad/s, about the vertical, small angles
    alpha_error = measured.angle_of_attack - alpha
    bank_error = wrap(measured.bank - bank)
    pitch = measured.pitch_rate - turning * bank
    yaw = measured.yaw_rate - turning
    beta, roll = measured.sideslip, measured.roll_rate
    elevator = (
        reference.elevator
        - gains.elevator_by_angle_of_attack * alpha_error
        - gains.elevator_by_pitch_rate * pitch
    )
    aileron = -(
        gains.aileron_by_bank * bank_error
        + gains.aileron_by_sideslip * beta
        + gains.aileron_by_roll_rate * roll
        + gains.aileron_by_yaw_rate * yaw
    )
    rudder = -(
        gains.rudder_by_bank * bank_error
        + gains.rudder_by_sideslip * beta
        + gains.rudder_by_roll_rate * roll
        + gains.rudder_by_yaw_rate * yaw
    )
    # The commands, kept within the vehicle's limits for you. The last three are what the report
    # compares with.
    command = Command(
        aileron, rudder, elevator, eta, flight_path_angle=path_cmd, angle_of_attack=alpha, bank=bank
    )
    return command, Memory(
        clamp(memory.altitude + dt * rise, -1000.0, 1000.0),
        clamp(memory.speed + dt * speed, -100.0, 100.0),
    )
