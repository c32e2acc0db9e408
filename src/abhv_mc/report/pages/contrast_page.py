"""Two campaigns on different samples as sentences, tables and figures."""

from collections.abc import Iterator, Mapping, Sequence
from math import nan
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.report.numbers.compare import sides
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
from abhv_mc.topics.names import full_labels
from abhv_mc.topics.section import Bullets, FigureText, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn
from abhv_mc.topics.words import bounds, count_of, estimate, joined, percent

_CHANGES = 4  # that are named in a sentence
_ASKED = 6  # panels at most
_STYLES: tuple[Literal["--"], Literal["-"]] = ("--", "-")  # of the first and the second campaign
_DASH = "\N{EM DASH}"


class Panel(NamedTuple):
    """A metric of the figure."""

    label: str
    metric: str
    limits: tuple[float, ...]


def contrast_section(
    a: FlownCampaign, b: FlownCampaign, found: Contrast, titles: tuple[str, str]
) -> Section:
    """Return what differs, who met the requirements before and meets them now, and the tables."""
    labels = _labels(a, b, found)
    answers = [*change_sentences(found, labels)]
    lead = Lead(answers[0] if answers else "Nothing is required.", tuple(answers[1:4]))
    changes = list(found.changes)
    if len(changes) > _CHANGES:
        changes = [*changes[:_CHANGES], f"{len(changes) - _CHANGES} more"]
    told = [f"{titles[1]} differs from {titles[0]} in {joined(changes)}."] if changes else []
    told.append(
        "The samples differ, so flights are not paired. Differences are the second less the first with 95 % intervals: "
        "Newcombe's of shares, bootstrap of quantiles. An interval without 0 shows a difference."
    )
    tables = [
        _verdict_table(a, found, labels, titles),
        _quantile_table(a, found, labels, titles),
    ]
    shown = [table for table in tables if table.groups[0]]
    return Section("Answer", (lead, Bullets(tuple(told)), Picture("distributions"), *shown))


def _labels(a: FlownCampaign, b: FlownCampaign, found: Contrast) -> list[str]:
    labels = []
    for each in found.contrasted:
        one, other = (
            full_labels(of.folder, [name])[name]
            for of, name in zip((a, b), each.controllers, strict=True)
        )
        labels.append(one if one == other else f"{one} -> {other}")
    return labels


def change_sentences(found: Contrast, labels: Sequence[str]) -> Iterator[str]:
    """Yield what each controller newly misses or meets, then who has the same verdicts in both campaigns."""
    same = {}
    for label, each in zip(labels, found.contrasted, strict=True):
        if not each.requirements:
            return
        missed = [item for item in each.requirements if _turns(item, "FAIL")]
        met = [item for item in each.requirements if _turns(item, "PASS")]
        lost, unmissed = (
            [item for item in each.requirements if (item.before.status, item.after.status) == turn]
            for turn in (("PASS", "NOT SHOWN"), ("FAIL", "NOT SHOWN"))
        )
        parts = [
            f"{verb} {joined([_change(item) for item in items])}"
            for verb, items in (
                ("newly misses", missed),
                ("newly meets", met),
                ("is no longer shown to meet", lost),
                ("is no longer shown to miss", unmissed),
            )
            if items
        ]
        if parts:
            yield f"{label} {'; '.join(parts)}."
        else:
            passed = sum(item.after.status == "PASS" for item in each.requirements)
            same[label] = f"{passed} of {len(each.requirements)}"
    for words in dict.fromkeys(same.values()):
        who = [label for label, held in same.items() if held == words]
        yield f"{joined(who)}: the same verdicts in both campaigns, {words} PASS."


def _turns(item: ContrastRequirement, status: str) -> bool:
    return item.after.status == status != item.before.status


def _change(item: ContrastRequirement) -> str:
    before, after = item.before, item.after
    shares = " -> ".join(percent(side.failures / side.flights, 2) for side in (before, after))
    return f"{item.words} ({before.status} -> {after.status}, {shares} of the flights fail)"


