"""Parts of the first screen of a report: chart, cards and baseline comparison."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from abhv_mc.flight.metrics import SURFACE_USAGE
from abhv_mc.io.phrases import THIN, counted, joined
from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.pages.flights_view import mark_of
from abhv_mc.topics.comparison.sentences import standing
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.formatting import count_of, fixed, significant
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.model import corners_unstable, least_margins
from abhv_mc.topics.metrics import METRICS
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import GlanceCell, GlanceRow, Verdicts

_ROWS, _PAIRS = 8, 2  # maximum numbers of chart rows and of pairs in the baseline comparison
_LEFT, _RIGHT = 0.0, 1.35  # left and right edge of the chart, in units of the limit


@dataclass(frozen=True)
class Bar:
    """Bar of one controller in the chart; positions are in percent of the chart's width."""

    label: str
    color: str
    mark: str  # marker shape as in the scatter plot, such as 'circle'
    low: float | None
    high: float | None
    median: float | None
    tolerance: float | None
    beyond: bool  # whether the bar or the tolerance limit lies beyond the right edge of the chart
    # text on the right: tolerance limit with margin or, without a requirement, the median
    edge: str
    words: str  # text for screen readers
    status: str


def chart_position(value: float | None, entry: GlanceRow) -> float | None:
    """Return the position of a value in percent of the chart's width; None if missing.

    Distances are in units of the limit's size, with the limit at 1 and worse values to the right of
    the limit.
    """
    if value is None or not math.isfinite(value):
        return None
    distance = 1.0 + (value - entry.limit) / entry.size * (1.0 if entry.below else -1.0)
    return 100.0 * (min(max(distance, _LEFT), _RIGHT) - _LEFT) / (_RIGHT - _LEFT)


LIMIT_POSITION = 100.0 * (1.0 - _LEFT) / (_RIGHT - _LEFT)


def chart_rows(
    entries: Sequence[GlanceRow], labels: Mapping[str, str], colors: Mapping[str, str]
) -> list[tuple[GlanceRow, list[Bar]]]:
    """Return the rows of the chart: at most eight rows, the ones nearest to their limits."""
    entries = [entry if _is_required(entry) else _scale_to_values(entry) for entry in entries]
    if len(entries) > _ROWS:
        entries = sorted(entries, key=lambda entry: -_largest_position(entry))[:_ROWS]
    marks = {name: mark_of(k) for k, name in enumerate(labels)}
    return [
        (
            entry,
            [
                _bar(entry, cell, labels[name], colors[name], marks[name])
                for name, cell in entry.cells.items()
            ],
        )
        for entry in entries
    ]


def _bar(entry: GlanceRow, cell: GlanceCell, label: str, color: str, mark: str) -> Bar:
    low, median, high, tolerance = (
        chart_position(value, entry) for value in (cell.low, cell.median, cell.high, cell.tolerance)
    )
    ends = sorted(value for value in (low, high) if value is not None)
    return Bar(
        label,
        color,
        mark,
        low=ends[0] if ends else None,
        high=ends[-1] if len(ends) > 1 else 100.0 if ends else None,
        median=None if median == 100.0 else median,
        tolerance=None if tolerance == 100.0 else tolerance,
        beyond=not {None, 100.0}.isdisjoint((low, high)) or tolerance == 100.0,
        edge=_edge(entry, cell) if math.isfinite(cell.median) else "lost",
        words=_bar_words(entry, label, cell),
        status=cell.status,
    )


def _is_required(entry: GlanceRow) -> bool:
    """Return whether a chart row belongs to a requirement."""
    return any(cell.status or cell.tolerance is not None for cell in entry.cells.values())


def _scale_to_values(entry: GlanceRow) -> GlanceRow:
    """Scale a row without a requirement to its own values.

    The best value, or zero, is at the left edge, and the worst value is at the limit's position.
    """
    sign = 1.0 if entry.below else -1.0
    ends = [sign * end for cell in entry.cells.values() for end in (cell.low, cell.high)]
    ends = [end for end in ends if math.isfinite(end)]
    if not ends:
        return entry
    best, worst = min(ends), max(ends)
    best = 0.0 if 0.0 <= best <= worst / 2.0 else best
    left, right = (significant(sign * end) for end in (best, worst))
    text = f"{left} to {right} {entry.unit.removeprefix('-')}".strip()
    return replace(entry, limit=sign * worst, size=worst - best or abs(worst) or 1.0, text=text)


def _largest_position(entry: GlanceRow) -> float:
    """Return the position of the worst end of all bars; infinite if it is not finite."""
    positions = [
        chart_position(cell.high if entry.below else cell.low, entry)
        for cell in entry.cells.values()
    ]
    return max((math.inf if position is None else position for position in positions), default=0.0)


def _edge(entry: GlanceRow, cell: GlanceCell) -> str:
    """Return the tolerance limit as text, such as '1.57 deg, 124 % over'; '' if unavailable.

    Without a requirement, return text such as 'median 0.98 deg'.
    """
    unit = entry.unit.removesuffix(" outside the limits").removeprefix("-")
    if not cell.status and cell.tolerance is None:
        return f"median {significant(cell.median, 3)} {unit}".strip()
    if cell.tolerance is None or not math.isfinite(cell.tolerance):
        return ""
    over = (cell.tolerance - entry.limit) / entry.size * (1.0 if entry.below else -1.0)
    share = f"{fixed(100.0 * abs(over), 0 if abs(over) >= 0.1 else 1)}{THIN}%"
    if abs(over) >= 10.0:
        share = f"{fixed(abs(over), 0)} times"
    value = f"{significant(cell.tolerance, 3)} {unit}".strip()
    return f"{value}, {share} {'over' if over > 0.0 else 'margin'}"


