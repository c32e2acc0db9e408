"""The first screen below the judgement: a chart with a row a requirement, a card a controller, the baseline."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from abhv_mc.flight.metrics import SURFACE_USAGE
from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.pages.flights_view import mark_of
from abhv_mc.topics.comparison.sentences import standing
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.model import corners_unstable, least_margins
from abhv_mc.topics.metrics import METRICS
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import GlanceCell, GlanceRow, Verdicts
from abhv_mc.topics.words import count_of, fixed, joined, percent, significant

_ROWS, _PAIRS = 8, 2  # shown; then 'and n more'
_LEFT, _RIGHT = (
    0.0,
    1.35,
)  # ends of the chart, in units of the limit; what lies beyond is a mark at the edge


@dataclass(frozen=True)
class Bar:
    """One controller in a row of the chart; places are percent of the chart's width, None where there is nothing."""

    label: str
    color: str
    mark: str  # 'circle', 'square' ... as in the scatter
    low: float | None
    high: float | None
    median: float | None
    tolerance: float | None
    beyond: bool  # whether flights lie to the right of the chart
    edge: str  # said right of it: the tolerance limit and its room, or 'lost' where the median is
    words: str  # the same for those who cannot see it
    status: str


def place(value: float | None, entry: GlanceRow) -> float | None:
    """Where a value stands: its room to the limit in units of its size, bad to the right, the limit at 1. In percent of
    the chart's width; None for what is missing."""
    if value is None or not math.isfinite(value):
        return None
    at = 1.0 + (value - entry.limit) / entry.size * (1.0 if entry.below else -1.0)
    return 100.0 * (min(max(at, _LEFT), _RIGHT) - _LEFT) / (_RIGHT - _LEFT)


LIMIT_PLACE = 100.0 * (1.0 - _LEFT) / (_RIGHT - _LEFT)


def chart_rows(
    entries: Sequence[GlanceRow], labels: Mapping[str, str], colors: Mapping[str, str]
) -> list[tuple[GlanceRow, list[Bar]]]:
    """The rows of the chart, those nearest to their limit first where there are more than eight."""
    entries = [entry if _is_required(entry) else _on_scale(entry) for entry in entries]
    if len(entries) > _ROWS:
        entries = sorted(entries, key=lambda entry: -_nearest(entry))[:_ROWS]
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
        place(each, entry) for each in (cell.low, cell.median, cell.high, cell.tolerance)
    )
    ends = sorted(value for value in (low, high) if value is not None)
    return Bar(
        label, color, mark,
        low=ends[0] if ends else None, high=ends[-1] if len(ends) > 1 else 100.0 if ends else None,
        median=None if median == 100.0 else median, tolerance=None if tolerance == 100.0 else tolerance,
        beyond=not {None, 100.0}.isdisjoint((low, high)),
        edge=_edge(entry, cell) if math.isfinite(cell.median) else "lost",
        words=_bar_words(entry, label, cell), status=cell.status,
    )  # fmt: skip


def _is_required(entry: GlanceRow) -> bool:
    """Return whether a row belongs to a requirement."""
    return any(cell.status or cell.tolerance is not None for cell in entry.cells.values())


def _on_scale(entry: GlanceRow) -> GlanceRow:
    """Return a row without a requirement on a scale of its values: the best, or zero, left; the worst at the limit's
    place."""
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


def _nearest(entry: GlanceRow) -> float:
    """How near the worst controller comes to the limit; infinite where something is lost."""
    places = [place(cell.high if entry.below else cell.low, entry) for cell in entry.cells.values()]
    return max((math.inf if at is None else at for at in places), default=0.0)


def _edge(entry: GlanceRow, cell: GlanceCell) -> str:
    """Return '1.57 deg, 124 % over' of the tolerance limit in units of the limit, '' without one; without a
    requirement 'median 0.98 deg'."""
    unit = entry.unit.removesuffix(" outside the limits").removeprefix("-")
    if not cell.status and cell.tolerance is None:
        return f"median {significant(cell.median, 3)} {unit}".strip()
    if cell.tolerance is None or not math.isfinite(cell.tolerance):
        return ""
    over = (cell.tolerance - entry.limit) / entry.size * (1.0 if entry.below else -1.0)
    share = percent(abs(over), 2) if abs(over) < 10.0 else f"{fixed(abs(over), 0)} times"
    value = f"{significant(cell.tolerance, 3)} {unit}".strip()
    return f"{value}, {share} {'over' if over > 0.0 else 'to spare'}"


