"""Flights after a failure: who still flies, and how."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.failure_case import NO_FAILURE
from abhv_mc.folder.flown_campaign import FlownCampaign, read_histories
from abhv_mc.topics.failure_cases.model import FailureCases, cases_by_frequency, drawn_cases
from abhv_mc.topics.figure_bands import off_reference
from abhv_mc.topics.figure_style import DASHES, INK, controller_colors, label_lowest, legend_below, new_panels, styled
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_MOST_CASES = 8  # the most frequent
_FEWEST_KEPT = 5  # histories of a case that make a band
_CHANNELS = (
    ("altitude_m", "altitude error (m)", "altitude_reference_m"),
    ("angle_of_attack_deg", "angle of attack (deg)", ""),
    ("bank_deg", "bank (deg)", ""),
    ("sideslip_deg", "sideslip (deg)", ""),
)


@dataclass(frozen=True)
class CasePanel:
    """Share still flying of one case, by controller."""

    title: str
    curves: Mapping[str, Floats]  # controller -> [time]


@dataclass(frozen=True)
class CaseBand:
    """Smallest, median and largest value of a channel in one case, by controller."""

    title: str
    label: str
    bands: Mapping[str, Floats]  # controller -> [3, time]


@styled
def plot_survival(
    times: Floats, panels: Sequence[CasePanel], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """Share still flying against the time since the failure, one panel a case."""
    figure, grid = new_panels(len(panels), min(2, len(panels)), 1.0, between=(0.3, 0.55), sharex=True, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        for i, name in enumerate(labels):
            if name in panel.curves:
                share = 100.0 * panel.curves[name]
                axes.plot(times, share, color=colors[name], linestyle=DASHES[i % len(DASHES)], label=labels[name])
        axes.set_title(panel.title, fontsize=8)
        axes.set_ylim(-3.0, 103.0)
    for axes in grid[:, 0]:
        axes.set_ylabel("still flying (%)")
    label_lowest(grid, len(panels), "time since the first failure (s)")
    legend_below(figure, *grid.flat[: len(panels)])
    return figure


@styled
def plot_bands(
    times: Floats, rows: Sequence[Sequence[CaseBand]], labels: Mapping[str, str], colors: Mapping[str, str]
) -> Figure:
    """One row a channel, one column a case."""
    columns = len(rows[0])
    figure, grid = new_panels(len(rows) * columns, columns, 1.2, between=(0.2, 0.2), sharex=True, sharey="row")
    for r, row in enumerate(rows):
        for axes, band in zip(grid[r], row, strict=True):
            for name, table in band.bands.items():
                axes.fill_between(times, table[0], table[2], color=colors[name], alpha=0.15, linewidth=0)
                axes.plot(times, table[1], color=colors[name], label=labels[name])
            axes.axvline(0.0, color=INK, linewidth=0.5)
            if r == 0:
                axes.set_title(band.title, fontsize=8)
        grid[r, 0].set_ylabel(row[0].label)
    label_lowest(grid, len(rows) * columns, "time since the failure (s)")
    legend_below(figure, *grid.flat)
    return figure


def still_flying(after: Floats, lost: NDArray[np.bool_], times: Floats) -> Floats:
    """Share of flights still flying at ``times`` after their failure (Kaplan and Meier, JASA 53, 1958).

    after: time from failure to the flight's end, s, [flight]; lost: whether it was lost then, or its mission was over.
    """
    share, result, order = 1.0, np.empty(times.size), np.sort(np.unique(after[lost]))
    steps = []
    for moment in order:
        share *= 1.0 - np.sum(lost & (after == moment)) / np.sum(after >= moment)
        steps.append(share)
    place = np.searchsorted(order, times, side="right")
    levels = np.array([1.0, *steps])
    result[:] = levels[place]
    return np.where((times <= after.max(initial=0.0)) | (result == 0.0), result, np.nan)


def draw(found: FailureCases, names: Names) -> Iterator[tuple[FigureText, Figure]]:
    """Survival and bands of each case over the time since its first failure."""
    if found.source is None:
        return
    results, labels = found.source, names.controllers
    colors = controller_colors(tuple(labels))
    cases, first = drawn_cases(results)
    shown = [case for case in cases_by_frequency(cases) if case != NO_FAILURE][:_MOST_CASES]
    if not shown:
        return
    longest = float(results.reference["time"][-1])
    times = np.linspace(0.0, longest, 400)
    panels = []
    for case in shown:
        curves = {}
        for name in results.controllers:
            flights = results.flights[name]
            after = flights.end_time - first[flights.flight]
            inside = (cases[flights.flight] == case) & (after >= 0.0)
            if inside.any():
                curves[name] = still_flying(after[inside], flights.failed[inside], times)
        panels.append(CasePanel(f"{case} ({int(np.sum(cases == case))} flights)", curves))
    text = FigureText(
        "failure_survival",
        "Who still flies after a failure",
        "Share of the flights of each case that still fly at a time after their first failure; flights whose mission "
        "is over by then no longer count (Kaplan and Meier's estimate). Where two failures were drawn, the second "
        "comes later.",
    )
    yield text, plot_survival(times, panels, labels, colors)
    yield from _bands(results, shown, (cases, first), labels, colors)


def _bands(
    results: FlownCampaign,
    shown: list[str],
    drawn: tuple[NDArray[np.str_], Floats],
    labels: Mapping[str, str],
    colors: Mapping[str, str],
) -> Iterator[tuple[FigureText, Figure]]:
    """Median and extremes of the kept histories about their first failure."""
    cases, first = drawn
    kept = {name: read_histories(results.folder, name) for name in results.controllers}
    grid = np.arange(-2.0, 20.0, 0.25)
    rows: list[list[CaseBand]] = []
    single = [case for case in shown if " + " not in case][:4]
    clock = results.reference["time"]
    for channel, label, given in _CHANNELS:
        row, less = [], results.reference[given] if given else None
        for case in single:
            bands = {}
            for name in results.controllers:
                held = [
                    np.interp(
                        grid,
                        h["time"] - first[k],
                        off_reference(h["time"], h[channel], clock, less),
                        left=np.nan,
                        right=np.nan,
                    )
                    for k, h in kept[name].items()
                    if channel in h and cases[k] == case
                ]
                if len(held) >= _FEWEST_KEPT:
                    bands[name] = _extremes(np.array(held))
            row.append(CaseBand(case, label, bands))
        rows.append(row)
    if any(band.bands for row in rows for band in row):
        text = FigureText(
            "failure_bands",
            "The flight after a failure",
            "Median (line) and smallest to largest value (band) of the flights whose histories were kept, against the "
            "time since the failure; a flight that was lost leaves the band at its end.",
        )
        yield text, plot_bands(grid, rows, labels, colors)


def _extremes(values: Floats) -> Floats:
    """Smallest, median and largest [3, time] of [flight, time] that may end."""
    result = np.full((3, values.shape[1]), np.nan)
    there = np.isfinite(values).any(axis=0)
    result[:, there] = np.nanmin(values[:, there], 0), np.nanmedian(values[:, there], 0), np.nanmax(values[:, there], 0)
    return result
