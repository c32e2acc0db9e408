"""The page of a search: one HTML file that opens offline."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.search.flights import DrawnFlights
from abhv_mc.campaign.search.rare import RareFound
from abhv_mc.campaign.search.severity import ENDED_EARLY, rank_distinct
from abhv_mc.campaign.search.worst import WorstFound
from abhv_mc.flight.signals import CHANNEL_INDEX, METRIC_INDEX
from abhv_mc.report.answer_page import Shown, write_answer_page
from abhv_mc.report.figures.searches import (
    plot_convergence,
    plot_failures,
    plot_flights,
    plot_levels,
    plot_mixing,
    plot_place,
)
from abhv_mc.report.metrics import controller_label, words_of
from abhv_mc.report.parameters import shown_value
from abhv_mc.store.flights import FlightRows

_CHANNELS = (
    ("altitude_m", "altitude (km)", 1e-3),
    ("speed_mps", "speed (m/s)", 1.0),
    ("angle_of_attack_deg", "angle of attack (deg)", 1.0),
    ("sideslip_deg", "sideslip (deg)", 1.0),
    ("bank_deg", "bank (deg)", 1.0),
    ("elevator_deg", "elevator (deg)", 1.0),
)


_LISTED = 10  # worst flights in the table


def write_worst_page(found: WorstFound, path: Path) -> Path:
    """Write the page of a worst-case search and its figures beside it."""
    metric = found.settings.metric
    label = _label(metric)
    numbers = found.numbers()
    side = "largest" if found.settings.largest else "smallest"
    worst, random = found.severities[: found.searched], found.severities[found.searched :]
    sign = 1.0 if found.settings.largest else -1.0
    beside = _beside(worst.max(), random.max(), found.metric(found.worst), found.metric(found.random_worst), label)
    answers = [
        f"The {side} {label} that {found.searched} flights found is {found.metric(found.worst):.5g}"
        + (f", of a flight that ended early ({numbers['outcome']})." if worst.max() >= ENDED_EARLY else "."),
        beside,
        f"At an end of their range: {', '.join(found.at_bounds) or 'none of the parameters'}.",
        "A search shows what can happen in the box, not how often: the box counts its corners as much as its middle, "
        "correlations are left out, and a worse place that no flight came near stays unseen.",
    ]
    if found.flights.names != found.names:
        answers.append("All flights met the same turbulence and noise, so that the search compares like with like.")
    stages: list[tuple[int, str]] = []
    last = 0
    for step in found.case.history:
        if not stages or stages[-1][1] != step.stage:
            stages.append((last, step.stage))
        last = step.evaluations
    shown = [
        Shown(
            "convergence",
            "Convergence",
            "The worst value so far over the flights of the search and over as many random flights, drawn from the "
            "campaign's laws inside the same box. A line ends where a flight ended early, which is worst.",
            plot_convergence(label, _so_far(worst, sign), stages, _so_far(random, sign)),
        ),
        Shown(
            "place",
            "Where it is, and what matters there",
            "Left: each parameter at the worst flight within its range. Right: by how much the value changes when one "
            "parameter is moved by a twentieth of its range and the others stay; no bar where a bound is in the way or "
            "the flight ended early.",
            plot_place(
                found.names,
                found.case.place,
                sign * np.where(np.abs(found.case.sensitivity) < 0.5 * ENDED_EARLY, found.case.sensitivity, np.nan),
                label,
            ),
        ),
        _flights_figure(found.drawn),
    ]
    ranked = rank_distinct(worst, found.flights.samples, _LISTED)
    table = _flight_table(found.flights, ranked, metric, found.controller, path.parent)
    return write_answer_page(
        path,
        f"Worst case of {label}, {controller_label(found.controller)}",
        "Worst-case search",
        answers,
        shown,
        [table, _range_table(found)],
    )


def _beside(worst: float, random: float, value: float, random_value: float, label: str) -> str:
    if worst >= ENDED_EARLY or random >= ENDED_EARLY:
        found = "a flight ended early, too" if random >= ENDED_EARLY else "none ended early"
        return f"Among as many random flights of the same box {found}."
    return f"As many random flights of the same box came to {random_value:.5g} ({label}), the search to {value:.5g}."


def write_rare_page(found: RareFound, path: Path) -> Path:
    """Write the page of an estimate of a rare failure and its figures beside it."""
    metric, estimate = found.settings.requirement, found.estimate
    label = _label(metric)
    below = found.requirement.below is not None
    asked = f"{label} {'below' if below else 'above'} {found.limit:g}"
    if estimate.refusal is None:
        answers = [
            f"P({controller_label(found.controller)} breaks '{asked}') is about {estimate.probability:.2g}, "
            f"95 % interval {estimate.low:.2g} .. {estimate.high:.2g}, from {estimate.flights} flights in "
            f"{len(estimate.repetitions)} independent repetitions.",
            f"As narrow an interval from plain sampling takes about {_plain_flights(found):.2g} flights.",
        ]
    else:
        answers = [f"There is no trustworthy estimate: {estimate.refusal}."]
    check = estimate.check
    if check is not None and check.usable:
        answers.append(
            f"Importance sampling about the failures found gives {check.probability:.2g} "
            f"(coefficient of variation {100 * check.cov:.0f} %)."
        )
    answers += [
        "An estimate is no verdict: verdicts come from random campaigns alone. A failure that lies apart from where "
        "flights grow worse, and that no flight came near, stays unseen.",
    ]
    if found.failed_to_run:
        answers.append(f"{found.failed_to_run} flights could not be computed and count as failures.")
    sign = 1.0 if below else -1.0
    ways = []
    for one in estimate.repetitions:
        limits = np.array([level.threshold for level in one.levels])
        limits = np.where(limits < ENDED_EARLY, found.limit + sign * limits, np.nan)
        ways.append((limits, np.cumprod([level.probability for level in one.levels], dtype=np.float64)))
    later = [one.levels[1:] for one in estimate.repetitions]
    shown = [
        Shown(
            "levels",
            "Levels",
            "Each repetition's thresholds, and the estimated probability of a flight beyond them. Lines that lie apart "
            "are repetitions that contradict each other.",
            plot_levels(label, found.limit, ways),
        ),
        Shown(
            "mixing",
            "How the chains mix",
            "Share of accepted moves (0.44 is aimed at, dashed) and size of the moves at each level. Chains that "
            "accept next to nothing, or move by little, explore little.",
            plot_mixing(
                [np.array([level.acceptance for level in levels]) for levels in later],
                [np.array([level.spread for level in levels]) for levels in later],
            ),
        ),
    ]
    if len(estimate.failures):
        shown.append(
            Shown(
                "failures",
                "Where failures live",
                "Each parameter as the standard normal number behind it, among failures, beside all flights. A "
                "parameter whose failures look like all flights does not matter. Correlations are left out.",
                plot_failures(found.names, estimate.failures),
            )
        )
    shown.append(_flights_figure(found.drawn))
    worst = rank_distinct(found.severities, found.flights.samples, _LISTED)
    table = _flight_table(found.flights, worst, metric, found.controller, path.parent)
    return write_answer_page(
        path,
        f"Probability that {controller_label(found.controller)} breaks: {asked}",
        "Rare event",
        answers,
        shown,
        [table],
    )


def _plain_flights(found: RareFound) -> float:
    """Flights of plain sampling whose estimate has an interval as narrow as this one, as a normal logarithm."""
    p, half = found.estimate.probability, 0.5 * np.log(found.estimate.high / found.estimate.low)
    return float((1.0 - p) / (p * (half / 1.96) ** 2))


def _so_far(severities: np.ndarray, sign: float) -> np.ndarray:
    """The worst metric so far; nan once a flight has ended early."""
    highest = np.maximum.accumulate(severities)
    return np.where(np.isfinite(highest) & (highest < ENDED_EARLY), sign * highest, np.nan)


def _label(metric: str) -> str:
    return words_of(metric).label_with_unit


def _flights_figure(drawn: DrawnFlights) -> Shown:
    panels = {
        label: drawn.history[:, :, CHANNEL_INDEX[name]].astype(np.float64) * scale for name, label, scale in _CHANNELS
    }
    labels = ["nominal", *(f"flight {number}" for number in drawn.numbers)]
    caption = "The worst flights beside the nominal one; a line ends where its flight ended."
    return Shown("flights", "The worst flights", caption, plot_flights(drawn.times, panels, labels))


def _flight_table(
    flights: FlightRows, numbers: Sequence[int], metric: str, controller: str, folder: Path
) -> dict[str, Any]:
    rows = [
        [
            str(k),
            f"{flights.values[k, METRIC_INDEX[metric]]:.5g}",
            f"{flights.outcome[k]}, {flights.values[k, -1]:.4g} s",
            ", ".join(
                f"{name} {shown_value(name, x)}" for name, x in zip(flights.names, flights.samples[k], strict=True)
            ),
            f"abhv-mc replay {folder} --flight {k} --controller {controller}",
        ]
        for k in numbers
    ]
    heads = ["flight", _label(metric), "ended", "parameters", "flown again by"]
    return {"title": "Worst flights", "caption": "Each can be flown again bit for bit.", "heads": heads, "rows": rows}


def _range_table(found: WorstFound) -> dict[str, Any]:
    rows = [
        [
            name,
            shown_value(name, low),
            shown_value(name, found.flights.samples[found.worst, i]),
            shown_value(name, high),
        ]
        for i, (name, (low, high)) in enumerate(zip(found.names, found.bounds.tolist(), strict=True))
    ]
    caption = f"Bounded laws span their range, unbounded ones {found.settings.box:g} standard deviations either way."
    return {
        "title": "The box",
        "caption": caption,
        "heads": ["parameter", "low end", "worst", "high end"],
        "rows": rows,
    }
