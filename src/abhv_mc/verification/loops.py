"""TLC's loops are exact and LQR's gains optimal: ``A - B K`` and the Riccati residual at random nominals.

A and B are complex-step Jacobians of the design model, the right-hand sides (1), (13) and (3) of Zhu and Shen 2014 on a
sphere that does not turn; the formulas under test are not looked at.
"""

from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from abhv_mc.control.columns import LQR_ELEVATOR, LQR_GUIDANCE, LQR_LATERAL, REFERENCE, TLC_K1, TLC_K2
from abhv_mc.control.controller_file import LqrController, TlcController, read_controller
from abhv_mc.control.design_model import Surroundings, attitude_rates, body_rate_rates, guidance_rates, wrench_at
from abhv_mc.control.design_tables import Numbers, slope
from abhv_mc.control.lqr_design import gains_at, make_models, make_nominal
from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.control.reference import make_mission_trim_tables, solve_reference
from abhv_mc.control.surroundings import make_surroundings
from abhv_mc.control.tlc_design import make_tlc_gains, pd_spectrum
from abhv_mc.control.tlc_loops import (
    AttitudePoint,
    Inertia,
    Spectrum,
    attitude_gains,
    attitude_inverse,
    differentiator_next,
    differentiator_output,
    moment_inverse,
    rate_gains,
)
from abhv_mc.control.trim_tables import trim_elevator
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.vehicle.arrays import Floats, Tables
from abhv_mc.vehicle.model import Vehicle
from abhv_mc.verification.rows import Row
from abhv_mc.world.earth import WGS84

_Law = TypeVar("_Law", TlcController, LqrController)

NOMINALS = 100
_EXACT = 1e-9  # relative to the largest entry of what is summed
_STILL = (0.0, 0.0, 0.0)
SPHERE = WGS84._replace(flattening=0.0, j2=0.0, rotation_rate=0.0)

# Ranges of the random nominals, SI and radians; the speed is a Mach number until the altitude is known.
_RANGES = {
    "altitude": (18e3, 26e3),
    "latitude": (-0.9, 0.9),
    "mach": (4.3, 5.2),
    "flight_path_angle": (-0.3, 0.3),
    "heading": (-3.0, 3.0),
    "angle_of_attack": (-0.01, 0.20),
    "bank": (-1.2, 1.2),
    "equivalence_ratio": (0.1, 1.4),
    "mass": (1050.0, 1370.0),
    "angle_of_attack_rate": (-0.1, 0.1),
    "bank_rate": (-0.3, 0.3),
}


class Nominal(NamedTuple):
    """A nominal anywhere in the envelope, the elevator at trim, the body turning as sub-loop 3 wants it."""

    around: Surroundings
    values: dict[str, float]  # of _RANGES, and the speed
    elevator: float
    rates: tuple[float, float, float]  # p, q, r
    attitude: AttitudePoint

    @property
    def velocity(self) -> Floats:
        """gamma, chi, V, alpha, bank, eta."""
        names = ("flight_path_angle", "heading", "speed", "angle_of_attack", "bank", "equivalence_ratio")
        return np.array([self.values[name] for name in names])


class Design(NamedTuple):
    """What the nominals are drawn for."""

    vehicle: Vehicle
    mission: Mission
    reference: Floats  # [tick, column]
    trim_tables: Tables
    tlc: TlcController


def make_design() -> Design:
    """The S manoeuvre with the vehicle whose thrust is inclined and offset, so that every term counts."""
    configs = shipped_configs()
    vehicle = load_vehicle(configs / "vehicle" / "ghame_x_coupled.yaml")
    mission = read_mission(configs / "mission" / "s_manoeuvre.yaml")
    trim_tables = make_mission_trim_tables(mission, vehicle)
    reference, _ = solve_reference(mission, vehicle, trim_tables, 0.1, 600)
    return Design(vehicle, mission, reference, trim_tables, _read(configs / "control" / "tlc.yaml", TlcController))


def _read(path: Path, law: type[_Law]) -> _Law:
    controller = read_controller(path)
    if not isinstance(controller, law):
        raise TypeError(f"{path.name} is not a controller of the law {law.__name__}")
    return controller


