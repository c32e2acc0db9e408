"""The page of a tuned controller: what it gains on fresh flights, what it is traded against, where its numbers lie."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.topics.figure_style import BLUE, INK, SKY, VERMILION, new_figure, styled
from abhv_mc.topics.formatting import significant
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.section import Bullets, FigureText, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn
from abhv_mc_tune.tuning import TuneFound


def make_tune_answer(found: TuneFound) -> Answer:
    """What tuning says."""
    items = *_answers(found), Picture("front"), _sides(found), _numbers(found)
    title = f"{controller_label(found.controller)} tuned for {found.aim.phrase}"
    return Answer(title, "Tuning", Section("Answer", items), _draw(found))


def _draw(found: TuneFound) -> Iterator[Drawn]:
    scores, block = found.tuning.scores, found.block
    aim, usage = (
        f"{found.metrics[entry.metric].label_with_unit}, {100 * entry.quantile:g} %"
        for entry in (block.minimise, block.usage)
    )
    front = FigureText(
        "front",
        "Error against usage",
        "Every candidate on the common flights. The Pareto front joins those within all limits that no other such "
        "candidate beats in both. Candidates far outside are not drawn.",
    )
    points = scores.usage, scores.objective, scores.allowed
    yield front, plot_front((usage, aim), points, found.tuning.front, found.tuning.best)


@styled
def plot_front(
    labels: tuple[str, str],
    points: tuple[Floats, Floats, NDArray[np.bool_]],
    front: NDArray[np.intp],
    best: int,
) -> Figure:
    """Candidates by usage and error: those beyond a limit, those within all, the front, the start and the best."""
    usage, error, allowed = points
    figure = new_figure(3.4)
    axes = figure.subplots()
    shown = np.isfinite(usage) & np.isfinite(error)
    axes.plot(
        usage[shown & ~allowed],
        error[shown & ~allowed],
        ".",
        color=INK,
        alpha=0.3,
        label="beyond a limit",
    )
    axes.plot(
        usage[shown & allowed], error[shown & allowed], ".", color=SKY, label="within all limits"
    )
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
    if shown.any():  # far candidates would squeeze what matters into a corner
        for near, values in ((axes.set_xlim, usage), (axes.set_ylim, error)):
            low = float(values[shown].min())
            marks = values[[0, best]]
            far = float(marks[np.isfinite(marks)].max(initial=low))
            near(
                low - 0.1 * (far - low),
                far + 1.5 * max(far - low, 0.1 * abs(far)),
            )
    figure.legend(loc="outside right upper")
    return figure


def _answers(found: TuneFound) -> tuple[Lead, Bullets]:
    gain, block, aim = found.difference, found.block, found.sides[0]
    interval = f"difference {gain.value:.4g}, 95 % interval {gain.low:.4g} .. {gain.high:.4g}"
    quantile = f"{100 * block.minimise.quantile:g} % quantile of {found.aim.phrase}"
    fresh = f"On {block.validation} fresh flights the {quantile}"
    broken = [side.words for side in found.sides if not side.keeps]
    change = f"{fresh} is {aim.best:.4g} instead of {found.aim.with_unit(f'{aim.start:.4g}')} ({interval})."
    if found.shown:
        answers = [change]
    elif found.tuning.best == 0:
        answers = ["The start is kept: no candidate was better on the common flights."]
    elif not found.tuning.scores.allowed.any():
        answers = [
            "The start is kept: no candidate kept every limit. The nearest to it is shown, which breaks: "
            f"{'; '.join(broken)}.",
            change,
        ]
    else:
        why = f"beyond its limits on fresh flights: {'; '.join(broken)}"
        answers = [
            f"The start is kept: the candidate is {why if broken else 'not shown to be better'}.",
            change,
        ]
    ends = found.numbers.at_ends(found.tuning.place)
    if ends:
        answers.append(
            f"At an end of their range: {', '.join(ends)}. Better numbers may lie beyond: give these a larger factor, "
            "unless the limit of the range is meant."
        )
    if found.shown:
        answers.append(
            "It is shown for this campaign's dispersions, mission and vehicle, and within the limits asked for; not "
            "that nothing is better, nor that it holds elsewhere."
        )
    return Lead(answers[0]), Bullets(tuple(answers[1:]))


def _sides(found: TuneFound) -> Table:
    rows = []
    for side in found.sides:
        limit, kept = "", ""
        if side.limit is not None:
            limit, kept = (
                f"{'above' if side.floor else 'below'} {side.limit:.4g}",
                "yes" if side.keeps else "no",
            )
        rows.append(
            [side.words, significant(side.start, 5), significant(side.best, 5), limit, kept]
        )
    caption = (
        "Metrics on the fresh flights, the same for both; flights that ended early count as the worst. Stability "
        "margins are the least over all loops and points; 0 means unstable, or no steady flight."
    )
    heads = ("what", "start", "result", "limit", "kept")
    return make_table("Start and result", caption, heads, rows)


def _numbers(found: TuneFound) -> Table:
    numbers, place = found.numbers, found.tuning.place
    columns = [
        numbers.values(point)
        for point in (0.0 * place, np.full_like(place, -1.0), place, np.ones_like(place))
    ]
    ends = numbers.at_ends(place)
    caption = "Each was varied by its factor either way, on a logarithmic scale."
    heads = ("number", "start", "low end", "result", "high end", "")
    rows = [
        [
            key,
            *(str(column[key]) for column in columns),
            "at the end of its range" if key in ends else "",
        ]
        for key in columns[0]
    ]
    return make_table("Free numbers", caption, heads, rows)
