"""Control law: guidance by altitude, heading and speed; attitude feedback and rate damping."""

from typing import NamedTuple

from abhv_mc.extend import Command, clamp, controller, wrap


class Settings(NamedTuple):
    """Settings from the YAML file, with their defaults."""

    altitude: float = 0.2  # 1/s
    path: float = 0.9
    bank_limit: float = 1.2  # rad


class Memory(NamedTuple):
    """Values kept between ticks, with their initial values."""

    speed_error: float = 0.0  # m, integral of the speed error


@controller(units={"altitude": "1/s", "bank_limit": "rad"})
def law(measured, reference, memory, settings, dt):
    """Return the commands of one control tick."""
    # Altitude to flight path angle to angle of attack; heading to bank.
    rise = measured.altitude - reference.altitude
    path = reference.flight_path_angle - settings.altitude * rise / measured.speed
    alpha = reference.angle_of_attack - settings.path * (measured.flight_path_angle - path)
    alpha = clamp(alpha, -0.02, 0.2)
    turn = wrap(reference.heading - measured.heading)
    bank = clamp(reference.bank + 3.0 * turn, -settings.bank_limit, settings.bank_limit)

    # Attitude and rates to surfaces: + elevator pitches down, + aileron rolls right, + rudder yaws
    # left.
    elevator = reference.elevator + 2.0 * (measured.angle_of_attack - alpha)
    elevator = elevator + 0.8 * measured.pitch_rate
    aileron = 0.3 * (bank - measured.bank) - 0.15 * measured.roll_rate
    rudder = 0.5 * measured.yaw_rate - 1.0 * measured.sideslip

    # Speed to equivalence ratio, proportional and integral.
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
