"""Gains of TLC along the reference: sub-loops 1 and 2, and PD spectra of loops 3 and 4.

The equations are (5)-(11) and (20) of Zhu and Shen 2014. Gains of sub-loops 3 and 4 are computed in
flight by :mod:`abhv_mc_vehicle.kernel.laws.tlc_loops`.
"""

from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc_vehicle.control.controller_file import Channel, CommandLimits, Schedule, TlcController
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.vehicle.actuators import axis_limits
from abhv_mc_vehicle.vehicle.vehicle_code import make_variables, table_rows

# condition number of B above which the effect of an input is only a rounding error
_LARGEST_CONDITION = 1e12


def make_tlc_settings(controller: TlcController, vehicle: Vehicle) -> Floats:
    """Return the constants of TLC in the order of TLC_SETTINGS."""
    differentiators = controller.differentiators
    limits = make_limit_settings(controller.limits, vehicle)
    return np.array([differentiators.attitude, differentiators.rates, *limits])


def make_limit_settings(limits: CommandLimits, vehicle: Vehicle) -> Floats:
    """Return the command limits, which are the last settings of both TLC and LQR."""
    return np.array([*limits.angle_of_attack, limits.bank, *axis_limits(vehicle)])


def make_tlc_gains(
    controller: TlcController, reference: Floats, vehicle: Vehicle, trim_tables: Tables
) -> Floats:
    """Return gains ``[tick, gain]`` in the order of TLC_GAINS, given the reference."""
    column = dict(zip(REFERENCE, reference.T, strict=True))
    pressure = 0.5 * column["density"] * column["speed"] ** 2

    def spectrum(channel: Channel) -> tuple[Floats, Floats]:
        return pd_spectrum(channel, column["time"], pressure)

    a1, a2 = spectrum(controller.altitude)
    forward = column["speed"] * np.cos(column["flight_path_angle"])
    A, B = velocity_loop(reference, vehicle, trim_tables)
    K2 = velocity_gains(A, B, [spectrum(channel) for _, channel in controller.velocity])
    online = [
        spectrum(channel) for loop in (controller.attitude, controller.rates) for _, channel in loop
    ]
    columns = [a1 / forward, a2 / forward, *K2.reshape(len(reference), -1).T]
    columns += [gain for pair in online for gain in pair]
    return np.ascontiguousarray(np.stack(columns, axis=1))


def pd_spectrum(channel: Channel, times: Floats, dynamic_pressure: Floats) -> tuple[Floats, Floats]:
    """Return equation (20) at each tick: ``a1 = wn^2`` and ``a2 = 2 zeta wn - wn'/wn``.

    ``wn'`` is the one-sided derivative after the tick.
    """
    if not isinstance(channel.bandwidth, Schedule):
        wn = np.full(times.size, channel.bandwidth)
        return wn**2, 2.0 * channel.damping * wn
    points = np.array(channel.bandwidth.points())
    abscissa = times if channel.bandwidth.over_time is not None else dynamic_pressure
    wn = np.interp(abscissa, points[:, 0], points[:, 1])
    if channel.bandwidth.over_time is not None:
        cell = np.clip(
            np.searchsorted(points[:, 0], abscissa, side="right") - 1, 0, len(points) - 2
        )
        slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
        wn_rate = np.where(
            (abscissa >= points[0, 0]) & (abscissa < points[-1, 0]), slopes[cell], 0.0
        )
    else:
        wn_rate = np.gradient(wn, times)
    return wn**2, 2.0 * channel.damping * wn - wn_rate / wn


