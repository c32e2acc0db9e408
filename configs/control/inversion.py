"""Dynamic inversion with the nominal vehicle as the on-board model.

It computes the moments that give the desired body rates.
"""

from typing import NamedTuple

from abhv_mc.extend import Command, allocate, clamp, controller, cos, sin, wrap

GRAVITY = 9.73  # m/s2, at 20 km


class Settings(NamedTuple):
    """What the YAML file may set."""

    path: float = 0.35  # bandwidths, rad/s
    attitude: float = 2.0
    rates: float = 6.0
    bank_limit: float = 1.2  # rad


class Memory(NamedTuple):
    """What is kept from tick to tick."""

    altitude: float = 0.0  # integral of the altitude error, m s


@controller(units={"path": "rad/s", "attitude": "rad/s", "rates": "rad/s", "bank_limit": "rad"})
def law(measured, reference, memory, settings, onboard, dt):
    """One tick of one flight."""
    # Path: the flight path and heading wanted, and the lift and bank that turn the velocity so.
    rise = measured.altitude - reference.altitude
    speed = measured.speed - reference.speed
    w = settings.path
    path_cmd = (
        reference.flight_path_angle - (0.3 * w * rise + 0.02 * w * memory.altitude) / measured.speed
    )
    path = measured.flight_path_angle - path_cmd
    turn = reference.heading_rate - w * wrap(measured.heading - reference.heading)
    bank = (
        reference.bank
        + (turn - reference.heading_rate) * measured.speed / GRAVITY * cos(reference.bank) ** 2
    )
    bank = clamp(bank, -settings.bank_limit, settings.bank_limit)
    force = reference.mass * measured.speed * (-w * path) / cos(bank)
    slope = onboard.lift_by_angle_of_attack + onboard.thrust
    alpha = clamp(reference.angle_of_attack + force / slope, -0.01, 0.2)
    eta = (
        reference.equivalence_ratio
        - 0.3 * reference.mass * speed / onboard.thrust_by_equivalence_ratio
    )

    # Attitude: body rates that bring angle of attack, sideslip and bank to their commands.
    weight = GRAVITY / measured.speed
    roll = -settings.attitude * wrap(measured.bank - bank)  # about the velocity
    p = roll * cos(alpha) - weight * sin(bank) * sin(alpha)
    q = -settings.attitude * (measured.angle_of_attack - alpha) + weight * sin(bank) ** 2 / cos(
        bank
    )
    r = roll * sin(alpha) + weight * sin(bank) * cos(alpha) + settings.attitude * measured.sideslip

    # Moments that bring the rates there, less those that the last command gives.
    inertia, k = onboard.inertia, settings.rates
    dp, dq, dr = (
        k * (p - measured.roll_rate),
        k * (q - measured.pitch_rate),
        k * (r - measured.yaw_rate),
    )
    aileron, rudder, elevator = allocate(
        onboard,
        inertia.xx * dp + inertia.xz * dr - onboard.moment.roll,
        inertia.yy * dq - onboard.moment.pitch,
        inertia.xz * dp + inertia.zz * dr - onboard.moment.yaw,
    )
    return Command(
        onboard.last.aileron + aileron,
        onboard.last.rudder + rudder,
        onboard.last.elevator + elevator,
        eta,
        path_cmd,
        alpha,
        bank,
    ), Memory(clamp(memory.altitude + dt * rise, -2000.0, 2000.0))
