"""Control law with altitude, heading and speed loops, attitude feedback and rate damping."""

from typing import NamedTuple

from abhv_mc.extend import Command, clamp, controller, wrap


class Settings(NamedTuple):
    """Settings in the controller file, with default values."""

    altitude: float = 0.2  # 1/s, gain on the altitude error
    path: float = 0.9  # dimensionless gain on the flight path angle error
    bank_limit: float = 1.2  # rad


class Memory(NamedTuple):
    """Values that the law keeps between control ticks, with initial values."""

    speed_error: float = 0.0  # m, integral of the speed error


@controller(units={"altitude": "1/s", "bank_limit": "rad"})
def law(measured, reference, memory, settings, dt):
    """Return the commands and the new memory for one control tick."""
    # The altitude error sets the flight path angle, which sets the angle of attack. The heading
    # error sets the bank angle.
    rise = measured.altitude - reference.altitude
    path = reference.flight_path_angle - settings.altitude * rise / measured.speed
    alpha = reference.angle_of_attack - settings.path * (measured.flight_path_angle - path)
    alpha = clamp(alpha, -0.02, 0.2)
    turn = wrap(reference.heading - measured.heading)
    bank = clamp(reference.bank + 3.0 * turn, -settings.bank_limit, settings.bank_limit)

    # The surfaces control the attitude and damp the rates. A positive elevator pitches down, a
    # positive aileron rolls right, and a positive rudder yaws left.
    elevator = reference.elevator + 2.0 * (measured.angle_of_attack - alpha)
    elevator = elevator + 0.8 * measured.pitch_rate
    aileron = 0.3 * (bank - measured.bank) - 0.15 * measured.roll_rate
    rudder = 0.5 * measured.yaw_rate - 1.0 * measured.sideslip

    # A proportional-integral controller of the speed sets the equivalence ratio.
    error = reference.speed - measured.speed
    speed_error = clamp(memory.speed_error + dt * error, -500.0, 500.0)
    throttle = reference.equivalence_ratio + 0.05 * error + 0.005 * speed_error

    command = Command(
        aileron,
        rudder,
        elevator,
        throttle,
        flight_path_angle=path,
        angle_of_attack=alpha,
        bank=bank,
    )
    return command, Memory(speed_error)
