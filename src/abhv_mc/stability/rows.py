"""Margins as rows of plain numbers, for JSON and tables."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from abhv_mc.stability.analysis import Stability
from abhv_mc.stability.linearize import REASONS
from abhv_mc.stability.margins import disk_gain_and_phase

_LOOP = (
    "gain_margin_low_db",
    "gain_margin_high_db",
    "phase_margin_deg",
    "delay_margin_ms",
    "sensitivity_peak",
    "crossover_rad_s",
)


def margin_values(stability: Stability, system: int = 0) -> dict[str, dict[str, float]]:
    """The margins of each loop and of ``all`` at once, by name.

    Infinite where nothing makes a loop unstable, not-a-number where the closed loop is unstable as it is, and where
    there is no loop (:func:`cut_loops`).
    """
    values = {name: _margins_of_loop(of, system, i) for name, of, i in _loops(stability)}
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
    """Name and place of each loop: those that count, then those of single effectors."""
    yield from ((name, stability, i) for i, name in enumerate(stability.inputs))
    if stability.apart is not None:
        for i, name in enumerate(stability.apart.inputs[:-1]):
            yield f"{name}_effector" if name in stability.inputs else name, stability.apart, i


def _margins_of_loop(stability: Stability, system: int, i: int) -> dict[str, float]:
    m = stability.margins
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = 20.0 * np.log10(m.gain_low[system, i]), 20.0 * np.log10(m.gain_high[system, i])
    phase, delay = np.rad2deg(m.phase[system, i]), 1e3 * m.delay[system, i]
    values = (low, high, phase, delay, m.sensitivity[system, i], m.crossover[system, i])
    return {name: np.nan if stability.cut[system, i] else float(x) for name, x in zip(_LOOP, values, strict=True)}


def cut_loops(stability: Stability, system: int = 0) -> dict[str, str]:
    """Why an input has no loop: ``stuck``, or ``no effect`` (as of an engine without fuel)."""
    return {name: REASONS[why] for name, of, i in _loops(stability) if (why := int(of.cut[system, i]))}


def make_rows(controller: str, time: float | None, stability: Stability, system: int = 0) -> list[dict[str, Any]]:
    """A row for each loop and one, ``all``, for all at once; ``time`` (s) is None at the trim.

    What is infinite, or without meaning because the closed loop is unstable, is None. The row of a loop that is not
    there has its ``reason``, the row ``all`` of an unstable loop its growing poles (1/s, real and imaginary part), and
    single effectors' rows under a law that commands axes say that they do not count.
    """
    stable, reasons = bool(stability.stable[system]), cut_loops(stability, system)
    apart = [name for name, of, _ in _loops(stability) if of is stability.apart]
    rows: list[dict[str, Any]] = [
        {"controller": controller, "time_s": time, "loop": loop}
        | {key: value if np.isfinite(value) else None for key, value in values.items()}
        | {"stable": stable}
        | ({"reason": reasons[loop]} if loop in reasons else {})
        | ({"counts": False} if loop in apart else {})
        for loop, values in margin_values(stability, system).items()
    ]
    if not stable:
        growing = [[float(p.real), float(p.imag)] for p in stability.poles[system] if p.real >= 0.0 and p.imag >= 0.0]
        rows[-1]["poles"] = growing
    return rows