def _bar_words(entry: GlanceRow, label: str, cell: GlanceCell) -> str:
    unit = entry.unit.removeprefix("-")
    low, median, high = (
        f"{significant(value, 3)} {unit}".strip() if math.isfinite(value) else "(terminated early)"
        for value in (cell.low, cell.median, cell.high)
    )
    words = f"{label}: median {median}, 5 % and 95 % quantiles {low} and {high}"
    if cell.tolerance is None:
        return words
    return f"{words}, tolerance limit {significant(cell.tolerance, 3)} {unit}".strip()


def controller_card(models: Models, name: str, color: str) -> dict[str, object]:
    """Return the content of a controller's card: verdicts, outcomes, margins, effort."""
    flights, table = models[FLIGHTS], models[METRICS].table
    findings, counts = flights.findings[name], flights.counts[name]
    margin, poor = _margin(models, name)
    cycling = max(findings.cycling.values(), default=0)
    corners, steady = corners_unstable(models[MARGINS], name)
    notes = [
        f"unstable at {count_of(corners, steady, 'corner')}"
        if corners and margin != "unstable"
        else "",
        f"{count_of(findings.saturated, findings.flown)} saturate" if findings.saturated else "",
        f"{count_of(cycling, findings.flown)} "
        f"{'oscillate' if findings.disturbed else 'in a limit cycle'}"
        if cycling
        else "",
        f"{counts.not_computed} not computed" if counts.not_computed else "",
    ]
    usage = [
        significant(table[metric].controllers[name].quantiles["q50"].value, 2)
        for metric in SURFACE_USAGE
        if metric in table
    ]
    return {
        "label": models.names.label(name),
        "color": color,
        "met": requirement_counts(models[VERDICTS], name),
        "lost": f"{fixed(counts.failed, 0)} of {fixed(counts.flown, 0)} terminated early",
        "margin": margin,
        "poor": poor,  # whether margins are below customary values or a closed loop is unstable
        "notes": list(filter(None, notes)),
        "usage": f"{' / '.join(usage)} deg" if len(usage) == len(SURFACE_USAGE) else "",
    }


def requirement_counts(verdicts: Verdicts, name: str) -> str:
    """Return counts such as '3 of 5 met, 1 missed, 1 undecided'; '' without requirements."""
    statuses = verdicts.statuses(name)
    if not statuses:
        return ""
    if "ESTIMATE" in statuses:
        return f"{verdicts.kept(name)} of {len(statuses)} met in every flight"
    shortfalls = [
        f"{statuses.count(status)} {label}"
        for status, label in (("FAIL", "missed"), ("NOT SHOWN", "undecided"))
        if status in statuses
    ]
    later = sum(entry.controllers[name].set_later for entry in verdicts.requirements)
    shortfalls += [f"{later} set later"] if later else []
    return ", ".join([f"{statuses.count('PASS')} of {len(statuses)} met", *shortfalls])


def _margin(models: Models, name: str) -> tuple[str, bool]:
    """Return the smallest nominal margins, and whether they are below customary values."""
    margins = least_margins(models[MARGINS], name)
    if margins is None:
        can_have = models.results.campaign.simulator.capabilities.has_margins
        return "margins: not requested" if can_have else "", False
    if not margins.stable:
        return "unstable", True
    gain, phase = margins.words
    return ", ".join(filter(None, (gain or "any gain", phase))), margins.little


def unlisted_rows(entries: Sequence[object]) -> str:
    """Return text such as '4 more below'; '' if the chart shows all rows."""
    return f"{len(entries) - _ROWS} more below" if len(entries) > _ROWS else ""


def baseline_line(baseline: Baseline | None, names: Names) -> str:
    """Describe how up to two controllers changed from the baseline; '' without a baseline."""
    if baseline is None:
        return ""
    parts = []
    for pair in baseline.paired[:_PAIRS]:
        failed, counts_by_side = (
            pair.any_failure,
            {side: len(metrics) for side, metrics in standing(pair, names).items()},
        )
        counts = (
            ("better", counts_by_side["better"]),
            ("worse", counts_by_side["worse"]),
            ("undecided", counts_by_side["mixed"]),
        )
        changes, total = (
            joined([f"{side} in {count}" for side, count in counts if count]),
            sum(counts_by_side.values()),
        )
        change = f"is {changes} of" if changes else "shows no difference in"
        text = f"{names.subject(pair.controllers[0])} {change} {counted(total, 'metric')}"
        if failed.only_a or failed.only_b:
            text += (
                f", with {counted(failed.only_a, 'flight')} newly failed and "
                f"{fixed(failed.only_b, 0)} no longer failed"
            )
        parts.append(text)
    unlisted = len(baseline.paired) - len(parts)
    folder = baseline.folder.rstrip("/").rpartition("/")[2]
    more = counted(unlisted, names.campaign.kind)
    remainder = f"; {more} not listed here" if unlisted > 0 else ""
    return (
        f"Compared with '{folder}' ({counted(baseline.paired[0].pairs, 'paired flight')}): "
        f"{'; '.join(parts)}{remainder}."
    )
