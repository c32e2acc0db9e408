"""Page of a rare-event search: estimate, levels, Markov chains and failure regions."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.report.figures.searches import plot_failures, plot_learning, plot_levels, plot_mixing
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.report.pages.searched_flights import flight_figures, flights_table, margin_text
from abhv_mc.search.methods.second_opinion import MOST_LOOKED
from abhv_mc.search.methods.subset import ACCEPTANCE
from abhv_mc.search.methods.surrogate import SurrogateEstimate
from abhv_mc.search.rare import RareFound
from abhv_mc.search.search_flights import ENDED_EARLY
from abhv_mc.topics.formatting import fixed, percent
from abhv_mc.topics.missed_requirements import limit_words
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


def make_rare_answer(result: RareFound, folder: Path) -> Answer:
    """Return the page content of a rare-event search whose flights are in ``folder``."""
    metric, dimensions = result.metric, len(result.space.names)
    flights = flights_table(
        result.flights,
        result.severities,
        dimensions,
        metric,
        result.controller,
        folder=folder,
        parameters=result.known,
    )
    items = (
        _answers(result),
        *map(Picture, ("levels", "mixing", "learning", "failures", "flights")),
        *((_combinations(result),) if result.strata else ()),
        flights,
    )
    label = limit_words(metric, result.requirement.limits)
    title = f"Probability of violation, {controller_label(result.controller)}: {label}"
    return Answer(title, "Rare-event search", Section("Summary", items), _draw(result))


def _draw(result: RareFound) -> Iterator[Drawn]:
    if result.estimate.repetitions:
        yield _levels(result)
        yield _mixing(result)
    if isinstance(result.estimate, SurrogateEstimate):
        yield _learning(result, result.estimate)
    failures = result.estimate.failures
    if len(failures):
        caption = (
            "Distribution of each parameter in failures, compared with all flights of a campaign, "
            "on a standard normal scale before correlations are applied. A parameter with equal "
            "distributions has no effect on its own."
        )
        yield (
            FigureText("failures", "Parameters of the failures", caption),
            plot_failures(result.space.names, failures),
        )
    yield from flight_figures(result.drawn, result.metric, (result.requirement,))


def _answers(result: RareFound) -> Records:
    """Return the estimate, its basis and its limitations as records."""
    estimate, allowed = result.estimate, 1.0 - result.requirement.probability
    is_surrogate = isinstance(estimate, SurrogateEstimate)
    texts = [("No trustworthy estimate", estimate.refusal or "")]
    if estimate.refusal is None:
        text = (
            f"{estimate.probability:.1e} ({estimate.low:.1e} to {estimate.high:.1e}), allowed "
            f"{allowed:.1e}; an estimate, no verdict"
        )
        basis = f"{fixed(estimate.flights, 0)} flights, 95 % interval"
        if is_surrogate:
            basis += f", {result.failures} failed, two Gaussian processes"
        elif not result.strata:
            basis += f", repetitions: {len(estimate.repetitions)}"
        texts = [("P(violation)", text), ("Basis", basis), ("Without warning", result.unwarned)]
        if not (result.includes_unwarned and estimate.high == estimate.unwarned_high):
            # number of plain flights for an equally narrow interval of log(P)
            p, half = estimate.probability, 0.5 * np.log(estimate.high / estimate.low)
            plain = int(float(f"{(1.0 - p) / (p * (half / 1.96) ** 2):.1e}"))
            texts.append(("Plain Monte Carlo", f"{fixed(plain, 0)} flights for this interval"))
    worst = float(result.flights.column(result.metric.name)[int(np.argmax(result.severities))])
    is_looked = estimate.check is not None and len(result.space.names) <= MOST_LOOKED
    texts += [
        ("Worst flight", margin_text(result.requirement, result.metric, worst)),
        ("Second method", result.second_opinion),
        (
            "Noise",
            ""
            if result.noise_share is None
            else f"{percent(result.noise_share, 2)} of the variance of the severity ranks",
        ),
        ("Assumption", "smooth metric" * is_surrogate),
        ("Separate regions", "sought in random directions; some may remain" * is_looked),
        (
            "Counted as failures",
            f"{result.failed_to_run} failed to run" * bool(result.failed_to_run),
        ),
    ]
    return make_records(texts)


def _combinations(result: RareFound) -> Table:
    rows = [
        [
            result.words(x),
            f"{x.weight:.2e}",
            f"{x.probability:.2e} ({x.low:.1e} .. {x.high:.1e})",
            f"{x.weight * x.probability:.2e}",
            str(x.flights),
        ]
        for x in result.strata
    ]
    caption = (
        "Combinations of random events, such as failures: probability of the "
        "combination, probability of a violation given the combination with its 95 % interval, and "
        "their product"
    )
    heads = ("Combination", "Probability", "P(violation)", "Contribution", "Flights")
    return make_table("Combinations", caption, heads, rows)


def _levels(result: RareFound) -> Drawn:
    bounds, curves = result.requirement.limits, []
    for repetition in result.estimate.repetitions:
        limits = np.array([level.threshold for level in repetition.levels])
        limits = np.where(limits < ENDED_EARLY, bounds.sign * (bounds.limit + limits), np.nan)
        curves.append(
            (
                limits,
                np.cumprod([level.probability for level in repetition.levels], dtype=np.float64),
            )
        )
    caption = (
        "Thresholds of each repetition and the estimated probability of exceeding them. Lines that "
        "lie far apart mean that the repetitions contradict each other."
    )
    if any(np.isnan(limits).any() for limits, _ in curves):
        caption += (
            " A line ends if the next threshold is an early termination, which has no value of the "
            "metric."
        )
    label = (
        f"{'distance outside the limits of ' if bounds.both else ''}{result.metric.label_with_unit}"
    )
    return FigureText("levels", "Levels", caption), plot_levels(
        label, bounds.sign * bounds.limit, curves
    )


def _mixing(result: RareFound) -> Drawn:
    caption = (
        f"Share of accepted moves (target {ACCEPTANCE:g}, dashed) and size of the moves at each "
        "level, with one line for each repetition. Chains with a very low acceptance rate or very "
        "small moves explore little."
    )
    rates, sizes = (
        [
            np.array([getattr(level, key) for level in repetition.levels[1:]])
            for repetition in result.estimate.repetitions
        ]
        for key in ("acceptance", "spread")
    )
    return FigureText("mixing", "Mixing of the chains", caption), plot_mixing(
        rates, sizes, ACCEPTANCE
    )


def _learning(result: RareFound, estimate: SurrogateEstimate) -> Drawn:
    caption = (
        "Left: failure probability according to each of the two Gaussian processes after each "
        "batch of flights, with its interval. Right: metric of each flight; after the initial "
        "design, flights are placed where the prediction of failure is least certain."
    )
    values = result.flights.column(result.metric.name)
    figure = plot_learning(
        result.metric.label_with_unit,
        [*result.requirement.limits.as_entry().values()],
        np.array(
            [[step.runs, *step.probabilities, step.low, step.high] for step in estimate.steps]
        ),
        values,
    )
    return FigureText("learning", "Estimate and flights", caption), figure