def draw_nominals(design: Design, count: int = NOMINALS, seed: int = 2014) -> list[Nominal]:
    """Random nominals over _RANGES."""
    low, high = np.array(list(_RANGES.values())).T
    draws = np.random.default_rng(seed).uniform(low, high, (count, low.size))
    return [_make_nominal(design.vehicle, dict(zip(_RANGES, draw.tolist(), strict=True))) for draw in draws]


def _make_nominal(vehicle: Vehicle, values: dict[str, float]) -> Nominal:
    around = make_surroundings(SPHERE, values["altitude"], values["latitude"])
    speed = values["mach"] * around.sound_speed
    alpha, bank, gamma = values["angle_of_attack"], values["bank"], values["flight_path_angle"]
    at = [np.array([x]) for x in (speed, alpha, values["equivalence_ratio"])]
    elevator = float(trim_elevator(vehicle, around, at[0], at[1], at[2])[0][0])

    # What the law reads from its tables: forces and their slopes over alpha and beta.
    def forces_of(x: Numbers) -> Numbers:
        """Force across and along the velocity, thrust along it."""

        def force(eta: float) -> Numbers:
            deflections = (0.0, 0.0, elevator)
            return wrench_at(vehicle, around, values["mass"], speed, x[0], x[1], _STILL, deflections, eta).force

        full, idle = force(values["equivalence_ratio"]), force(0.0)
        sa, ca = np.sin(x[0]), np.cos(x[0])
        drag = -(idle[0] * ca + idle[2] * sa)
        side = idle[1] * np.cos(x[1]) + drag * np.sin(x[1])
        thrust = full - idle
        return np.stack([full[0] * sa - full[2] * ca, side, thrust[0] * ca + thrust[2] * sa])

    here = np.array([alpha, 0.0])
    normal, side, axial = np.real(forces_of(here[:, None] + 0j))[:, 0].tolist()
    slopes = slope(forces_of, here)
    attitude = AttitudePoint(
        values["mass"] * speed,
        around.gravity / speed,
        np.sin(alpha),
        np.cos(alpha),
        np.sin(bank),
        np.cos(bank),
        np.cos(gamma),
        np.tan(gamma),
        normal,
        float(slopes[0, 0]),
        axial,
        side,
        float(slopes[1, 1]),
    )
    rates = attitude_inverse(attitude, values["angle_of_attack_rate"], 0.0, values["bank_rate"])
    return Nominal(around, values | {"speed": speed}, elevator, rates, attitude)


def closed_loop(A: Floats, B: Floats, K: Floats) -> Floats:
    """``A - B K`` on (integral, state) of each channel."""
    n = len(A)
    augmented_A, augmented_B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, B.shape[1]))
    augmented_A[0::2, 1::2] = np.eye(n)
    augmented_A[1::2, 1::2] = A
    augmented_B[1::2] = B
    return augmented_A - augmented_B @ K


def wanted_loop(spectrum: Spectrum) -> Floats:
    """A_c of (10)."""
    return closed_loop(np.zeros((3, 3)), -np.eye(3), -np.kron(np.eye(3), np.ones((1, 2))) * np.array(spectrum))


def velocity_jacobian(design: Design, nominal: Nominal) -> Floats:
    """[4, 7]: rates of altitude, gamma, chi, V over these and alpha, bank, eta, from (1)."""
    at = [nominal.values["altitude"], *nominal.velocity]

    def rates_of(x: Numbers) -> Numbers:
        mass = nominal.values["mass"]
        return guidance_rates(design.vehicle, design.trim_tables, nominal.around, mass, x[:4], x[4:])

    return slope(rates_of, at)


def attitude_jacobian(design: Design, nominal: Nominal) -> Floats:
    """[3, 6]: rates of alpha, beta, bank over these and p, q, r, from (13); forces do not feel the rates."""
    values = nominal.values

    def rates_of(x: Numbers) -> Numbers:
        wrench = wrench_at(
            design.vehicle,
            nominal.around,
            values["mass"],
            values["speed"],
            x[0],
            x[1],
            _STILL,
            (0.0, 0.0, nominal.elevator),
            values["equivalence_ratio"],
        )
        gamma = values["flight_path_angle"]
        gravity = nominal.around.gravity
        return attitude_rates(wrench.force, values["mass"], values["speed"], gravity, gamma, x[:3], x[3:])

    return slope(rates_of, [values["angle_of_attack"], 0.0, values["bank"], *nominal.rates])


