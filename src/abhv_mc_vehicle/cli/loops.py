"""Bode and Nichols figures of single loops, each with the other loops closed."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import CYCLE, INK, new_figure, styled, write_png
from abhv_mc_vehicle.stability.lifted import fundamental_gains
from abhv_mc_vehicle.stability.margins import Linear, close, loop_gains, make_loops

_POINTS = 1500


def write_loop_figures(folder: Path, stem: str, linear: Linear) -> Iterator[Path]:
    """Write ``bode_STEM.png`` and ``nichols_STEM.png`` for the first system; yield the paths."""
    # The Nyquist frequency is excluded: at this frequency, a sampled integrator whose period is an
    # even number of samples responds as at zero frequency.
    highest = 0.999 * np.pi / linear.period
    omega = np.geomspace(1e-2, highest, _POINTS)
    if linear.phases:
        gains = fundamental_gains(linear, omega)
    else:
        gains = close(loop_gains(make_loops(linear), np.zeros(_POINTS, np.int64), omega))[1].L
    for name, figure in (
        ("bode", plot_bode(omega, gains, linear.inputs)),
        ("nichols", plot_nichols(gains, linear.inputs)),
    ):
        path = folder / f"{name}_{stem}.png"
        write_png(figure, path)
        yield path


@styled
def plot_bode(omega: Floats, gains: NDArray[np.complex128], inputs: Sequence[str]) -> Figure:
    """Plot gain and phase of loops against frequency (rad/s); ``gains`` is [frequency, loop]."""
    figure = new_figure(4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for i, name in enumerate(inputs):
        upper.semilogx(
            omega,
            20.0 * np.log10(np.abs(gains[:, i])),
            color=CYCLE[i % len(CYCLE)],
            label=name.replace("_", " "),
        )
        lower.semilogx(omega, _phase(gains[:, i]), color=CYCLE[i % len(CYCLE)])
    upper.axhline(0.0, color=INK, linewidth=0.6)
    lower.axhline(-180.0, color=INK, linewidth=0.6)
    upper.set_ylabel("loop gain, dB")
    lower.set_ylabel("phase, deg")
    lower.set_xlabel("frequency, rad/s")
    upper.legend()
    return figure


@styled
def plot_nichols(gains: NDArray[np.complex128], inputs: Sequence[str]) -> Figure:
    """Plot the gain of loops against their phase; crosses mark neutral stability."""
    figure = new_figure(4.2)
    axes = figure.subplots()
    turns = set()
    for i, name in enumerate(inputs):
        phase = _phase(gains[:, i])
        gain = 20.0 * np.log10(np.abs(gains[:, i]))
        axes.plot(phase, gain, color=CYCLE[i % len(CYCLE)], label=name.replace("_", " "))
        near = np.abs(gain) < 40.0
        turns |= set(np.round((phase[near] + 180.0) / 360.0).astype(int).tolist())
    for turn in sorted(turns):
        axes.plot(-180.0 + 360.0 * turn, 0.0, "+", color=INK, markersize=8.0)
    axes.set_ylim(-50.0, 70.0)
    axes.set_xlabel("phase, deg")
    axes.set_ylabel("loop gain, dB")
    axes.legend()
    return figure


def _phase(gains: NDArray[np.complex128]) -> Floats:
    """Return the continuous phase, deg, starting between -360 and 0 deg."""
    phase = np.rad2deg(np.unwrap(np.angle(gains)))
    return np.asarray(phase - 360.0 * np.ceil(phase[0] / 360.0))
