"""Page of a worst-case search: worst value, parameters, convergence, re-run commands."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.phrases import counted, joined, quoted
from abhv_mc.report.figures.searches import plot_convergence, plot_worst_point
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.report.pages.searched_flights import flight_figures, flights_table, limit_sentence
from abhv_mc.search.severity import ENDED_EARLY
from abhv_mc.search.worst import WorstFound
from abhv_mc.topics.formatting import percent, shown_value
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.section import Bullets, FigureText, Item, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn


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
    items: tuple[Item, ...] = (*_answers(result), *pictures, _range_table(result), flights)
    return Answer(title, "Worst-case search", Section("Summary", items), _draw(result))


def _draw(result: WorstFound) -> Iterator[Drawn]:
    yield _convergence(result)
    yield _place(result)
    yield from flight_figures(result.drawn, result.metric, result.requirements)


def _answers(result: WorstFound) -> tuple[Lead, Bullets]:
    metric = result.metric
    worst, random = (_words(result, flight) for flight in (result.worst, result.random_worst))
    searched = f"{counted(result.searched, 'flight')} of the search"
    if _ended_early(result, result.worst):
        first = (
            f"The worst of {searched} {worst}. An early termination is worse than any value of "
            f"{metric.phrase}."
        )
    else:
        first = f"The {result.side} value of {metric.phrase} in {searched} is {worst}."
    for item in result.requirements:
        value = result.value(result.worst)
        failures = result.failures(item)
        first += f" {limit_sentence(item, metric, value, failures, result.searched)}"
    random_ended = _ended_early(result, result.random_worst)
    answers = [
        first,
        f"In {counted(result.random, 'random flight')} in the same box, drawn from the campaign's "
        "distributions, the worst "
        f"{'flight' if random_ended else f'value of {result.metric.phrase} is'} {random}.",
        f"Parameters at a bound of their range: {quoted(result.at_bounds)}."
        + (" A wider box would probably contain a worse case." if result.at_bounds else ""),
        "A search shows what can happen in the box, not how often: all points of the box have "
        "equal weight, correlations are ignored, and a worse case far from all flights may remain "
        "undetected.",
    ]
    if result.probabilities:
        occurrences = joined(
            [f"'{name}' ({percent(share, 3)})" for name, share in result.probabilities.items()]
        )
        answers.append(
            "Every flight of the search contains these events, which have a probability below 1 in "
            f"campaigns and random flights: {occurrences}. The worst case without these events was "
            "not determined."
        )
    if result.flights.names != result.names:
        answers.append(
            "All flights of the search have the same turbulence and noise, so they differ only in "
            "their parameters."
        )
        answers += _other_seeds(result)
    if result.failed_to_run:
        flights = counted(result.failed_to_run, "flight")
        verb = "is" if result.failed_to_run == 1 else "are"
        answers.append(f"{flights} failed to run and {verb} not counted.")
    return Lead(answers[0]), Bullets(tuple(answers[1:]))


def _other_seeds(result: WorstFound) -> Iterator[str]:
    """Yield a sentence on the worst point with other seeds for turbulence and noise."""
    if result.other_seeds is None:
        return
    flights, lost, ends = result.other_seeds
    outcomes = [f"{lost} terminated early"] if lost else []
    if ends is not None:
        low, median, high = (result.metric.with_unit(f"{value:.5g}") for value in ends)
        outcomes.append(f"{result.metric.phrase} from {low} to {high}, median {median}")
    yield (
        f"Outcomes of {counted(flights, 'flight')} at the worst point with other turbulence and "
        f"noise: {'; '.join(outcomes)}."
    )


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