def inertia_of(design: Design, nominal: Nominal) -> Floats:
    """The inertia matrix [3, 3] at the nominal's mass, kg m2."""
    at = np.array([nominal.values["angle_of_attack"]])
    mass, speed = nominal.values["mass"], nominal.values["speed"]
    wrench = wrench_at(design.vehicle, nominal.around, mass, speed, at, 0.0 * at, _STILL, _STILL, 0.0 * at)
    return np.asarray(np.real(wrench.inertia[..., 0]))


def rate_jacobian(inertia: Floats, rates: tuple[float, ...], moment: tuple[float, ...]) -> Floats:
    """[3, 6]: rates of p, q, r over these and the moments, from (3)."""

    def rates_of(x: Numbers) -> Numbers:
        return body_rate_rates(np.broadcast_to(inertia[..., None], (3, 3, x.shape[1])), x[3:], x[:3])

    return slope(rates_of, [*rates, *moment])


class Gains(NamedTuple):
    """TLC's gains at a nominal with the spectra they promise."""

    altitude: Floats  # [2]
    velocity: Floats  # [3, 6]
    attitude: Floats  # [3, 6]
    rates: Floats  # [3, 6]
    spectra: tuple[Spectrum, Spectrum, Spectrum]  # of velocity, attitude, rates
    altitude_spectrum: tuple[float, float]


def tlc_gains(design: Design, nominal: Nominal, inertia: Floats) -> Gains:
    """The product's own gains, Table 1."""
    tlc, values, around = design.tlc, nominal.values, nominal.around
    row = dict(zip(REFERENCE, design.reference[0].tolist(), strict=True)) | {
        name: values[name] for name in REFERENCE if name in values
    }
    row |= {name: getattr(around, name) for name in ("density", "sound_speed", "gravity", "radius")}
    rows = np.array([list(row.values())] * 2)
    gains = make_tlc_gains(tlc, rows, design.vehicle, design.trim_tables)[0]

    def spectrum(*channels: str) -> Spectrum:
        loop, *names = channels
        pairs = [pd_spectrum(getattr(getattr(tlc, loop), name), np.zeros(2), np.ones(2)) for name in names]
        return Spectrum(*(float(part[0]) for pair in pairs for part in pair))

    a1, a2 = pd_spectrum(tlc.altitude, np.zeros(2), np.ones(2))
    spectra = (
        spectrum("velocity", "flight_path_angle", "heading", "speed"),
        spectrum("attitude", "angle_of_attack", "sideslip", "bank"),
        spectrum("rates", "roll_rate", "pitch_rate", "yaw_rate"),
    )
    p, _, r = nominal.rates
    attitude = np.array(attitude_gains(nominal.attitude, p, r, spectra[1])).reshape(3, 6)
    own = Inertia(inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 2])
    return Gains(
        gains[TLC_K1 : TLC_K1 + 2],
        gains[TLC_K2 : TLC_K2 + 18].reshape(3, 6),
        attitude,
        np.array(rate_gains(own, *nominal.rates, spectra[2])).reshape(3, 6),
        spectra,
        (float(a1[0]), float(a2[0])),
    )


def _off(J: Floats, K: Floats, spectrum: Spectrum) -> float:
    """Largest difference of ``A - B K`` from A_c, relative to the largest term of the sum."""
    A, B = J[:, :3], J[:, 3:]
    scale = max(np.abs(A).max(), np.abs(B @ K).max())
    return float(np.abs(closed_loop(A, B, K) - wanted_loop(spectrum)).max() / scale)