def _bar_words(entry: GlanceRow, label: str, cell: GlanceCell) -> str:
    low, median, high = (
        significant(value, 3) if math.isfinite(value) else "beyond all"
        for value in (cell.low, cell.median, cell.high)
    )
    tolerance = (
        "" if cell.tolerance is None else f", tolerance limit {significant(cell.tolerance, 3)}"
    )
    return f"{label}: median {median}, 5 to 95 % {low} to {high}{tolerance} {entry.unit}".strip()


def card(models: Models, name: str, color: str) -> dict[str, object]:
    """What decides about a controller."""
    flights, table = models[FLIGHTS], models[METRICS].table
    found, counts = flights.findings[name], flights.counts[name]
    margin, poor = _margin(models, name)
    cycling = max(found.cycling.values(), default=0)
    corners, steady = corners_unstable(models[MARGINS], name)
    notes = [
        f"unstable at {corners} of {steady} corners" if corners and margin != "unstable" else "",
        f"{count_of(found.saturated, found.flown)} saturate" if found.saturated else "",
        f"{count_of(cycling, found.flown)} {'swing' if found.disturbed else 'cycle'}"
        if cycling
        else "",
        f"{counts.not_computed} not computed" if counts.not_computed else "",
    ]
    used = [
        significant(table[metric].controllers[name].quantiles["q50"].value, 2)
        for metric in SURFACE_USAGE
        if metric in table
    ]
    return {
        "label": models.names.label(name),
        "color": color,
        "met": met_words(models[VERDICTS], name),
        "lost": f"{fixed(counts.failed, 0)} of {fixed(counts.flown, 0)} lost",
        "margin": margin,
        "poor": poor,  # whether its margins are below what is customary, or it is unstable
        "notes": list(filter(None, notes)),
        "usage": f"{' / '.join(used)} deg" if len(used) == len(SURFACE_USAGE) else "",
    }


def met_words(verdicts: Verdicts, name: str) -> str:
    """'5 of 5 met', and what fails or is not shown; '' without requirements."""
    found = verdicts.statuses(name)
    if not found:
        return ""
    if "ESTIMATE" in found:
        return f"{verdicts.kept(name)} of {len(found)} kept in every flight"
    rest = [f"{found.count(word)} {words}" for word, words in (("FAIL", "missed"), ("NOT SHOWN", "not shown"))
            if word in found]  # fmt: skip
    return ", ".join([f"{found.count('PASS')} of {len(found)} met", *rest])


def _margin(models: Models, name: str) -> tuple[str, bool]:
    """The nominal vehicle's least margins in steady flight, and whether they are less than is customary."""
    found = least_margins(models[MARGINS], name)
    if found is None:
        can_have = models.results.campaign.simulator.capabilities.has_margins
        return "margins: not asked" if can_have else "", False
    if not found.stable:
        return "unstable", True
    gain, phase = found.words
    return ", ".join(filter(None, (gain or "any gain", phase))), found.little


def more_words(entries: Sequence[object]) -> str:
    """'4 more below'; '' where the chart has all."""
    return f"{len(entries) - _ROWS} more below" if len(entries) > _ROWS else ""


def baseline_line(held: Baseline | None, names: Names) -> str:
    """What changed against the baseline, of the first two controllers; '' without one."""
    if held is None:
        return ""
    parts = []
    for pair in held.paired[:_PAIRS]:
        failed, shown = (
            pair.any_failure,
            {side: len(metrics) for side, metrics in standing(pair, names).items()},
        )
        counts = (
            ("better", shown["better"]),
            ("worse", shown["worse"]),
            ("undecided", shown["mixed"]),
        )
        words, total = (
            joined([f"{word} in {count}" for word, count in counts if count]),
            sum(shown.values()),
        )
        of = f"{total} metric{'s' * (total != 1)}"
        text = f"{names.label(pair.controllers[0])} {f'{words} of' if words else 'no difference shown in'} {of}"
        if failed.only_a or failed.only_b:
            text += f", newly failed {fixed(failed.only_a, 0)}, no longer {fixed(failed.only_b, 0)}"
        parts.append(text)
    more = len(held.paired) - len(parts)
    place = held.folder.rstrip("/").rpartition("/")[2]
    tail = f"; and {more} more" if more > 0 else ""
    return f"Against {place} ({fixed(held.paired[0].pairs, 0)} flights paired): {'; '.join(parts)}{tail}."
