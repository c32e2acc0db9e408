"""Sentences, tables and figures of a comparison of two campaigns on different samples."""

from collections.abc import Iterator, Mapping, Sequence
from math import nan
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.report.numbers.compare import select_flights
from abhv_mc.report.numbers.contrast import (
    Contrast,
    ContrastRequirement,
    SideVerdict,
)
from abhv_mc.report.pages.page import make_table
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.figure_style import (
    CYCLE,
    INK,
    PERCENT,
    distribution_steps,
    log_if_wide,
    new_panels,
    put_legend,
    styled,
)
from abhv_mc.topics.formatting import bounds, count_of, estimate, joined, percent
from abhv_mc.topics.names import full_labels
from abhv_mc.topics.section import Bullets, FigureText, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn

_MOST_CHANGES = 4  # maximum number of changed inputs in a sentence
_MOST_PANELS = 6
# line styles of the first and the second campaign
_STYLES: tuple[Literal["--"], Literal["-"]] = ("--", "-")
_DASH = "\N{EM DASH}"


class Panel(NamedTuple):
    """Panel of one metric in the figure."""

    label: str
    metric: str
    limits: tuple[float, ...]


def contrast_section(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Section:
    """Return the section with changed inputs, changed verdicts and tables."""
    labels = _labels(a, b, contrast)
    answers = [*change_sentences(contrast, labels)]
    lead = Lead(answers[0] if answers else "Nothing is required.", tuple(answers[1:4]))
    changes = list(contrast.changes)
    if len(changes) > _MOST_CHANGES:
        changes = [*changes[:_MOST_CHANGES], f"{len(changes) - _MOST_CHANGES} more"]
    sentences = [f"{titles[1]} differs from {titles[0]} in {joined(changes)}."] if changes else []
    sentences.append(
        "The samples differ, so flights are not paired. Differences are second minus first with "
        "95 % intervals: Newcombe's for shares, bootstrap for quantiles. An interval that excludes "
        "0 shows a difference."
    )
    tables = [
        _verdict_table(a, contrast, labels, titles),
        _quantile_table(a, contrast, labels, titles),
    ]
    filled = [table for table in tables if table.groups[0]]
    return Section("Summary", (lead, Bullets(tuple(sentences)), Picture("distributions"), *filled))


def _labels(a: FlownCampaign, b: FlownCampaign, contrast: Contrast) -> list[str]:
    labels = []
    for pair in contrast.contrasted:
        label_a, label_b = (
            full_labels(results.folder, [name])[name]
            for results, name in zip((a, b), pair.controllers, strict=True)
        )
        labels.append(label_a if label_a == label_b else f"{label_a} -> {label_b}")
    return labels


def change_sentences(contrast: Contrast, labels: Sequence[str]) -> Iterator[str]:
    """Yield each controller's changed verdicts, then controllers without a change."""
    same = {}
    for label, controller in zip(labels, contrast.contrasted, strict=True):
        if not controller.requirements:
            return
        missed = [item for item in controller.requirements if _turns(item, "FAIL")]
        met = [item for item in controller.requirements if _turns(item, "PASS")]
        lost, unmissed = (
            [
                item
                for item in controller.requirements
                if (item.before.status, item.after.status) == turn
            ]
            for turn in (("PASS", "NOT SHOWN"), ("FAIL", "NOT SHOWN"))
        )
        changes = [
            f"{verb} {joined([_change(item) for item in items])}"
            for verb, items in (
                ("newly misses", missed),
                ("newly meets", met),
                ("is no longer shown to meet", lost),
                ("is no longer shown to miss", unmissed),
            )
            if items
        ]
        if changes:
            yield f"{label} {'; '.join(changes)}."
        else:
            passed = sum(item.after.status == "PASS" for item in controller.requirements)
            same[label] = f"{passed} of {len(controller.requirements)}"
    for counts in dict.fromkeys(same.values()):
        labels_of = [label for label, passes in same.items() if passes == counts]
        yield f"{joined(labels_of)}: equal verdicts in both campaigns, {counts} PASS."


def _turns(item: ContrastRequirement, status: str) -> bool:
    return item.after.status == status != item.before.status


def _change(item: ContrastRequirement) -> str:
    before, after = item.before, item.after
    shares = " -> ".join(percent(side.failures / side.flights, 2) for side in (before, after))
    return f"{item.words} ({before.status} -> {after.status}, {shares} of the flights fail)"


def _verdict_table(
    a: FlownCampaign, contrast: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    rows = [
        (
            f"{item.words} in {percent(item.probability)}",
            label,
            *map(_side, (item.before, item.after)),
            f"{percent(item.share_difference.value, 2)} ({percent(item.share_difference.low, 2)} "
            f"to {percent(item.share_difference.high, 2)})",
        )
        for i in range(len(contrast.contrasted[0].requirements))
        for label, controller in zip(labels, contrast.contrasted, strict=True)
        for item in (controller.requirements[i],)
    ]
    kind = a.campaign.kind.capitalize()
    heads = ("Requirement", kind, *titles, "Difference of the failure share")
    return make_table("Verdicts", "Requirements of the first campaign", heads, rows)


def contrast_rows(contrast: Contrast) -> Iterator[tuple[object, ...]]:
    """Yield table rows of failure shares and quantiles with their differences."""
    for controller in contrast.contrasted:
        for item in controller.requirements:
            shares = (side.failures / side.flights for side in (item.before, item.after))
            difference = item.share_difference
            interval = difference.value, difference.low, difference.high
            yield (*controller.controllers, item.words, "share that fails", *shares, *interval)
        for metric, levels in controller.metrics.items():
            for level, pair in levels.items():
                ends = pair.before.value, pair.after.value
                interval_of = pair.difference or Interval(nan, nan, nan)
                quantity = f"{level[1:]} % quantile"
                interval = interval_of.value, interval_of.low, interval_of.high
                yield (*controller.controllers, metric, quantity, *ends, *interval)


def _side(verdict: SideVerdict) -> str:
    return f"{verdict.status}, {count_of(verdict.failures, verdict.flights)}"


def _is_shown(difference: Interval | None) -> bool:
    return difference is not None and not difference.low <= 0.0 <= difference.high


def _quantile_table(
    a: FlownCampaign, contrast: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    rows = [
        (
            _with_unit(description),
            label,
            f"{level[1:]} %",
            *(f"{estimate(end)}" for end in (pair.before, pair.after)),
            f"{estimate(pair.difference)} ({bounds(pair.difference)})"
            if pair.difference
            else _DASH,
        )
        for metric, description in contrast.words.items()
        for label, controller in zip(labels, contrast.contrasted, strict=True)
        for level, pair in controller.metrics[metric].items()
        if metric in a.asked or _is_shown(pair.difference)
    ]
    heads = ("Metric", a.campaign.kind.capitalize(), "Quantile", *titles, "Difference")
    caption = (
        "Required metrics, and other metrics with a shown difference. A dash marks a "
        "quantile beyond which fewer than five flights, or only lost flights, lie"
    )
    return make_table("Quantiles", caption, heads, rows)


def _with_unit(description: Mapping[str, str]) -> str:
    unit = description["unit"].removeprefix("-")
    return f"{description['label']} ({unit})" if unit else description["label"]


def contrast_figures(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Iterator[Drawn]:
    """Yield the figure with the distributions of both campaigns.

    It shows the required metrics, or the leading metrics without requirements.
    """
    metrics = [name for name in a.asked if name in contrast.words][:_MOST_PANELS]
    if not metrics:
        return
    labels = _labels(a, b, contrast)
    flights = [select_flights(a, b, *pair.controllers) for pair in contrast.contrasted]
    panels = [
        Panel(a.campaign.metrics[name].label_with_unit, name, tuple(a.campaign.limits_of(name)))
        for name in metrics
    ]
    caption = (
        "Share of flights at or below each value; a curve that ends below 100 % has lost flights. "
        "The vertical line is the limit."
    )
    yield (
        FigureText("distributions", "Distributions of both campaigns", caption),
        plot_contrast(panels, flights, labels, titles),
    )


@styled
def plot_contrast(
    panels: Sequence[Panel],
    flights: Sequence[tuple[ControllerFlights, ControllerFlights]],
    labels: Sequence[str],
    titles: tuple[str, str],
) -> Figure:
    """Plot distribution functions, one panel per metric; the first campaign is dashed."""
    columns = 3 if len(panels) > 4 else 2
    figure, grid = new_panels(len(panels), columns, 1.4, between=(0.25, 0.6), top=0.12, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        drawn = []
        for i, pair in enumerate(flights):
            for style, side in zip(_STYLES, pair, strict=True):
                values = np.where(side.failed, np.inf, side.metrics[panel.metric])
                values = np.where(np.isnan(values), np.inf, values)
                drawn.append(values)
                axes.step(
                    *distribution_steps(values),
                    style,
                    where="post",
                    color=CYCLE[i % len(CYCLE)],
                    zorder=3 + len(labels) - i,  # The first controller is drawn on top.
                )
        for limit in panel.limits:
            axes.axvline(limit, color=INK, linewidth=0.8)
        log_if_wide(axes, "x", drawn)
        axes.set_xlabel(panel.label)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=PERCENT))
    entries = [Line2D([], [], color=CYCLE[i % len(CYCLE)]) for i in range(len(labels))]
    entries += [Line2D([], [], color=INK, linestyle=style) for style in _STYLES]
    put_legend(figure, entries, [*labels, *titles])
    return figure