def verify_tlc_loops(design: Design, nominals: list[Nominal]) -> list[Row]:
    """Rows of each sub-loop and of the nominal inputs."""
    worst = dict.fromkeys(("1 altitude", "2 velocity", "3 attitude", "4 body rates"), 0.0)
    inverse = 0.0
    for nominal in nominals:
        inertia = inertia_of(design, nominal)
        gains = tlc_gains(design, nominal, inertia)
        J = velocity_jacobian(design, nominal)
        a1, a2 = gains.altitude_spectrum
        off = np.abs(J[0, 1] * gains.altitude / np.array([a1, a2]) - 1.0).max()
        acceleration = (0.3, -0.2, 0.1)
        moment = moment_inverse(Inertia(*inertia.diagonal().tolist(), inertia[0, 2]), *nominal.rates, *acceleration)
        found = np.real(body_rate_rates(inertia, np.array(moment), np.array(nominal.rates)))
        inverse = max(inverse, float(np.abs(found - acceleration).max()))
        offs = (
            float(off),
            _off(J[1:, 1:], gains.velocity, gains.spectra[0]),
            _off(attitude_jacobian(design, nominal), gains.attitude, gains.spectra[1]),
            _off(rate_jacobian(inertia, nominal.rates, moment), gains.rates, gains.spectra[2]),
        )
        worst = {name: max(value, new) for (name, value), new in zip(worst.items(), offs, strict=True)}
    case, against = f"TLC, {len(nominals)} nominals", "A_c of (10), complex step"
    rows = [Row(case, against, f"A - B K, sub-loop {name}", "relative", off, _EXACT) for name, off in worst.items()]
    return [*rows, Row(case, "(3) inverted", "body acceleration", "rad/s2", inverse, 1e-12)]


def verify_differentiator() -> list[Row]:
    """Row of the pseudo-differentiator's response to sampled sines against ``wd s / (s + wd)``."""
    tick, worst = 0.01, 0.0
    for bandwidth in (0.3, 1.5):
        decay = float(np.exp(-bandwidth * tick))
        for omega in (0.03, 0.3, 3.0):
            # The discrete filter's own transfer function, from its impulse response.
            state, response = 0.0, []
            for k in range(round(20.0 / bandwidth / tick)):
                u = 1.0 if k == 0 else 0.0
                response.append(differentiator_output(bandwidth, state, u))
                state = differentiator_next(decay, state, u)
            found = np.sum(np.array(response) * np.exp(-1j * omega * tick * np.arange(len(response))))
            expected = bandwidth * 1j * omega / (1j * omega + bandwidth)
            # Holding the input delays the filtered part by half a tick.
            worst = max(worst, float(abs(found - expected)) / (0.5 * omega * tick * bandwidth))
    return [Row("differentiator, 100 Hz", "(21)", "frequency response", "of half a tick's delay", worst, 1.1)]


def verify_lqr(design: Design) -> list[Row]:
    """Rows of the Riccati residuals ``A'P + P A - K'R K + Q`` with P from the closed loop's Lyapunov equation."""
    from scipy.linalg import solve_continuous_lyapunov

    rows = []
    for name in ("lqr", "lqr_retuned"):
        controller = _read(shipped_configs() / "control" / f"{name}.yaml", LqrController)
        worst = 0.0
        for row in design.reference[:: len(design.reference) // 12]:
            models = make_models(design.vehicle, design.trim_tables, make_nominal(design.mission, row))
            gains = gains_at(controller, models)
            parts = (
                (controller.guidance, models.guidance, gains[LQR_GUIDANCE:LQR_ELEVATOR], 1.0),
                (controller.longitudinal, models.longitudinal, gains[LQR_ELEVATOR:LQR_LATERAL], np.pi / 180.0),
                (controller.lateral, models.lateral, gains[LQR_LATERAL:], np.pi / 180.0),
            )
            for weights, (A, B), flat, unit in parts:
                Q, R = (np.diag([weight for _, weight in part]) for part in (weights.states, weights.inputs))
                K = flat.reshape(B.shape[1], A.shape[0]) / unit
                closed = A - unit * B @ K
                cost = Q + K.T @ R @ K
                P = solve_continuous_lyapunov(closed.T, -0.5 * (cost + cost.T))
                optimal = np.linalg.solve(R, unit * B.T @ P)
                unstable = np.linalg.eigvals(closed).real.max() >= 0.0
                worst = max(worst, np.inf if unstable else float(np.abs(optimal - K).max() / np.abs(K).max()))
        rows.append(Row(f"{name}, along the S", "Riccati equation", "gain K = R^-1 B'P", "relative", worst, 1e-6))
    return rows


def verify_loops() -> list[Row]:
    """All rows of this file."""
    design = make_design()
    return [
        *verify_tlc_loops(design, draw_nominals(design)),
        *verify_differentiator(),
        *verify_lqr(design),
    ]
