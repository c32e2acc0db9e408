"""The page of a worst-case search: how bad it gets, where, how the search came there, and how it is flown again."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.report.figures.searches import plot_convergence, plot_place
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.report.pages.searched_flights import drawn_figures, flights_table, limit_sentence
from abhv_mc.search.severity import ENDED_EARLY
from abhv_mc.search.worst import WorstFound
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.section import Bullets, FigureText, Item, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn
from abhv_mc.topics.words import percent, shown_value


def make_worst_answer(found: WorstFound, folder: Path) -> Answer:
    """What a worst-case search says; its flights lie in ``folder``."""
    metric = found.metric
    searched = found.severities[: found.searched]
    flights = flights_table(
        found.flights,
        searched,
        len(found.names),
        metric,
        found.controller,
        folder=folder,
        known=found.known,
    )
    pictures = (Picture(name) for name in ("convergence", "place", "flights"))
    title = f"Worst case of {controller_label(found.controller)}: {metric.phrase}"
    items: tuple[Item, ...] = (*_answers(found), *pictures, _range_table(found), flights)
    return Answer(title, "Worst-case search", Section("Answer", items), _draw(found))


def _draw(found: WorstFound) -> Iterator[Drawn]:
    yield _convergence(found)
    yield _place(found)
    yield from drawn_figures(found.drawn, found.metric, found.requirements)


def _answers(found: WorstFound) -> tuple[Lead, Bullets]:
    metric = found.metric
    worst, random = (_words(found, flight) for flight in (found.worst, found.random_worst))
    counted = f"{found.searched} flights of the search"
    if _ended_early(found, found.worst):
        first = f"The worst of {counted} {worst}: worse than any value of {metric.phrase}, the earlier the worse."
    else:
        first = f"The {found.side} value of {metric.phrase} in {counted} is {worst}."
    for item in found.requirements:
        value = found.value(found.worst)
        failures = found.failures(item)
        first += f" {limit_sentence(item, metric, value, failures, found.searched)}"
    how_many = "As many" if found.random == found.searched else f"{found.random}"
    answers = [
        first,
        f"{how_many} random flights of the same box, drawn from the campaign's distributions: the worst "
        f"{random if _ended_early(found, found.random_worst) else f'has {random}'}.",
        f"At an end of their range: {', '.join(found.at_bounds) or 'none of the parameters'}."
        + (" A wider box would most likely be worse." if found.at_bounds else ""),
        "A search shows what can happen in the box, not how often: the box counts its corners as much as its middle, "
        "correlations are left out, and a worse place that no flight came near stays unseen.",
    ]
    if found.probabilities:
        often = ", ".join(
            f"{name} ({percent(share, 3)})" for name, share in found.probabilities.items()
        )
        answers.append(
            f"In every flight of the search, but in a campaign and in the random flights with a probability: {often}. "
            "How bad it gets without is not searched."
        )
    if found.flights.names != found.names:
        answers.append(
            "The search's flights met the same turbulence and noise, so that they differ by their parameters alone."
        )
        answers += _other_seeds(found)
    if found.failed_to_run:
        answers.append(f"{found.failed_to_run} flights could not be computed and count as none.")
    return Lead(answers[0]), Bullets(tuple(answers[1:]))


def _other_seeds(found: WorstFound) -> Iterator[str]:
    """Yield the range of the worst point over other seeds of turbulence and noise."""
    if found.other_seeds is None:
        return
    flights, lost, ends = found.other_seeds
    parts = [f"{lost} ended early"] if lost else []
    if ends is not None:
        low, median, high = (found.metric.with_unit(f"{value:.5g}") for value in ends)
        parts.append(f"{found.metric.phrase} from {low} to {high}, median {median}")
    yield f"The worst point in {flights} flights with other turbulence and noise: {'; '.join(parts)}."


def _ended_early(found: WorstFound, flight: int) -> bool:
    return bool(found.severities[flight] >= ENDED_EARLY)


def _words(found: WorstFound, flight: int) -> str:
    """'20.25 m', or 'ended early, at 31.2 s (sideslip_limit)'."""
    if _ended_early(found, flight):
        return f"ended early, at {found.flights.end_time[flight]:.4g} s ({found.flights.outcome[flight]})"
    return found.metric.with_unit(f"{found.value(flight):.5g}")


def _convergence(found: WorstFound) -> Drawn:
    stages: list[tuple[int, str]] = []
    last = 0
    for step in found.case.history:
        if not stages or stages[-1][1] != step.stage:
            stages.append((last, step.stage))
        last = step.evaluations
    searched, random = (
        _so_far(part, found.sign) for part in np.split(found.severities, [found.searched])
    )
    caption = (
        "The worst value so far over the flights of the search and over the random flights of the same box. A line "
        "ends with the first flight that ended early, which is worse."
    )
    limits = [limit for item in found.requirements for limit in item.limits.as_entry().values()]
    if found.criterion.limits is not None:  # the distance outside them is drawn
        limits = [0.0]
    figure = plot_convergence(found.metric.label_with_unit, searched, random, stages, limits)
    return FigureText("convergence", "Convergence", caption), figure


def _so_far(severities: Floats, sign: float) -> Floats:
    """The worst metric so far; nan once a flight has ended early."""
    highest = np.maximum.accumulate(severities)
    return np.where(np.isfinite(highest) & (highest < ENDED_EARLY), sign * highest, np.nan)


def _place(found: WorstFound) -> Drawn:
    change = np.where(
        np.abs(found.case.sensitivity) < 0.5 * ENDED_EARLY, found.case.sensitivity, np.nan
    )
    if _ended_early(found, found.worst):
        what, change, gap = "time of the end (s)", -change, "the flight does not end early"
    else:
        what, gap = found.metric.label_with_unit, "the flight ended early"
        change = found.sign * change
    caption = (
        "Left: each parameter at the worst flight within its range. Right: by how much the value changes when one "
        f"parameter is moved by a twentieth of its range and the others stay; no bar where a bound is in the way or "
        f"{gap}."
    )
    text = FigureText("place", "Where it is, and what matters there", caption)
    return text, plot_place(found.names, found.case.place, change, what)


def _range_table(found: WorstFound) -> Table:
    worst = found.flights.samples[found.worst]
    rows = [
        [name, *(shown_value(name, value, found.known) for value in (low, worst[i], high))]
        for i, (name, (low, high)) in enumerate(
            zip(found.names, found.bounds.tolist(), strict=True)
        )
    ]
    caption = f"Bounded distributions span their range, others {found.request.box:g} standard deviations either way."
    return make_table("The box", caption, ("parameter", "low end", "worst", "high end"), rows)
