"""Margins as rows of plain numbers, for JSON and tables."""

from typing import Any

import numpy as np

from abhv_mc.stability.analysis import Stability
from abhv_mc.stability.linearize import INPUTS
from abhv_mc.stability.margins import disk_gain_and_phase


def make_rows(controller: str, time: float | None, stability: Stability, system: int = 0) -> list[dict[str, Any]]:
    """A row for each loop and one, ``all``, for all at once; ``time`` (s) is None at the trim.

    What is infinite, or without meaning because the closed loop is unstable, is None. The row ``all`` of an unstable
    loop has its growing poles (1/s, real and imaginary part).
    """
    m, stable = stability.margins, bool(stability.stable[system])
    rows: list[dict[str, Any]] = []
    head = {"controller": controller, "time_s": time}
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = 20.0 * np.log10(m.gain_low[system]), 20.0 * np.log10(m.gain_high[system])
    for i, name in enumerate(INPUTS):
        values = {
            "gain_margin_low_db": low[i],
            "gain_margin_high_db": high[i],
            "phase_margin_deg": np.rad2deg(m.phase[system, i]),
            "delay_margin_ms": 1e3 * m.delay[system, i],
            "sensitivity_peak": m.sensitivity[system, i],
            "crossover_rad_s": m.crossover[system, i],
        }
        rows.append(head | {"loop": name} | {key: _number(value) for key, value in values.items()} | {"stable": stable})
    gain, phase = disk_gain_and_phase(m.all_disk[system])
    together = {
        "disk_margin": m.all_disk[system],
        "disk_gain_db": 20.0 * np.log10(gain),
        "disk_phase_deg": np.rad2deg(phase),
        "delay_margin_ms": 1e3 * m.all_delay[system],
    }
    growing = [[float(p.real), float(p.imag)] for p in stability.poles[system] if p.real >= 0.0 and p.imag >= 0.0]
    last = head | {"loop": "all"} | {key: _number(value) for key, value in together.items()} | {"stable": stable}
    rows.append(last if stable else last | {"poles": growing})
    return rows


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
