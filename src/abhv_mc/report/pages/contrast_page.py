"""Records, tables and figures of a comparison of two campaigns on different samples."""

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
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.figure_style import (
    CYCLE,
    INK,
    PERCENT,
    distribution_steps,
    legend_below,
    line_look,
    make_value_axis,
    new_panels,
    styled,
)
from abhv_mc.topics.formatting import count_of, estimate, fixed, percent
from abhv_mc.topics.names import full_labels
from abhv_mc.topics.section import (
    Cell,
    FigureText,
    Fold,
    Item,
    Picture,
    Section,
    Table,
    grouped,
    interval_cell,
    make_records,
)
from abhv_mc.topics.topic import Drawn

_MOST_PANELS = 6
# line styles of the first and the second campaign
_STYLES: tuple[Literal["--"], Literal["-"]] = ("--", "-")
_DASH = "\N{EM DASH}"


class Panel(NamedTuple):
    """Panel of one metric in the figure."""

    label: str
    metric: str
    limits: tuple[float, ...]
    unit: str


def contrast_section(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Section:
    """Return the section with changed inputs, changed verdicts and tables."""
    labels = _labels(a, b, contrast)
    changes = [change for change in contrast.changes if not change.startswith("name: ")]
    texts = [
        *change_texts(contrast, labels),
        *(("Changed inputs", change) for change in changes),
        ("Differences", "second minus first, 95 % intervals (Newcombe, bootstrap), not paired"),
    ]
    differing, every = (
        _quantile_table(a, contrast, labels, titles, shows_all=shows_all)
        for shows_all in (False, True)
    )
    tables = [_verdict_table(a, contrast, labels, titles), differing]
    items: list[Item] = [table for table in tables if table.groups]
    items += [Fold(every.title, (every,))] if every.groups else []
    return Section("Summary", (make_records(texts), Picture("distributions"), *items))


def _labels(a: FlownCampaign, b: FlownCampaign, contrast: Contrast) -> list[str]:
    labels = []
    for pair in contrast.contrasted:
        label_a, label_b = (
            full_labels(results.folder, [name])[name]
            for results, name in zip((a, b), pair.controllers, strict=True)
        )
        labels.append(label_a if label_a == label_b else f"{label_a} -> {label_b}")
    return labels


def change_texts(contrast: Contrast, labels: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each controller's changed verdicts and significant changes of failure shares."""
    for label, controller in zip(labels, contrast.contrasted, strict=True):
        items = controller.requirements
        changes = [
            (f"{item.before.status} -> {item.after.status}", f"{label}: {_change(item)}")
            for item in items
            if item.after.status != item.before.status or _is_shown(item.share_difference)
        ]
        yield from changes
        if items and not changes:
            passed = sum(item.after.status == "PASS" for item in items)
            yield "Verdicts unchanged", f"{label}: {passed} PASS of {len(items)}"
    if not any(controller.requirements for controller in contrast.contrasted):
        yield "Requirements", "none"


def _change(item: ContrastRequirement) -> str:
    before, after = (percent(side.failures / side.flights, 2) for side in (item.before, item.after))
    difference = "significant" if _is_shown(item.share_difference) else "not significant"
    return f"{item.words}, failed {before} -> {after} ({difference})"


def _verdict_table(
    a: FlownCampaign, contrast: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    flights = set(_flight_counts(contrast))
    groups = []
    for i, asked in enumerate(contrast.contrasted[0].requirements):
        rows = []
        for label, controller in zip(labels, contrast.contrasted, strict=True):
            item = controller.requirements[i]
            sides = (_side(side, len(flights) == 1) for side in (item.before, item.after))
            difference = Cell(*_share_texts(item.share_difference))
            rows.append((Cell(label), *map(Cell, sides), difference))
        groups.append(
            grouped(rows, Cell(f"{asked.words} in {percent(asked.probability)}", head=True))
        )
    counts = ""
    if len(flights) == 1:
        first, second = flights.pop()
        counts = f", in {fixed(first, 0)} and {fixed(second, 0)} flights"
    return Table(
        "Verdicts",
        ("Requirement", a.campaign.kind.capitalize(), *titles, "Difference"),
        tuple(groups),
        "Verdicts and failures by the requirements of the first campaign"
        f"{counts}, and the difference of the failure shares",
        numbers=False,
    )


def _flight_counts(contrast: Contrast) -> Iterator[tuple[int, int]]:
    """Yield the numbers of flights in both campaigns for each requirement and controller."""
    for controller in contrast.contrasted:
        for item in controller.requirements:
            yield item.before.flights, item.after.flights


def _share_texts(difference: Interval) -> tuple[str, str]:
    low, high = percent(difference.low, 2), percent(difference.high, 2)
    return percent(difference.value, 2), f"{low} to {high}"


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


def _side(verdict: SideVerdict, is_count: bool) -> str:
    """Return the verdict and failure count, with the number of flights unless ``is_count``."""
    failures = fixed(verdict.failures, 0)
    count = failures if is_count else count_of(verdict.failures, verdict.flights)
    return f"{verdict.status}, {count}"


def _is_shown(difference: Interval | None) -> bool:
    return difference is not None and not difference.low <= 0.0 <= difference.high


def _quantile_table(
    a: FlownCampaign,
    contrast: Contrast,
    labels: Sequence[str],
    titles: tuple[str, str],
    *,
    shows_all: bool,
) -> Table:
    """Return a table of all quantiles, or of the differing quantiles of required metrics."""
    groups = []
    for metric, description in contrast.words.items():
        rows = [
            (
                Cell(label),
                Cell(f"{level[1:]} %"),
                *(Cell(estimate(end)) for end in (pair.before, pair.after)),
                interval_cell(pair.difference) if pair.difference else Cell(_DASH),
            )
            for label, controller in zip(labels, contrast.contrasted, strict=True)
            for level, pair in controller.metrics[metric].items()
            if shows_all or (metric in a.asked and _is_shown(pair.difference))
        ]
        groups += [grouped(rows, Cell(_with_unit(description), head=True))] if rows else []
    title = "All quantiles" if shows_all else "Quantiles with a shown difference"
    caption = f"{title}, of the required metrics"
    if shows_all:
        dash = "fewer than five flights lie beyond the quantile, or early terminations reach it"
        caption = f"{title}. A dash means: {dash}"
    return Table(
        title,
        ("Metric", a.campaign.kind.capitalize(), "Quantile", *titles, "Difference"),
        tuple(groups),
        caption,
    )


def _with_unit(description: Mapping[str, str]) -> str:
    unit = description["unit"].removeprefix("-")
    return f"{description['label']} ({unit})" if unit else description["label"]


def contrast_figures(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Iterator[Drawn]:
    """Yield the figure with the distributions of both campaigns.

    The figure shows the required metrics or, without requirements, the leading metrics.
    """
    metrics = [name for name in a.asked if name in contrast.words][:_MOST_PANELS]
    if not metrics:
        return
    labels = _labels(a, b, contrast)
    flights = [select_flights(a, b, *pair.controllers) for pair in contrast.contrasted]
    panels = [
        Panel(
            label=record.label_with_unit,
            metric=record.name,
            limits=tuple(a.campaign.limits_of(record.name)),
            unit=record.with_unit("").strip(),
        )
        for record in (a.campaign.metrics[name] for name in metrics)
    ]
    caption = (
        "Share of flights at or below each value. If a curve ends below 100 %, the other flights "
        "terminated early."
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
                    where="post",
                    **line_look(i, len(labels)) | {"linestyle": style},
                )
        make_value_axis(axes, panel.label, drawn, limits=panel.limits, unit=panel.unit)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=PERCENT))
    for row in grid:
        row[0].set_ylabel("share of flights")
    entries = [Line2D([], [], color=CYCLE[i % len(CYCLE)]) for i in range(len(labels))]
    entries += [Line2D([], [], color=INK, linestyle=style) for style in _STYLES]
    legend_below(figure, *grid.flat, more=zip([*labels, *titles], entries, strict=True))
    return figure
