"""Single flights over time: the nominal one, and what a search or an explanation sets beside it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import CYCLE, INK, label_lowest, legend_below, new_panels, pad_if_flat, styled

_BESIDE = (CYCLE[1], CYCLE[0], *CYCLE[2:])  # the worst, or what makes a flight fail, stands out


@styled
def plot_flights(times: Floats, panels: Mapping[str, Floats], labels: Sequence[str], title: str = "") -> Figure:
    """Channels ``[flight, time]`` over time, NaN after a flight's end: the nominal flight first, dashed.

    Two columns; a cross marks where a flight ended early.
    """
    figure, grid = new_panels(
        len(panels), 2, 1.2, between=(0.68, 0.2), top=0.24 + 0.18 * bool(title) * (1 + title.count("\n")), sharex=True
    )
    figure.suptitle(title, fontsize=8.5)
    for axes, (label, curves) in zip(grid.flat, panels.items(), strict=False):
        for i, (curve, name) in enumerate(zip(curves, labels, strict=True)):
            look: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}
            if i:
                look = {"color": _BESIDE[(i - 1) % len(_BESIDE)], "linewidth": 1.5 if i == 1 else 0.9}
            axes.plot(times, curve, label=name, **look)
            flown = np.flatnonzero(np.isfinite(curve))
            if flown.size and flown[-1] < times.size - 1:
                axes.plot(times[flown[-1]], curve[flown[-1]], "x", color=look["color"], markersize=5)
        axes.set_ylabel(label)
        pad_if_flat(axes)
    label_lowest(grid, len(panels), "time (s)")
    legend_below(figure, grid[0, 0])
    return figure