def velocity_loop(
    reference: Floats, vehicle: Vehicle, trim_tables: Tables
) -> tuple[Floats, Floats]:
    """Return A and B of sub-loop 2, equations (8)-(9), each ``[tick, 3, 3]``.

    The states are gamma, chi and V; the inputs are alpha, bank and eta.
    """
    c = dict(zip(REFERENCE, reference.T, strict=True))
    speed = c["speed"]
    mass = c["mass"]
    gravity = c["gravity"]
    radius = c["radius"]
    gamma = c["flight_path_angle"]
    chi = c["heading"]
    alpha = c["angle_of_attack"]
    bank = c["bank"]
    eta = c["equivalence_ratio"]
    constants = vehicle.constants
    mach = speed / c["sound_speed"]

    def coefficients(mach: Any, alpha: Any, eta: Any) -> Numbers:
        """Return the trimmed lift, drag and thrust coefficients, [3, tick]."""
        named = {"mach": mach, "angle_of_attack": alpha, "equivalence_ratio": eta}
        return table_rows(trim_tables, make_variables(vehicle, **named))[1:4]

    # trimmed coefficients and their slopes in the table cell, each [tick]
    value = coefficients(mach, alpha, eta)
    step = 1e-30j
    by_mach = coefficients(mach + step, alpha, eta).imag / step.imag
    by_alpha = coefficients(mach, alpha + step, eta).imag / step.imag
    by_eta = coefficients(mach, alpha, eta + step).imag / step.imag

    q_area = 0.5 * c["density"] * speed**2 * constants.area
    lift, _, thrust = q_area * value
    lift_alpha, drag_alpha, thrust_alpha = q_area * by_alpha
    lift_eta, drag_eta, thrust_eta = q_area * by_eta
    lift_speed, drag_speed, thrust_speed = q_area * (
        2.0 * value / speed + by_mach / c["sound_speed"]
    )

    # sine of the thrust angle: alpha plus the inclination of the thrust line
    sin_t = np.sin(alpha) * constants.thrust_cos + np.cos(alpha) * constants.thrust_sin
    cos_t = np.cos(alpha) * constants.thrust_cos - np.sin(alpha) * constants.thrust_sin
    normal = lift + thrust * sin_t
    normal_alpha = thrust_alpha * sin_t + thrust * cos_t + lift_alpha
    normal_eta = thrust_eta * sin_t + lift_eta
    normal_speed = thrust_speed * sin_t + lift_speed

    sg = np.sin(gamma)
    cg = np.cos(gamma)
    sx = np.sin(chi)
    cx = np.cos(chi)
    ss = np.sin(bank)
    cs = np.cos(bank)
    tan_lat = np.tan(c["latitude"])
    momentum = mass * speed
    A, B = np.zeros((2, len(reference), 3, 3))
    B[:, 0, 0], B[:, 0, 1], B[:, 0, 2] = (
        np.stack([normal_alpha * cs, -normal * ss, normal_eta * cs]) / momentum
    )
    B[:, 1, 0], B[:, 1, 1], B[:, 1, 2] = np.stack(
        [normal_alpha * ss, normal * cs, normal_eta * ss]
    ) / (momentum * cg)
    B[:, 2, 0] = (thrust_alpha * cos_t - thrust * sin_t - drag_alpha) / mass
    B[:, 2, 2] = (thrust_eta * cos_t - drag_eta) / mass
    A[:, 0, 0] = (gravity / speed - speed / radius) * sg
    A[:, 0, 2] = normal_speed * cs / momentum - normal * cs / (momentum * speed)
    A[:, 0, 2] += (1.0 / radius + gravity / speed**2) * cg
    A[:, 1, 0] = normal * ss * sg / (momentum * cg**2) - speed / radius * sg * sx * tan_lat
    A[:, 1, 1] = speed / radius * cg * cx * tan_lat
    A[:, 1, 2] = (normal_speed * ss - normal * ss / speed) / (
        momentum * cg
    ) + cg * sx * tan_lat / radius
    A[:, 2, 0] = -gravity * cg
    A[:, 2, 2] = (thrust_speed * cos_t - drag_speed) / mass
    return A, B


def velocity_gains(A: Floats, B: Floats, spectra: list[tuple[Floats, Floats]]) -> Floats:
    """Return the gains K2 ``[tick, 3, 6]`` that satisfy ``B K2 = A - A_c``.

    Raise LinAlgError if the velocity is not controllable, for example without thrust.
    """
    if np.linalg.cond(B).max() > _LARGEST_CONDITION:
        raise np.linalg.LinAlgError("Singular matrix B")
    expected = np.zeros((len(A), 3, 6))
    expected[:, :, 1::2] = A
    for i, (a1, a2) in enumerate(spectra):
        expected[:, i, 2 * i] += a1
        expected[:, i, 2 * i + 1] += a2
    return np.asarray(np.linalg.solve(B, expected), np.float64)
