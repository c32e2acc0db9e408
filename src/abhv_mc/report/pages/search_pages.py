"""Pages of worst-case and rare-event searches, with their worst flights and re-run commands."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flights.metrics import Metric
from abhv_mc.report.figures.searches import (
    FLIGHT_PANELS,
    plot_convergence,
    plot_failures,
    plot_flights,
    plot_learning,
    plot_levels,
    plot_mixing,
    plot_worst_point,
)
from abhv_mc.report.pages.page import Answer, make_table
from abhv_mc.search.methods.second_opinion import MOST_LOOKED
from abhv_mc.search.methods.subset import ACCEPTANCE
from abhv_mc.search.methods.surrogate import SurrogateEstimate
from abhv_mc.search.rare import RareFound
from abhv_mc.search.search_flights import DRAWN_APART, ENDED_EARLY, DrawnFlights, rank_distinct
from abhv_mc.search.worst import WorstFound
from abhv_mc.topics.flights.model import channel_of, limit_sides
from abhv_mc.topics.formatting import fixed, percent, shown_value
from abhv_mc.topics.missed_requirements import limit_words
from abhv_mc.topics.topic import (
    Drawn,
    FigureText,
    Fold,
    Item,
    Picture,
    Records,
    Section,
    Table,
    controller_label,
    make_records,
)

_LISTED = 10
_PANELS = 6
_DISTINCT = (
    "The worst flight, and the worst flights whose parameters differ by at least "
    f"{100 * DRAWN_APART:g} % of the range (rms over the parameters) from all worse flights listed"
)


def flight_figures(
    drawn: DrawnFlights | None, metric: Metric, requirements: Sequence[Requirement]
) -> Iterator[Drawn]:
    """Yield the figure of the worst and nominal flights, if there are histories.

    The first panel shows the channel of the searched metric.
    """
    if drawn is None:
        return
    signals = {signal.name: (i, signal) for i, signal in enumerate(drawn.campaign.channels)}
    channel = channel_of(metric, signals, drawn.campaign.contents.stems)
    metric_panels = [
        (name, label, scale) for name, label, scale in FLIGHT_PANELS if name == channel
    ]
    if channel and not metric_panels:
        metric_panels = [(channel, signals[channel][1].axis, 1.0)]
    other_panels = [panel for panel in FLIGHT_PANELS if panel[0] != channel]
    panels = {
        label: drawn.history[:, :, signals[name][0]].astype(np.float64) * scale
        for name, label, scale in [*metric_panels, *other_panels][:_PANELS]
    }
    limits = [
        side * limit * metric_panels[0][2]
        for item in requirements
        for limit in item.limits.as_entry().values()
        for side in limit_sides(metric, signals)
    ]
    labels = ["nominal", *(f"flight {number}" for number in drawn.numbers)]
    caption = f"{_DISTINCT}, with the nominal flight. Each line ends when its flight ends."
    yield (
        FigureText("flights", "The worst flights", caption),
        plot_flights(drawn.times, panels, labels, limits=limits),
    )


def margin_text(requirement: Requirement, metric: Metric, worst: float) -> str:
    """Return a requirement with the worst value and its margin, which is negative if missed."""
    limits = requirement.limits
    margin = limits.limit - float(limits.worse(np.array([worst]))[0])
    text = f"{metric.with_unit(f'{worst:.5g}')}, required: {limit_words(metric, limits)}"
    if not limits.size or not np.isfinite(margin):
        return text
    return f"{text}, margin {percent(margin / limits.size, 2)}"


def flights_table(
    result: WorstFound | RareFound, severities: Floats, dimensions: int, folder: Path
) -> Fold:
    """Return the collapsible table of the worst flights, with commands to re-run them."""
    flights, metric, controller = result.flights, result.metric, result.controller
    numbers = rank_distinct(
        severities, flights.samples[: len(severities), :dimensions], _LISTED, DRAWN_APART
    )
    command = shlex.join(["abhv-mc", "replay", str(folder), "--controller", controller, "--flight"])
    rows = [
        [
            str(k),
            f"{flights.column(metric.name)[k]:.5g}",
            f"{flights.outcome[k]}, {flights.end_time[k]:.4g} s",
            ", ".join(
                f"{name} {shown_value(name, x, result.known)}"
                for name, x in zip(
                    flights.names[:dimensions], flights.samples[k].tolist(), strict=False
                )
            ),
            f"`{command} {k}`",
        ]
        for k in numbers
    ]
    heads = ("flight", metric.label_with_unit, "end", "parameters", "command to re-run it")
    table = make_table("Worst flights", f"{_DISTINCT}.", heads, rows)
    return Fold("Worst flights and commands to re-run them", (table,))


def make_worst_answer(result: WorstFound, folder: Path) -> Answer:
    """Return the page content of a worst-case search whose flights are in ``folder``."""
    severities = result.severities[: result.searched]
    flights = flights_table(result, severities, len(result.names), folder)
    pictures = (Picture(name) for name in ("convergence", "place", "flights"))
    title = f"Worst case of {controller_label(result.controller)}: {result.metric.phrase}"
    items: tuple[Item, ...] = (_worst_records(result), *pictures, _range_table(result), flights)
    return Answer(title, "Worst-case search", Section("Summary", items), _draw_worst(result))


def _draw_worst(result: WorstFound) -> Iterator[Drawn]:
    yield _convergence(result)
    yield _place(result)
    yield from flight_figures(result.drawn, result.metric, result.requirements)


def _worst_records(result: WorstFound) -> Records:
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
    text = FigureText(
        "place",
        "Parameters of the worst case and their sensitivities",
        "Left: position of each parameter of the worst case in its range. Right: change of the "
        "value if one parameter is moved by a twentieth of its range and the others are kept; "
        f"there is no bar if a bound prevents this or {gap}.",
    )
    return text, plot_worst_point(result.names, result.case.place, change, quantity)


def _range_table(result: WorstFound) -> Table:
    worst = result.flights.samples[result.worst]
    rows = [
        [name, *(shown_value(name, value, result.known) for value in (low, worst[i], high))]
        for i, (name, (low, high)) in enumerate(
            zip(result.names, result.bounds.tolist(), strict=True)
        )
    ]
    return make_table(
        "The box",
        "Range of each bounded distribution; for each unbounded distribution, the quantiles at "
        f"plus and minus {result.request.box:g} standard deviations of a normal distribution",
        ("parameter", "lower bound", "worst", "upper bound"),
        rows,
    )


def make_rare_answer(result: RareFound, folder: Path) -> Answer:
    """Return the page content of a rare-event search whose flights are in ``folder``."""
    flights = flights_table(result, result.severities, len(result.space.names), folder)
    items = (
        _rare_records(result),
        *map(Picture, ("levels", "mixing", "learning", "failures", "flights")),
        *((_combinations(result),) if result.strata else ()),
        flights,
    )
    label = limit_words(result.metric, result.requirement.limits)
    title = f"Probability of violation, {controller_label(result.controller)}: {label}"
    return Answer(title, "Rare-event search", Section("Summary", items), _draw_rare(result))


def _draw_rare(result: RareFound) -> Iterator[Drawn]:
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


def _rare_records(result: RareFound) -> Records:
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
    figure = plot_learning(
        result.metric.label_with_unit,
        [*result.requirement.limits.as_entry().values()],
        np.array(
            [[step.runs, *step.probabilities, step.low, step.high] for step in estimate.steps]
        ),
        result.flights.column(result.metric.name),
    )
    return FigureText("learning", "Estimate and flights", caption), figure
