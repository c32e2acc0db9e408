"""Flights after a failure: who still flies."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.failure_case import NO_FAILURE
from abhv_mc.topics.failure_cases import FailureCases, cases_by_frequency, drawn_cases
from abhv_mc.topics.figure_style import DASHES, controller_colors, label_lowest, legend_below, new_panels, styled
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_MOST_CASES = 8  # the most frequent


@styled
def plot_survival(times: Floats, panels: Mapping[str, Mapping[str, Floats]], labels: Mapping[str, str]) -> Figure:
    """Share still flying [time] against the time since the failure: a panel a case, a curve a controller."""
    colors = controller_colors(tuple(labels))
    figure, grid = new_panels(len(panels), min(2, len(panels)), 1.0, between=(0.3, 0.55), sharex=True, sharey=True)
    for axes, (title, curves) in zip(grid.flat, panels.items(), strict=False):
        for i, name in enumerate(labels):
            if name in curves:
                share = 100.0 * curves[name]
                axes.plot(times, share, color=colors[name], linestyle=DASHES[i % len(DASHES)], label=labels[name])
        axes.set_title(title, fontsize=8)
        axes.set_ylim(-3.0, 103.0)
    for axes in grid[:, 0]:
        axes.set_ylabel("still flying (%)")
    label_lowest(grid, len(panels), "time since the first failure (s)")
    legend_below(figure, *grid.flat[: len(panels)])
    return figure


def still_flying(after: Floats, lost: NDArray[np.bool_], times: Floats) -> Floats:
    """Share of flights still flying at ``times`` after their failure (Kaplan and Meier, JASA 53, 1958).

    after: time from failure to the flight's end, s, [flight]; lost: whether it was lost then, or its mission was over.
    """
    moments = np.unique(after[lost])
    kept = [1.0 - np.sum(lost & (after == moment)) / np.sum(after >= moment) for moment in moments]
    result = np.cumprod([1.0, *kept])[np.searchsorted(moments, times, side="right")]
    return np.where((times <= after.max(initial=0.0)) | (result == 0.0), result, np.nan)


def draw(_found: FailureCases, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """Survival in each case over the time since its first failure."""
    results = names.results
    cases, first = drawn_cases(results)
    shown = [case for case in cases_by_frequency(cases) if case != NO_FAILURE][:_MOST_CASES]
    if not shown:
        return
    times = np.linspace(0.0, float(results.reference["time"][-1]), 400)
    panels: dict[str, dict[str, Floats]] = {}
    for case in shown:
        curves = panels[f"{case} ({int(np.sum(cases == case))} flights)"] = {}
        for name in results.controllers:
            flights = results.flights[name]
            after = flights.end_time - first[flights.flight]
            inside = (cases[flights.flight] == case) & (after >= 0.0)
            if inside.any():
                curves[name] = still_flying(after[inside], flights.failed[inside], times)
    text = FigureText(
        "failure_survival",
        "Who still flies after a failure",
        "Share of the flights of each case that still fly at a time after their first failure; flights whose mission "
        "is over by then no longer count (Kaplan and Meier's estimate). Where two failures were drawn, the second "
        "comes later.",
    )
    yield text, plot_survival(times, panels, names.controllers)
