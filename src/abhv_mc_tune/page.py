"""Page about a tuned controller: improvement on new flights, Pareto front, parameters."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.topics.figure_style import BLUE, INK, SKY, VERMILION, new_figure, styled
from abhv_mc.topics.formatting import fixed, significant
from abhv_mc.topics.topic import (
    Drawn,
    FigureText,
    Picture,
    Records,
    Section,
    Table,
    controller_label,
    make_records,
)
from abhv_mc_tune.tuning import TuneFound


def make_tune_answer(result: TuneFound) -> Answer:
    """Return the content of the page for a tuning run."""
    items = _answers(result), Picture("front"), _comparisons(result), _numbers(result)
    return Answer(
        f"{controller_label(result.controller)} tuned for {result.objective.phrase}",
        "Tuning",
        Section("Answer", items),
        _draw(result),
    )


def _draw(result: TuneFound) -> Iterator[Drawn]:
    """Yield the figure of the Pareto front."""
    scores = result.tuning.scores
    block = result.block
    objective, usage = (
        f"{result.metrics[entry.metric].label_with_unit}, {100 * entry.quantile:g} %"
        for entry in (block.minimise, block.usage)
    )
    front = FigureText(
        "front",
        "Error against control effort",
        "All candidates on the common flights. The Pareto front connects the candidates within "
        "all limits that no other such candidate improves in both quantities. Distant candidates "
        "are not drawn.",
    )
    points = scores.usage, scores.objective, scores.allowed
    yield front, plot_front((usage, objective), points, result.tuning.front, result.tuning.best)


@styled
def plot_front(
    labels: tuple[str, str],
    points: tuple[Floats, Floats, NDArray[np.bool_]],
    front: NDArray[np.intp],
    best: int,
) -> Figure:
    """Plot error against control effort of all candidates; mark front, start and result.

    ``points`` contains control effort, error and feasibility [candidate]; ``front`` contains
    indices.
    """
    usage, error, allowed = points
    figure = new_figure(3.4)
    axes = figure.subplots()
    finite = np.isfinite(usage) & np.isfinite(error)
    for mask, color, alpha, label in (
        (finite & ~allowed, INK, 0.3, "outside a limit"),
        (finite & allowed, SKY, 1.0, "within all limits"),
    ):
        axes.plot(usage[mask], error[mask], ".", color=color, alpha=alpha, label=label)
    axes.plot(
        usage[front],
        error[front],
        color=BLUE,
        linewidth=1.2,
        drawstyle="steps-post",
        label="Pareto front",
    )
    axes.plot(usage[0], error[0], "s", color=INK, label="start")
    axes.plot(usage[best], error[best], "o", color=VERMILION, label="result", zorder=5)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    if finite.any():  # Distant candidates would compress the relevant range.
        for set_limits, values in ((axes.set_xlim, usage), (axes.set_ylim, error)):
            low = float(values[finite].min())
            marks = values[[0, best]]
            far = float(marks[np.isfinite(marks)].max(initial=low))
            set_limits(
                low - 0.1 * (far - low),
                far + 1.5 * max(far - low, 0.1 * abs(far)),
            )
    figure.legend(loc="outside right upper")
    return figure


def _answers(result: TuneFound) -> Records:
    """Return the improvement on new flights, the missed limits and the scope as records."""
    gain = result.difference
    block = result.block
    main = result.comparisons[0]
    start, best = (result.objective.with_unit(f"{x:.4g}") for x in (main.start, main.best))
    quantile = f"{100 * block.minimise.quantile:g} % quantile of {result.objective.phrase}"
    is_searched = result.tuning.best > 0
    change = (
        f"{start} -> {best}, difference {gain.value:.4g} (95 % interval {gain.low:.4g} to "
        f"{gain.high:.4g})"
    )
    missed = "; ".join(item.label for item in result.comparisons if not item.keeps)
    return make_records(
        (
            ("New file", "written" if result.shown else "none: improvement and limits not shown"),
            ("Objective", quantile),
            (f"On {fixed(block.validation, 0)} new flights", change * is_searched),
            ("Best candidate", "" if is_searched else "the initial parameters"),
            ("Limits missed", missed),
            ("At a bound", ", ".join(result.numbers.at_ends(result.tuning.best_point))),
            ("Scope", "dispersions, mission, vehicle and limits of this campaign"),
        )
    )


def _comparisons(result: TuneFound) -> Table:
    """Return the table of initial value, result and limit of each metric and margin."""
    rows = []
    for item in result.comparisons:
        limit = is_met = ""
        if item.limit is not None:
            limit = f"{'above' if item.floor else 'below'} {item.limit:.4g}"
            is_met = "yes" if item.keeps else "no"
        numbers = significant(item.start, 5), significant(item.best, 5)
        rows.append([item.label, *numbers, limit, is_met])
    caption = (
        "The metrics of the initial and the tuned parameters are computed from the same new "
        "flights; early terminations count as the worst value. Stability margins are the smallest "
        "over all loops and times; 0 means that the loop is unstable or that no trim exists."
    )
    heads = ("metric", "start", "result", "limit", "met")
    return make_table("Start and result", caption, heads, rows)


def _numbers(result: TuneFound) -> Table:
    """Return the table of the free parameters with their ranges."""
    numbers = result.numbers
    best = result.tuning.best_point
    columns = [
        numbers.values(point)
        for point in (0.0 * best, np.full_like(best, -1.0), best, np.ones_like(best))
    ]
    ends = numbers.at_ends(best)
    caption = (
        "Each parameter was varied on a logarithmic scale, from its initial value divided by its "
        "factor to its initial value multiplied by its factor."
    )
    heads = ("parameter", "start", "lower bound", "result", "upper bound", "")
    rows = [
        [
            key,
            *(str(column[key]) for column in columns),
            "at a bound of its range" if key in ends else "",
        ]
        for key in columns[0]
    ]
    return make_table("Free parameters", caption, heads, rows)
