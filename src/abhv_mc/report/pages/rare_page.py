"""The page of a rare failure's probability: the estimate or its refusal, levels, chains, and where failures live."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.report.figures.searches import plot_failures, plot_learning, plot_levels, plot_mixing
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.report.pages.searched_flights import drawn_figures, flights_table, limit_sentence
from abhv_mc.search.methods.second_opinion import MOST_LOOKED
from abhv_mc.search.methods.subset import ACCEPTANCE
from abhv_mc.search.methods.surrogate import SurrogateEstimate
from abhv_mc.search.rare import RareFound
from abhv_mc.search.severity import ENDED_EARLY
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.section import Bullets, FigureText, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn
from abhv_mc.topics.words import percent


def make_rare_answer(found: RareFound, folder: Path) -> Answer:
    """What an estimate of a rare failure says; its flights lie in ``folder``."""
    metric, dimensions = found.metric, len(found.space.names)
    asked = f"{metric.phrase} {metric.with_unit(str(found.requirement.limits))}"
    flights = flights_table(
        found.flights,
        found.severities,
        dimensions,
        metric,
        found.controller,
        folder=folder,
        known=found.known,
    )
    items = (
        *_answers(found, asked),
        *map(Picture, ("levels", "mixing", "learning", "failures", "flights")),
        *((_combinations(found),) if found.strata else ()),
        flights,
    )
    title = f"Probability that {controller_label(found.controller)} breaks: {asked}"
    return Answer(title, "Rare event", Section("Answer", items), _draw(found))


def _draw(found: RareFound) -> Iterator[Drawn]:
    if found.estimate.repetitions:
        yield _levels(found)
        yield _mixing(found)
    if isinstance(found.estimate, SurrogateEstimate):
        yield _learning(found, found.estimate)
    failures = found.estimate.failures
    if len(failures):
        caption = (
            "Each parameter as the standard normal number behind it, among failures, beside all flights of a campaign. "
            "A parameter whose failures look like all flights does not matter by itself. The numbers are those before "
            "correlations are applied."
        )
        yield (
            FigureText("failures", "Where failures live", caption),
            plot_failures(found.space.names, failures),
        )
    yield from drawn_figures(found.drawn, found.metric, (found.requirement,))


def _answers(found: RareFound, asked: str) -> tuple[Lead, Bullets]:
    estimate = found.estimate
    if estimate.refusal is None:
        repeated = (
            "" if found.strata else f" in {len(estimate.repetitions)} independent repetitions"
        )
        if isinstance(estimate, SurrogateEstimate):
            repeated = f" ({found.failures} failed) and two Gaussian processes fitted to them"
        answers = [
            f"P({controller_label(found.controller)} breaks '{asked}') is about {estimate.probability:.1e}, "
            f"95 % interval {estimate.low:.1e} .. {estimate.high:.1e}, from {estimate.flights} flights"
            f"{repeated}{found.unwarned}.",
        ]
        if not (found.includes_unwarned and estimate.high == estimate.unwarned_high):
            plain = f"{_plain_flights(found):,}"
            answers.append(
                f"As narrow an interval from plain sampling takes about {plain} flights."
            )
    else:
        answers = [f"There is no trustworthy estimate: {estimate.refusal}."]
    worst = float(found.flights.column(found.metric.name)[int(np.argmax(found.severities))])
    flights = found.flights.stop
    answers.append(limit_sentence(found.requirement, found.metric, worst, found.failures, flights))
    answers.append(f"Second opinion: {found.second_opinion}.")
    if found.noise_share is not None:
        answers.append(
            f"{percent(found.noise_share, 2)} of the severity's variance (of ranks) is noise: points were flown twice, "
            "with other seeds."
        )
    if isinstance(estimate, SurrogateEstimate):
        answers.append(
            "The estimate assumes that the metric is a smooth function of the dispersions. It leaves out failures that "
            "no flight came near."
        )
    looked = estimate.check is not None and len(found.space.names) <= MOST_LOOKED
    more = " Failures apart from where flights grow worse were searched for in random directions; some may stay unseen."
    answers.append(
        f"An estimate is no verdict: verdicts come from random campaigns alone.{more if looked else ''}"
    )
    if found.failed_to_run:
        answers.append(
            f"{found.failed_to_run} flights could not be computed and count as failures."
        )
    return Lead(answers[0]), Bullets(tuple(answers[1:]))


def _combinations(found: RareFound) -> Table:
    rows = [
        [
            found.words(part),
            f"{part.weight:.2e}",
            f"{part.probability:.2e} ({part.low:.1e} .. {part.high:.1e})",
            f"{part.weight * part.probability:.2e}",
            str(part.flights),
        ]
        for part in found.strata
    ]
    caption = (
        "What comes with a probability, such as a failure, by combination: how likely it is, how likely a flight "
        "breaks the requirement then, with its 95 % interval, and what that adds to the sum."
    )
    heads = ("What comes", "Probability", "P(breaks)", "Adds", "Flights")
    return make_table("Combinations", caption, heads, rows)


def _levels(found: RareFound) -> Drawn:
    asked, ways = found.requirement.limits, []
    for one in found.estimate.repetitions:
        limits = np.array([level.threshold for level in one.levels])
        limits = np.where(limits < ENDED_EARLY, asked.sign * (asked.limit + limits), np.nan)
        ways.append(
            (limits, np.cumprod([level.probability for level in one.levels], dtype=np.float64))
        )
    caption = (
        "Each repetition's thresholds, and the estimated probability of a flight beyond them. Lines that lie apart are "
        "repetitions that contradict each other."
    )
    if any(np.isnan(limits).any() for limits, _ in ways):
        caption += " A line ends where the next threshold is an early end, which has no value of the metric."
    label = (
        f"{'distance outside the limits of ' if asked.both else ''}{found.metric.label_with_unit}"
    )
    return FigureText("levels", "Levels", caption), plot_levels(
        label, asked.sign * asked.limit, ways
    )


def _mixing(found: RareFound) -> Drawn:
    caption = (
        f"Share of accepted moves ({ACCEPTANCE:g} is aimed at, dashed) and size of the moves at each level, a line for "
        "each repetition as above. Chains that accept next to nothing, or move by little, explore little."
    )
    rates, sizes = (
        [
            np.array([getattr(level, key) for level in one.levels[1:]])
            for one in found.estimate.repetitions
        ]
        for key in ("acceptance", "spread")
    )
    return FigureText("mixing", "How the chains mix", caption), plot_mixing(
        rates, sizes, ACCEPTANCE
    )


def _learning(found: RareFound, estimate: SurrogateEstimate) -> Drawn:
    caption = (
        "Left: probability by each of the two processes after each batch of flights, and its interval. "
        "Right: metric of each flight; after the first design they are where failure is least certain."
    )
    values = found.flights.column(found.metric.name)
    figure = plot_learning(
        found.metric.label_with_unit,
        [*found.requirement.limits.as_entry().values()],
        np.array(
            [[step.runs, *step.probabilities, step.low, step.high] for step in estimate.steps]
        ),
        values,
    )
    return FigureText("learning", "Estimate and flights", caption), figure


def _plain_flights(found: RareFound) -> int:
    """Flights of plain sampling with an interval of the logarithm as narrow as this one, to two digits."""
    p, half = found.estimate.probability, 0.5 * np.log(found.estimate.high / found.estimate.low)
    return int(float(f"{(1.0 - p) / (p * (half / 1.96) ** 2):.1e}"))
