"""Poles and margins of linear models, and margins of flights at several times."""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints, Mask
from abhv_mc.process_settings import one_blas_thread
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability.lifted import find_lifted_margins
from abhv_mc_vehicle.stability.linearize import closed_period, linearize
from abhv_mc_vehicle.stability.margins import (
    REASONS,
    Linear,
    Margins,
    disk_gain_and_phase,
    find_margins,
    loop_gains,
    make_loops,
)
from abhv_mc_vehicle.stability.points import AT_LIMIT, flown_points
from abhv_mc_vehicle.stability.search import frequency_grid
from abhv_mc_vehicle.stability.steady import trim_points

FREQUENCIES = 200
GROWTH = 1e-5  # growth rate below which a pole counts as neutral because of rounding errors, 1/s
_TOGETHER = 64  # number of flights analysed together; the states of one flight take 1 MB

# values of the margin metrics if no perturbation destabilizes a loop
NO_GAIN_MARGIN_DB = 60.0
NO_PHASE_MARGIN_DEG = 180.0
NO_DELAY_MARGIN_MS = 1000.0

NO_SLOPES = "the derivatives of the vehicle or the controller are not finite"

Time = Literal["trim"] | float  # time of linearization: the trim, or a time of the flight in s


class Stability(NamedTuple):
    """Poles and margins of each linear model."""

    stable: Mask  # whether each system is stable
    poles: list[
        Complexes
    ]  # closed-loop poles, 1/s, fastest growing first; empty if slopes are not finite
    margins: Margins  # margins; NaN for systems that are not stable
    cut: Ints  # [system, input] reason why an input has no loop (see linear_model), else 0
    inputs: tuple[str, ...]
    apart: "Stability | None" = (
        # stability of loops at individual effectors, if requested and if the controller commands
        # axes
        None
    )


class FlightMargins(NamedTuple):
    """Smallest margins of each flight over all loops and times; 0 if there is no margin."""

    # [flight, 4] smaller of the lower and upper gain margin (dB), phase margin (deg), delay margin
    # (ms) and disk margin
    table: Floats
    faults: list[list[str]]  # [time][flight] reason why there is no margin; '' if there is a margin


def analyse(linear: Linear, frequencies: int = FREQUENCIES, apart: bool = False) -> Stability:
    """Return closed-loop poles, and the margins of stable systems.

    If `apart`, also return the poles and margins of single effectors.
    """
    if apart and linear.apart is not None:
        return analyse(linear, frequencies)._replace(apart=analyse(linear.apart, frequencies))
    discrete = _closed_poles(linear)
    span = linear.period * max(len(linear.phases), 1)
    poles = closed_poles(linear, discrete)
    stable = np.array(
        [system_poles.size > 0 and system_poles[0].real < GROWTH for system_poles in poles]
    )
    systems = len(poles)
    inputs = linear.law_D.shape[1]
    margins = Margins._make(
        np.full(shape, np.nan) for shape in [(systems, inputs)] * 9 + [(systems,)] * 3
    )
    chosen = np.flatnonzero(stable)
    grid = frequency_grid([discrete[i] for i in chosen], span, frequencies)
    if linear.phases:
        for i, omega in zip(chosen, grid, strict=True):
            for into, value in zip(
                margins, find_lifted_margins(linear, int(i), omega), strict=True
            ):
                into[i] = value[0]
    elif chosen.size:
        loops = make_loops(
            linear._replace(
                **{name: getattr(linear, name)[chosen] for name in Linear._fields[1:-3]}
            )
        )
        stable_margins = find_margins(lambda i, w: loop_gains(loops, i, w), grid, linear.period)
        for into, value in zip(margins, stable_margins, strict=True):
            into[chosen] = value
    return Stability(stable, poles, margins, linear.cut, linear.inputs)


def closed_poles(linear: Linear, discrete: list[Complexes] | None = None) -> list[Complexes]:
    """Return the closed-loop poles (1/s) from the discrete eigenvalues, fastest growing first."""
    span = linear.period * max(len(linear.phases), 1)
    with np.errstate(divide="ignore"):
        poles = [
            np.log(z[z != 0.0].astype(np.complex128)) / span
            for z in discrete or _closed_poles(linear)
        ]
    return [system_poles[np.argsort(-system_poles.real)] for system_poles in poles]


def _closed_poles(linear: Linear) -> list[Complexes]:
    """Return the eigenvalues of the closed loop over its period; empty if not finite."""
    poles: list[Complexes] = [np.empty(0, np.complex128)] * len(linear.A)
    for delay in np.unique(linear.delay):
        systems = np.flatnonzero(linear.delay == delay)
        loops = np.stack([closed_period(linear, int(i)) for i in systems])
        # The model of a controller without derivatives is not finite.
        finite = np.isfinite(loops).all(axis=(1, 2))
        for i, loop_poles in zip(systems[finite], np.linalg.eigvals(loops[finite]), strict=True):
            poles[i] = loop_poles
    return poles


