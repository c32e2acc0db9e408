"""How far apart two controllers are, flight by flight."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, PercentFormatter

from abhv_mc.array_types import Floats
from abhv_mc.topics.figure_style import INK, MARKERS, distribution_steps, legend_below, new_panels, styled

_ENDS = (0.005, 0.995)  # quantiles of the differences that the axis spans: a few flights far out would hide the rest


@dataclass(frozen=True)
class DifferencePanel:
    """One metric: the differences of each pair of controllers, and their median with its interval."""

    label: str
    differences: Mapping[str, Floats]  # pair -> [flight]; infinite where only one of the two was lost
    medians: Mapping[str, tuple[float | None, float | None, float | None]]  # value, low and high end; None: open


@styled
def plot_differences(
    panels: Sequence[DifferencePanel], labels: Mapping[str, str], colors: Mapping[str, str], zero: str
) -> Figure:
    """Share of flights at or below each difference, a panel a metric; a mark with its interval for the median.

    ``zero`` says what the line at no difference is.
    """
    columns = 3 if len(panels) > 4 else 2
    figure, grid = new_panels(len(panels), columns, 1.25, between=(0.25, 0.55), top=0.12, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        ends = [0.0]
        for i, (name, values) in enumerate(panel.differences.items()):
            axes.step(*distribution_steps(values), where="post", color=colors[name], label=labels[name])
            finite = values[np.isfinite(values)]
            ends += np.quantile(finite, _ENDS).tolist() if finite.size else []
            middle, low, high = panel.medians[name]
            if middle is not None:
                ends += [end for end in (low, middle, high) if end is not None]
                arms = [[0.0 if low is None else middle - low], [0.0 if high is None else high - middle]]
                mark = MARKERS[i % len(MARKERS)]
                axes.errorbar(middle, 0.5, xerr=arms, fmt=mark, color=colors[name], markersize=4.5, elinewidth=1.6)
        room = 0.06 * (max(ends) - min(ends) or 1.0)
        axes.set_xlim(min(ends) - room, max(ends) + room)
        axes.xaxis.get_major_locator().set_params(nbins=4)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.axvline(0.0, color=INK, linewidth=0.8, linestyle=(0, (1, 1)), label=zero)
        axes.set_xlabel(panel.label)
        axes.set_ylim(-0.02, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    for row in grid:
        row[0].set_ylabel("share of flights")
    legend_below(figure, *grid.flat)
    return figure
