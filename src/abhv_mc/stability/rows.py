"""Margins as rows of plain numbers, for JSON and tables."""

from typing import Any

import numpy as np

from abhv_mc.stability.analysis import Stability
from abhv_mc.stability.linearize import INPUTS, REASONS
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
    cut = stability.cut[system]
    m = stability.margins
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = 20.0 * np.log10(m.gain_low[system]), 20.0 * np.log10(m.gain_high[system])
        gain, phase = disk_gain_and_phase(m.all_disk[system])
        disk_gain = 20.0 * np.log10(gain)
    values = {
        name: {
            "gain_margin_low_db": float(low[i]),
            "gain_margin_high_db": float(high[i]),
            "phase_margin_deg": float(np.rad2deg(m.phase[system, i])),
            "delay_margin_ms": float(1e3 * m.delay[system, i]),
            "sensitivity_peak": float(m.sensitivity[system, i]),
            "crossover_rad_s": float(m.crossover[system, i]),
        }
        if not cut[i]
        else dict.fromkeys(_LOOP, np.nan)
        for i, name in enumerate(INPUTS)
    }
    values["all"] = {
        "disk_margin": float(m.all_disk[system]),
        "disk_gain_db": float(disk_gain),
        "disk_phase_deg": float(np.rad2deg(phase)),
        "delay_margin_ms": float(1e3 * m.all_delay[system]),
    }
    return values


def cut_loops(stability: Stability, system: int = 0) -> dict[str, str]:
    """Why an input has no loop: ``stuck``, or ``no effect`` (as of an engine without fuel)."""
    return {name: REASONS[int(why)] for name, why in zip(INPUTS, stability.cut[system], strict=True) if why}


def make_rows(controller: str, time: float | None, stability: Stability, system: int = 0) -> list[dict[str, Any]]:
    """A row for each loop and one, ``all``, for all at once; ``time`` (s) is None at the trim.

    What is infinite, or without meaning because the closed loop is unstable, is None. The row of a loop that is not
    there has its ``reason``, the row ``all`` of an unstable loop its growing poles (1/s, real and imaginary part).
    """
    stable, reasons = bool(stability.stable[system]), cut_loops(stability, system)
    rows: list[dict[str, Any]] = [
        {"controller": controller, "time_s": time, "loop": loop}
        | {key: value if np.isfinite(value) else None for key, value in values.items()}
        | {"stable": stable}
        | ({"reason": reasons[loop]} if loop in reasons else {})
        for loop, values in margin_values(stability, system).items()
    ]
    if not stable:
        growing = [[float(p.real), float(p.imag)] for p in stability.poles[system] if p.real >= 0.0 and p.imag >= 0.0]
        rows[-1]["poles"] = growing
    return rows