@one_blas_thread()
def margins_of_flights(
    plan: FlightPlan,
    steady: FlightPlan,
    parameters: Floats,
    times: Sequence[Time],
    frequencies: int = FREQUENCIES,
) -> FlightMargins:
    """Return the smallest margins over `times` of flights [flight, parameter].

    `steady` is the plan of :func:`abhv_mc_vehicle.stability.steady.make_steady_plan` for the same
    vehicle, mission and controller. A flight that is unstable, has ended or is saturated at any of
    the times has zero margins. If no perturbation destabilizes a loop, the values are 60 dB, 180
    deg and 1000 ms.
    """
    count = len(parameters)
    least = np.tile(
        [NO_GAIN_MARGIN_DB, NO_PHASE_MARGIN_DEG, NO_DELAY_MARGIN_MS, np.inf], (count, 1)
    )
    faults: list[list[str]] = [[] for _ in times]
    for first in range(0, count, _TOGETHER):
        some = parameters[first : first + _TOGETHER]
        for time, reasons in zip(times, faults, strict=True):
            if time == "trim":
                flown = trim_points(steady, some)
                linear = linearize(steady, flown.points)
            else:
                flown = flown_points(plan, some, time)
                linear = linearize(plan, flown.points)
            stability = analyse(linear, frequencies)
            for i, (fault, stable) in enumerate(zip(flown.faults, stability.stable, strict=True)):
                grows = "" if stable else "unstable" if stability.poles[i].size else NO_SLOPES
                reasons.append(
                    "; ".join(filter(None, (fault, grows))) if fault in ("", AT_LIMIT) else fault
                )
                values = np.zeros(4) if reasons[-1] else _least(stability.margins, i)
                least[first + i] = np.minimum(least[first + i], values)
    return FlightMargins(least, faults)


def _least(margins: Margins, system: int) -> Floats:
    with np.errstate(divide="ignore"):
        gain = (
            20.0
            * np.log10(np.minimum(margins.gain_high[system], 1.0 / margins.gain_low[system])).min()
        )
    phase = margins.phase[system].min()
    delay = margins.delay[system].min()
    return np.array([gain, np.rad2deg(phase), 1e3 * delay, margins.all_disk[system]])


_LOOP = (
    "gain_margin_low_db",
    "gain_margin_high_db",
    "phase_margin_deg",
    "delay_margin_ms",
    "sensitivity_peak",
    "crossover_rad_s",
)


def margin_values(stability: Stability, system: int = 0) -> dict[str, dict[str, float]]:
    """Return the margins of each loop and of `all`; inf if unlimited, NaN if unstable or cut."""
    values = {
        name: _margins_of_loop(loop_stability, system, i)
        for name, loop_stability, i in _loops(stability)
    }
    m = stability.margins
    with np.errstate(divide="ignore"):
        gain, phase = disk_gain_and_phase(m.all_disk[system])
        disk_gain = 20.0 * np.log10(gain)
    values["all"] = {
        "disk_margin": float(m.all_disk[system]),
        "disk_gain_db": float(disk_gain),
        "disk_phase_deg": float(np.rad2deg(phase)),
        "delay_margin_ms": float(1e3 * m.all_delay[system]),
    }
    return values


def _loops(stability: Stability) -> Iterator[tuple[str, Stability, int]]:
    """Yield the name, stability and index of each loop; loops of single effectors come last."""
    yield from ((name, stability, i) for i, name in enumerate(stability.inputs))
    if stability.apart is not None:
        for i, name in enumerate(stability.apart.inputs[:-1]):
            yield f"{name}_effector" if name in stability.inputs else name, stability.apart, i


def _margins_of_loop(stability: Stability, system: int, i: int) -> dict[str, float]:
    m = stability.margins
    at = system, i
    with np.errstate(divide="ignore", invalid="ignore"):
        low = 20.0 * np.log10(m.gain_low[at])
        high = 20.0 * np.log10(m.gain_high[at])
    phase = np.rad2deg(m.phase[at])
    values = (low, high, phase, 1e3 * m.delay[at], m.sensitivity[at], m.crossover[at])
    return {
        name: np.nan if stability.cut[at] else float(x)
        for name, x in zip(_LOOP, values, strict=True)
    }


def cut_loops(stability: Stability, system: int = 0) -> dict[str, str]:
    """Return the cut loops by name, with the reason `stuck` or `no effect` (no fuel)."""
    return {
        name: REASONS[why]
        for name, loop_stability, i in _loops(stability)
        if (why := int(loop_stability.cut[system, i]))
    }


def make_rows(
    controller: str, time: float | None, stability: Stability, system: int = 0
) -> list[dict[str, Any]]:
    """Return a row for each loop, and a row `all` for all loops together.

    `time` (s) is None at the trim point. Infinite values, and all values of an unstable closed
    loop, are None. The row of a cut loop contains the `reason`, and the row `all` of an unstable
    system contains the growing poles (1/s, real and imaginary part). Rows of individual effectors
    have `counts: False` if the controller commands axes.
    """
    stable = bool(stability.stable[system])
    reasons = cut_loops(stability, system)
    effector_loops = [
        name for name, loop_stability, _ in _loops(stability) if loop_stability is stability.apart
    ]
    rows: list[dict[str, Any]] = [
        {"controller": controller, "time_s": time, "loop": loop}
        | {key: value if np.isfinite(value) else None for key, value in values.items()}
        | {"stable": stable}
        | ({"reason": reasons[loop]} if loop in reasons else {})
        | ({"counts": False} if loop in effector_loops else {})
        for loop, values in margin_values(stability, system).items()
    ]
    if not stable:
        growing = [
            [float(p.real), float(p.imag)]
            for p in stability.poles[system]
            if p.real >= 0.0 and p.imag >= 0.0
        ]
        rows[-1]["poles"] = growing
    return rows
