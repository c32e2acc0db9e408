"""TLC's loops are exact: ``A - B K`` at random nominals."""

from typing import NamedTuple

import numpy as np
from verification.nominals import (
    Design,
    Nominal,
    attitude_jacobian,
    inertia_of,
    rate_jacobian,
    velocity_jacobian,
)

from abhv_mc.array_types import Floats
from abhv_mc.control.design.design_model import body_rate_rates
from abhv_mc.control.design.tlc_design import make_tlc_gains, pd_spectrum
from abhv_mc.kernel.laws.columns import REFERENCE, TLC_ATTITUDE, TLC_K1, TLC_K2, TLC_RATE
from abhv_mc.kernel.laws.tlc_loops import (
    Inertia,
    Spectrum,
    attitude_gains,
    differentiator_next,
    differentiator_output,
    moment_inverse,
    rate_gains,
)
from abhv_mc.verification.check_rows import Row

NOMINALS = 100
# Of the two inner loops: all different, so that no two channels can be swapped.
_DIFFERENT = Spectrum(0.09, 2.04, 0.16, 1.9, 0.25, 1.7)
_EXACT = 1e-9  # relative to the largest term of what is summed


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


class Gains(NamedTuple):
    """TLC's gains at a nominal with the spectra they promise."""

    altitude: Floats  # [2]
    velocity: Floats  # [3, 6]
    attitude: Floats  # [3, 6]
    rates: Floats  # [3, 6]
    spectra: tuple[Spectrum, Spectrum, Spectrum]  # of velocity, attitude, rates
    altitude_spectrum: tuple[float, float]


def tlc_gains(design: Design, nominal: Nominal, inertia: Floats, inner: Spectrum | None = None) -> Gains:
    """The product's own gains; Table 1, but ``inner`` for attitude and body rates where it is given."""
    tlc, values, around = design.tlc, nominal.values, nominal.around
    row = dict(zip(REFERENCE, design.reference[0].tolist(), strict=True)) | {
        name: values[name] for name in REFERENCE if name in values
    }
    row |= {name: getattr(around, name) for name in ("density", "sound_speed", "gravity", "radius")}
    rows = np.array([list(row.values())] * 2)
    gains = make_tlc_gains(tlc, rows, design.vehicle, design.trim_tables)[0]

    names = ("flight_path_angle", "heading", "speed")
    pairs = [pd_spectrum(getattr(tlc.velocity, name), np.zeros(2), np.ones(2)) for name in names]
    a1, a2 = pd_spectrum(tlc.altitude, np.zeros(2), np.ones(2))
    table_1 = (Spectrum(*gains[first : first + 6].tolist()) for first in (TLC_ATTITUDE, TLC_RATE))
    spectra = (Spectrum(*(float(part[0]) for pair in pairs for part in pair)), *((inner, inner) if inner else table_1))
    p, _, r = nominal.rates
    attitude = np.array(attitude_gains(nominal.attitude, p, r, spectra[1])).reshape(3, 6)
    return Gains(
        gains[TLC_K1 : TLC_K1 + 2],
        gains[TLC_K2 : TLC_K2 + 18].reshape(3, 6),
        attitude,
        np.array(rate_gains(_numbers(inertia), *nominal.rates, spectra[2])).reshape(3, 6),
        spectra,
        (float(a1[0]), float(a2[0])),
    )


def _numbers(inertia: Floats) -> Inertia:
    return Inertia(inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 2])


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
        gains = tlc_gains(design, nominal, inertia, _DIFFERENT)
        J = velocity_jacobian(design, nominal)
        a1, a2 = gains.altitude_spectrum
        off = np.abs(J[0, 1] * gains.altitude / np.array([a1, a2]) - 1.0).max()
        acceleration = (0.3, -0.2, 0.1)
        moment = moment_inverse(_numbers(inertia), *nominal.rates, *acceleration)
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
