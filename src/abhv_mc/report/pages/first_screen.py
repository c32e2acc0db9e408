"""Parts of the first screen of a report: chart and baseline comparison."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from abhv_mc.io.messages import THIN
from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.pages.flights_view import mark_of
from abhv_mc.topics.formatting import fixed, significant
from abhv_mc.topics.topic import Entry, Names, Record
from abhv_mc.topics.verdicts.model import GlanceCell, GlanceRow

MOST_BARS = 4  # largest number of controllers with a line of text next to each bar
MOST_ROWS, _PAIRS = 8, 2  # largest numbers of rows, and of pairs of the baseline comparison
_LEFT, _RIGHT = 0.0, 1.35  # left and right edge of the chart, in units of the limit


class Bar(NamedTuple):
    """Bar of one controller in the chart; positions are in percent of the chart's width."""

    label: str
    color: str
    mark: str  # marker shape as in the scatter plot, such as 'circle'
    low: float | None
    high: float | None
    median: float | None
    tolerance: float | None
    worst: float | None  # worst completed flight
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
    entries = [
        entry
        if any(cell.status or cell.tolerance is not None for cell in entry.cells.values())
        else _scale_to_values(entry)
        for entry in entries
    ]
    if len(entries) > MOST_ROWS:
        entries = sorted(entries, key=lambda entry: -_largest_position(entry))[:MOST_ROWS]
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
    low, median, high, tolerance, worst = (
        chart_position(value, entry)
        for value in (cell.low, cell.median, cell.high, cell.tolerance, cell.worst)
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
        worst=None if worst == 100.0 else worst,
        beyond=not {None, 100.0}.isdisjoint((low, high)) or 100.0 in (tolerance, worst),
        edge=_edge(entry, cell) if math.isfinite(cell.median) else "lost",
        words=_bar_words(entry, label, cell),
        status=cell.status,
    )


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
    values = {
        "median": cell.median,
        "5 % quantile": cell.low,
        "95 % quantile": cell.high,
        "worst flight": cell.worst,
        "tolerance limit": cell.tolerance,
    }
    unit = entry.unit.removeprefix("-")
    texts = [
        f"{name} {significant(value, 3)} {unit}".strip()
        if math.isfinite(value)
        else f"{name} (terminated early)"
        for name, value in values.items()
        if value is not None
    ]
    return f"{label}: {', '.join(texts)}"


def baseline_record(baseline: Baseline | None, names: Names) -> Record | None:
    """Return how the controllers changed from the baseline; None without a baseline."""
    if baseline is None:
        return None
    entries = []
    for pair in baseline.paired[:_PAIRS]:
        winners = [entry.winner for entry in pair.metrics.values() if entry.compared]
        counts = (
            f"better in {winners.count(pair.a)} and worse in {winners.count(pair.b)} of "
            f"{len(winners)} metrics, failures of this / baseline only "
            f"{fixed(pair.any_failure.only_a, 0)} / {fixed(pair.any_failure.only_b, 0)} of "
            f"{fixed(pair.pairs, 0)}"
        )
        entries.append(Entry((names.label(pair.controllers[0]),), counts))
    if len(baseline.paired) > _PAIRS:
        entries.append(Entry((), f"and {len(baseline.paired) - _PAIRS} more"))
    folder = baseline.folder.rstrip("/").rpartition("/")[2]
    return Record(f"Compared with '{folder}'", tuple(entries))