def _verdict_table(
    a: FlownCampaign, found: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    rows = [
        (
            f"{item.words} in {percent(item.probability)}",
            label,
            *map(_side, (item.before, item.after)),
            f"{percent(item.share_difference.value, 2)} ({percent(item.share_difference.low, 2)} to "
            f"{percent(item.share_difference.high, 2)})",
        )
        for i in range(len(found.contrasted[0].requirements))
        for label, each in zip(labels, found.contrasted, strict=True)
        for item in (each.requirements[i],)
    ]
    kind = a.campaign.kind.capitalize()
    heads = ("Requirement", kind, *titles, "Difference of the share that fails")
    return make_table("Verdicts", "Requirements of the first campaign in both", heads, rows)


def contrast_rows(found: Contrast) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a comparison's table: shares that fail, and quantiles, each with its difference."""
    for each in found.contrasted:
        for item in each.requirements:
            shares = (side.failures / side.flights for side in (item.before, item.after))
            difference = item.share_difference
            interval = difference.value, difference.low, difference.high
            yield (*each.controllers, item.words, "share that fails", *shares, *interval)
        for metric, levels in each.metrics.items():
            for level, pair in levels.items():
                ends = pair.before.value, pair.after.value
                shown = pair.difference or Interval(nan, nan, nan)
                quantity = f"{level[1:]} % quantile"
                interval = shown.value, shown.low, shown.high
                yield (*each.controllers, metric, quantity, *ends, *interval)


def _side(found: SideVerdict) -> str:
    return f"{found.status}, {count_of(found.failures, found.flights)}"


def _is_shown(difference: Interval | None) -> bool:
    return difference is not None and not difference.low <= 0.0 <= difference.high


def _quantile_table(
    a: FlownCampaign, found: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    rows = [
        (
            _with_unit(words),
            label,
            f"{level[1:]} %",
            *(f"{estimate(end)}" for end in (pair.before, pair.after)),
            f"{estimate(pair.difference)} ({bounds(pair.difference)})"
            if pair.difference
            else _DASH,
        )
        for metric, words in found.words.items()
        for label, each in zip(labels, found.contrasted, strict=True)
        for level, pair in each.metrics[metric].items()
        if metric in a.asked or _is_shown(pair.difference)
    ]
    heads = ("Metric", a.campaign.kind.capitalize(), "Quantile", *titles, "Difference")
    caption = (
        "Of other metrics than the required ones, differences that are shown. A dash: fewer than five flights lie "
        "beyond the quantile, or lost flights reach it"
    )
    return make_table("Quantiles", caption, heads, rows)


def _with_unit(words: Mapping[str, str]) -> str:
    unit = words["unit"].removeprefix("-")
    return f"{words['label']} ({unit})" if unit else words["label"]


def contrast_figures(
    a: FlownCampaign, b: FlownCampaign, found: Contrast, titles: tuple[str, str]
) -> Iterator[Drawn]:
    """Yield the distributions of the required metrics, or of the tracking errors, of both campaigns."""
    metrics = [name for name in a.asked if name in found.words][:_ASKED]
    if not metrics:
        return
    labels = _labels(a, b, found)
    flights = [sides(a, b, *each.controllers) for each in found.contrasted]
    panels = [
        Panel(a.campaign.metrics[name].label_with_unit, name, tuple(a.campaign.limits_of(name)))
        for name in metrics
    ]
    caption = (
        "Share of flights at or below each value; lines at the top that end below 100 % have lost flights. "
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
    """Distribution functions, a panel a metric: colours are controllers, the first campaign is dashed."""
    columns = 3 if len(panels) > 4 else 2
    figure, grid = new_panels(len(panels), columns, 1.4, between=(0.25, 0.6), top=0.12, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        drawn = []
        for i, pair in enumerate(flights):
            for style, each in zip(_STYLES, pair, strict=True):
                values = np.where(each.failed, np.inf, each.metrics[panel.metric])
                values = np.where(np.isnan(values), np.inf, values)
                drawn.append(values)
                axes.step(
                    *distribution_steps(values),
                    style,
                    where="post",
                    color=CYCLE[i % len(CYCLE)],
                    zorder=3 + len(labels) - i,  # the subject on top
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
