"""Figures of flights after a failure: survival and time histories."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask
from abhv_mc.flights.failure_cases import NO_FAILURE
from abhv_mc.folder.flown_campaign import read_histories
from abhv_mc.statistics.circular import align_flights, unwrap
from abhv_mc.topics.failure_cases import FailureCases, cases_by_frequency, drawn_cases
from abhv_mc.topics.figure_bands import off_reference
from abhv_mc.topics.figure_style import (
    REFERENCE,
    label_lowest,
    legend_below,
    line_look,
    new_panels,
    styled,
    title_panel,
)
from abhv_mc.topics.topic import Drawn, FigureText, Names

_MOST_CASES = 8  # maximum number of failure cases drawn, most frequent first
_MOST_BANDS = 4  # maximum number of single-failure cases drawn with bands
_FEWEST_KEPT = 5  # minimum number of stored histories for a band
_CHANNELS = (  # channels, axis labels and references to subtract
    ("altitude_m", "altitude error (m)", "altitude_reference_m"),
    ("angle_of_attack_deg", "angle of attack (deg)", ""),
    ("bank_deg", "bank (deg)", ""),
    ("sideslip_deg", "sideslip (deg)", ""),
)

Bands = Mapping[
    tuple[int, str, str], Floats
]  # (row of _CHANNELS, case, controller) -> [minimum, median, maximum; time]


@styled
def plot_survival(
    times: Floats, panels: Mapping[str, Mapping[str, Floats]], labels: Mapping[str, str]
) -> Figure:
    """Plot the share of flights still airborne after a failure, one panel per failure case."""
    figure, grid = new_panels(
        len(panels), min(2, len(panels)), 1.0, between=(0.3, 0.55), sharex=True, sharey=True
    )
    for axes, (title, curves) in zip(grid.flat, panels.items(), strict=False):
        for i, name in enumerate(labels):
            if name in curves:
                axes.plot(
                    times, 100.0 * curves[name], label=labels[name], **line_look(i, len(labels))
                )
        title_panel(axes, title)
        axes.set_ylim(-3.0, 103.0)
    for axes in grid[:, 0]:
        axes.set_ylabel("still flying (%)")
    label_lowest(grid, len(panels), "time since the first failure (s)")
    legend_below(figure, *grid.flat[: len(panels)])
    return figure


@styled
def plot_case_bands(
    times: Floats, bands: Bands, cases: Sequence[str], labels: Mapping[str, str]
) -> Figure:
    """Plot channels after a failure, one row per channel and one column per failure case."""
    count = len(_CHANNELS) * len(cases)
    figure, grid = new_panels(
        count, len(cases), 1.2, between=(0.2, 0.24), sharex=True, sharey="row"
    )
    looks = {name: line_look(i, len(labels)) for i, name in enumerate(labels)}
    for (row, case, name), (least, median, most) in bands.items():
        axes, color = grid[row, cases.index(case)], looks[name]["color"]
        axes.fill_between(times, least, most, color=color, alpha=0.15, linewidth=0)
        axes.plot(times, median, label=labels[name], **looks[name])
    for axes in grid.flat:
        axes.axvline(0.0, **REFERENCE)
    for axes, case in zip(grid[0], cases, strict=True):
        title_panel(axes, case)
    for axes, (_, axis_label, _) in zip(grid[:, 0], _CHANNELS, strict=True):
        axes.set_ylabel(axis_label)
    label_lowest(grid, count, "time since the failure (s)")
    legend_below(figure, *grid.flat)
    return figure


def still_flying(after: Floats, lost: Mask, times: Floats) -> Floats:
    """Return the share of flights that are still airborne ``times`` seconds after a failure.

    The share is the Kaplan-Meier estimate, JASA 53 (1958). ``after`` [flight] is the time in s from
    the failure to the end of the flight; ``lost`` [flight] is true if the flight terminated early
    and false if it completed the mission.
    """
    moments = np.unique(after[lost])
    survival_factors = [
        1.0 - np.sum(lost & (after == moment)) / np.sum(after >= moment) for moment in moments
    ]
    result = np.cumprod([1.0, *survival_factors])[np.searchsorted(moments, times, side="right")]
    return np.where((times <= after.max(initial=0.0)) | (result == 0.0), result, np.nan)


def draw(_found: FailureCases, names: Names) -> Iterator[Drawn]:
    """Yield the figures of survival and of channel bands over time since the first failure."""
    results = names.results
    cases, first = drawn_cases(results)
    frequent_cases = [case for case in cases_by_frequency(cases) if case != NO_FAILURE][
        :_MOST_CASES
    ]
    if not frequent_cases:
        return
    times = np.linspace(0.0, float(results.reference["time"][-1]), 400)
    panels: dict[str, dict[str, Floats]] = {}
    for case in frequent_cases:
        curves = panels[f"{case} (flights: {np.sum(cases == case)})"] = {}
        for name in results.controllers:
            flights = results.flights[name]
            after = flights.end_time - first[flights.flight]
            inside = (cases[flights.flight] == case) & (after >= 0.0)
            if inside.any():
                curves[name] = still_flying(after[inside], flights.failed[inside], times)
    text = FigureText(
        "failure_survival",
        "Survival after a failure",
        "Share of the flights of each case that are still airborne, against the time since their "
        "first failure (Kaplan-Meier estimate, which excludes flights whose mission has ended). "
        "In cases with two failures, the second failure occurs later.",
    )
    yield text, plot_survival(times, panels, names.controllers)
    yield from _draw_bands(
        names, [case for case in frequent_cases if " + " not in case][:_MOST_BANDS], cases, first
    )


def _draw_bands(
    names: Names, selected: list[str], cases: NDArray[np.str_], first: Floats
) -> Iterator[Drawn]:
    """Yield the figure with bands of time histories after the first failure.

    No figure is drawn if histories were stored only for the worst or failed flights, because these
    flights are not representative of a failure case.
    """
    results, times, bands = names.results, np.arange(-2.0, 20.0, 0.25), {}
    if any(
        str(item).startswith(("worst", "failed"))
        for item in results.campaign.model.keep.histories.flights
    ):
        return
    clock = results.reference["time"]
    for name in results.controllers:
        histories = read_histories(results.folder, name)
        for case in selected:
            flown = [(first[k], history) for k, history in histories.items() if cases[k] == case]
            for row, (channel, _, reference_name) in enumerate(_CHANNELS):
                off = results.reference[reference_name] if reference_name else None
                period = results.campaign.periods[channel]
                values = [
                    np.interp(
                        times,
                        h["time"] - failure_time,
                        off_reference(h["time"], unwrap(h[channel], period), clock, off),
                        np.nan,
                        np.nan,
                    )
                    for failure_time, h in flown
                    if channel in h
                ]
                if len(values) >= _FEWEST_KEPT:
                    aligned = align_flights(np.array(values), period)
                    has_values = np.isfinite(aligned).any(axis=0)
                    bands[row, case, name] = band = np.full((3, times.size), np.nan)
                    band[:, has_values] = np.nanquantile(
                        aligned[:, has_values], (0.0, 0.5, 1.0), axis=0
                    )
    if bands:
        text = FigureText(
            "failure_bands",
            "Time histories after a failure",
            "Median (line) and smallest to largest value (band) of the flights with stored "
            "histories, against the time since the failure. A flight that terminates early "
            "contributes until its end.",
        )
        yield text, plot_case_bands(times, bands, selected, names.controllers)
