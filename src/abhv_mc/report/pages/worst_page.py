"""Page of a worst-case search: worst value, parameters, convergence, re-run commands."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.report.figures.searches import plot_convergence, plot_worst_point
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.report.pages.searched_flights import flight_figures, flights_table, margin_text
from abhv_mc.search.search_flights import ENDED_EARLY
from abhv_mc.search.worst import WorstFound
from abhv_mc.topics.formatting import fixed, percent, shown_value
from abhv_mc.topics.topic import (
    Drawn,
    FigureText,
    Item,
    Picture,
    Records,
    Section,
    Table,
    controller_label,
    make_records,
)


def make_worst_answer(result: WorstFound, folder: Path) -> Answer:
    """Return the page content of a worst-case search whose flights are in ``folder``."""
    metric = result.metric
    searched = result.severities[: result.searched]
    flights = flights_table(
        result.flights,
        searched,
        len(result.names),
        metric,
        result.controller,
        folder=folder,
        parameters=result.known,
    )
    pictures = (Picture(name) for name in ("convergence", "place", "flights"))
    title = f"Worst case of {controller_label(result.controller)}: {metric.phrase}"
    items: tuple[Item, ...] = (_answers(result), *pictures, _range_table(result), flights)
    return Answer(title, "Worst-case search", Section("Summary", items), _draw(result))


def _draw(result: WorstFound) -> Iterator[Drawn]:
    yield _convergence(result)
    yield _place(result)
    yield from flight_figures(result.drawn, result.metric, result.requirements)


def _answers(result: WorstFound) -> Records:
    """Return the worst flights, their margins and the limitations of the search as records."""
    events = result.probabilities.items()
    flights, random = fixed(result.searched, 0), fixed(result.random, 0)
    return make_records(
        (
            ("Worst flight", f"{_words(result, result.worst)} ({flights} flights of the search)"),
            ("Random flights", f"{_words(result, result.random_worst)} (worst of {random})"),
            *(
                ("Margin", margin_text(item, result.metric, result.value(result.worst)))
                for item in result.requirements
                if not _ended_early(result, result.worst)
            ),
            ("At a bound", ", ".join(result.at_bounds) or "none"),
            ("In every flight", ", ".join(f"{x} ({percent(p)})" for x, p in events)),
            ("Turbulence, noise", "equal in all flights" * (result.flights.names != result.names)),
            ("Other seeds", _other_seeds(result)),
            ("Scope", "the box, not its probability; correlations ignored; no proof of a maximum"),
            ("Not counted", f"{result.failed_to_run} failed to run" * bool(result.failed_to_run)),
        )
    )


def _other_seeds(result: WorstFound) -> str:
    """Return the outcomes at the worst point with other seeds for turbulence and noise."""
    if result.other_seeds is None:
        return ""
    flights, lost, ends = result.other_seeds
    text = f"{fixed(flights, 0)} flights at the worst point, {lost} terminated early"
    if ends is not None:
        low, median, high = (result.metric.with_unit(f"{value:.5g}") for value in ends)
        text += f", {low} to {high}, median {median}"
    return text


def _ended_early(result: WorstFound, flight: int) -> bool:
    return bool(result.severities[flight] >= ENDED_EARLY)


def _words(result: WorstFound, flight: int) -> str:
    """Return a flight's outcome: '20.25 m' or 'terminated early, at 31.2 s (sideslip_limit)'."""
    if _ended_early(result, flight):
        return (
            f"terminated early, at {result.flights.end_time[flight]:.4g} s "
            f"({result.flights.outcome[flight]})"
        )
    return result.metric.with_unit(f"{result.value(flight):.5g}")


def _convergence(result: WorstFound) -> Drawn:
    stages: list[tuple[int, str]] = []
    last = 0
    for step in result.case.history:
        if not stages or stages[-1][1] != step.stage:
            stages.append((last, step.stage))
        last = step.evaluations
    searched, random = (
        _so_far(values, result.sign) for values in np.split(result.severities, [result.searched])
    )
    caption = (
        "Worst value so far over the flights of the search and over the random flights in the same "
        "box. A line ends at the first early termination, which is worse than any value."
    )
    limits = [limit for item in result.requirements for limit in item.limits.as_entry().values()]
    # If there are two limits, the distance outside the limits is plotted.
    if result.criterion.limits is not None:
        limits = [0.0]
    figure = plot_convergence(result.metric.label_with_unit, searched, random, stages, limits)
    return FigureText("convergence", "Convergence", caption), figure


def _so_far(severities: Floats, sign: float) -> Floats:
    """Return the worst value up to each flight; NaN after the first early termination."""
    highest = np.maximum.accumulate(severities)
    return np.where(np.isfinite(highest) & (highest < ENDED_EARLY), sign * highest, np.nan)


def _place(result: WorstFound) -> Drawn:
    change = np.where(
        np.abs(result.case.sensitivity) < 0.5 * ENDED_EARLY, result.case.sensitivity, np.nan
    )
    if _ended_early(result, result.worst):
        quantity, change, gap = "end time (s)", -change, "the flight then completes"
    else:
        quantity, gap = result.metric.label_with_unit, "the flight then terminates early"
        change = result.sign * change
    caption = (
        "Left: position of each parameter of the worst case in its range. Right: change of the "
        "value if one parameter is moved by a twentieth of its range and the others are kept; "
        f"there is no bar if a bound prevents this or {gap}."
    )
    text = FigureText("place", "Parameters of the worst case and their sensitivities", caption)
    return text, plot_worst_point(result.names, result.case.place, change, quantity)


def _range_table(result: WorstFound) -> Table:
    worst = result.flights.samples[result.worst]
    rows = [
        [name, *(shown_value(name, value, result.known) for value in (low, worst[i], high))]
        for i, (name, (low, high)) in enumerate(
            zip(result.names, result.bounds.tolist(), strict=True)
        )
    ]
    caption = (
        "Range of each bounded distribution; for each unbounded distribution, the quantiles at "
        f"plus and minus {result.request.box:g} standard deviations of a normal distribution"
    )
    return make_table(
        "The box", caption, ("parameter", "lower bound", "worst", "upper bound"), rows
    )
