"""Self-contained HTML pages for reports, searches and comparisons."""

import base64
import gzip
import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from numpy.typing import ArrayLike, NDArray

from abhv_mc.folder.layout import write_text
from abhv_mc.io.messages import THIN, grouped_digits
from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.numbers.summary import confidence_records, summarize
from abhv_mc.report.pages.channel_curves import envelope_data
from abhv_mc.report.pages.flights_view import (
    SCRIPTS,
    SHAPES,
    STYLES,
    find_range,
    make_flights_view,
    mark_of,
    template_text,
)
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.convergence import CONVERGENCE
from abhv_mc.topics.figure_style import controller_colors, write_png
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.formatting import fixed, significant
from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.topic import (
    Cell,
    Drawn,
    Entry,
    FigureText,
    Models,
    Names,
    Record,
    Records,
    Section,
    Table,
)
from abhv_mc.topics.verdicts import VERDICTS
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


_MISSING = 0xFFFF
_STEPS = _MISSING - 1


def pack_arrays(arrays: Mapping[str, ArrayLike]) -> tuple[dict[str, object], str]:
    """Return the layout of arrays and their values, compressed and encoded in base64.

    A value is ``low + (high - low) * n / 65534`` with 16 bits for ``n``; 65535 is a missing or
    infinite value. The largest error is 1/131068 of an array's range. Along the last axis, each
    ``n`` is stored as the difference from the previous ``n``, modulo 65536, which halves the size
    of smooth curves. The low bytes of all values come first, then the high bytes.
    """
    layout: dict[str, object] = {}
    blocks: list[NDArray[np.uint16]] = []
    start = 0
    for name, array in arrays.items():
        values = np.asarray(array, dtype=np.float64)
        low, high = find_range(values)
        scaled = (values - low) * (_STEPS / (high - low)) if high > low else np.zeros(values.shape)
        codes = np.where(
            np.isfinite(values), np.rint(np.nan_to_num(scaled, posinf=0.0, neginf=0.0)), _MISSING
        )
        blocks.append(np.diff(codes.astype(np.int64), prepend=0, axis=-1).ravel().astype(np.uint16))
        layout[name] = {"start": start, "shape": list(values.shape), "low": low, "high": high}
        start += values.size
    steps = np.concatenate(blocks) if blocks else np.empty(0, np.uint16)
    planes = (steps & 0xFF).astype(np.uint8).tobytes() + (steps >> 8).astype(np.uint8).tobytes()
    # Level 9 takes four times as long and saves only 1 % of the size.
    return layout, base64.b64encode(gzip.compress(planes, 6, mtime=0)).decode()


@dataclass(frozen=True)
class PageFigure:
    """Figure on disk with its title and caption."""

    text: FigureText
    path: Path
    width: int  # image width, px
    height: int

    @property
    def source(self) -> Markup:
        """Data URL of the image."""
        image = base64.b64encode(self.path.read_bytes()).decode("ascii")
        return Markup(f"data:image/png;base64,{image}")  # noqa: S704  only base64 characters


def script_json(data: object) -> Markup:
    """Return JSON that cannot close its enclosing script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))  # noqa: S704  no markup is left


def script_hashes(*scripts: str) -> Markup:
    """Return the sources for a content security policy that allows only the given scripts."""
    hashes = (
        base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
        for script in scripts
    )
    return Markup(" ".join(f"'sha256-{value}'" for value in hashes))  # noqa: S704  only base64 characters


@cache
def make_environment() -> Environment:
    """Return the Jinja environment for the page templates."""
    environment = Environment(
        loader=PackageLoader("abhv_mc.report.pages", "template"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["kind"] = lambda item: type(item).__name__
    environment.filters["typed"] = _typed
    return environment


def _typed(text: str) -> Markup:
    """Return text in which passages between backticks are marked as commands."""
    pieces = [escape(piece) for piece in text.split("`")]
    return Markup("").join(  # The result contains escaped text and fixed tags only.
        Markup('<code class="command">{}</code>').format(piece) if i % 2 else piece
        for i, piece in enumerate(pieces)
    )


def page_sections(models: Models, warnings: Sequence[str] = ()) -> dict[str, Section]:
    """Return the sections of all topics that have a section, by topic name."""
    confidence = confidence_records(models, warnings)
    sections = {}
    for topic in all_topics(models.users):
        if section := models.section(topic):
            first = (confidence,) if topic is CONVERGENCE else ()
            sections[topic.name] = replace(section, items=(*first, *section.items))
    return sections


def make_page(
    models: Models,
    figures: Sequence[PageFigure],
    warnings: Sequence[str] = (),
    baseline: Baseline | None = None,
) -> str:
    """Return the report as one HTML file; ``warnings`` name figures that could not be made."""
    results, names, campaign = models.results, models.names, models.results.campaign
    colors = controller_colors(results.controllers)
    template = files("abhv_mc.report.pages") / "template"
    script = "".join(map(template_text, (*SCRIPTS, "page_flights.js", "page.js")))
    packed_library = (template / "plotly-basic.min.js.gz").read_bytes()
    envelopes, arrays = envelope_data(results, names.controllers, colors)
    flights, columns = make_flights_view(results, names.controllers, colors)
    flights["folder"] = names.folder
    layout, packed = pack_arrays({**arrays, **columns})
    verdicts, manifest = models[VERDICTS], results.manifest
    version = manifest.versions.get("abhv_mc")
    origin = campaign.simulator.origin
    seeds = ", ".join(map(str, campaign.pooled_seeds or [campaign.seed]))
    drawn = f"imported from {origin}" if origin else f"seed {seeds}"
    chart = chart_rows(verdicts.glance, names.controllers, colors)
    summary, before = summarize(models).at(names.folder), baseline_record(baseline, names)
    sections = page_sections(models, warnings)
    comparison = sections.get(COMPARISON.name)
    flown = grouped_digits(next(iter(models[FLIGHTS].counts.values())).flown)
    return (
        make_environment()
        .get_template("page.html.j2")
        .render(
            title=campaign.name,
            kicker=" \N{MIDDLE DOT} ".join(
                filter(
                    None,
                    (
                        campaign.name,
                        Path(campaign.model.vehicle).stem if campaign.simulator.mission else "",
                        f"flights of each: {flown}, {drawn}",
                        (manifest.started or "").partition("T")[0],
                        campaign.model.author,
                        f"abhv-mc {version}" if version else "",
                    ),
                )
            ),
            question=campaign.question or f"What does the campaign {campaign.name} show?",
            state=manifest.state,
            sections=sections,
            comparison=comparison.tables()[0] if comparison else None,
            figure_of={figure.text.name: figure for figure in figures},
            style=Markup("".join(map(template_text, STYLES))),  # noqa: S704  files of this package
            script=Markup(script),  # noqa: S704
            script_hashes=script_hashes(script, gzip.decompress(packed_library).decode()),
            plotly=Markup(base64.b64encode(packed_library).decode()),  # noqa: S704  only base64 characters
            packed=Markup(packed),  # noqa: S704  only base64 characters
            data=script_json({"envelopes": envelopes, "flights": flights, "places": layout}),
            chart=chart,
            beyond=any(bar.beyond for _, bars in chart for bar in bars),
            with_tolerance=any(bar.tolerance is not None for _, bars in chart for bar in bars),
            required=bool(verdicts.requirements),
            many=len(names.controllers) > MOST_BARS,
            summary=Records(tuple(filter(None, (*summary.records, before)))),
            limit_position=LIMIT_POSITION,
            shapes=SHAPES,
            campaign=campaign,
            more_rows=max(0, len(verdicts.glance) - MOST_ROWS),
        )
    )


@dataclass(frozen=True)
class Answer:
    """Result of a search or a comparison, for a page and the terminal."""

    title: str
    kicker: str  # line of text above the title
    section: Section
    figures: Iterable[Drawn]  # figures, made on iteration


def make_table(
    title: str, caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]]
) -> Table:
    """Return a table of strings, in which passages between backticks are marked as commands."""
    cells = tuple(tuple(Cell(text) for text in row) for row in rows)
    return Table(title, tuple(heads), (cells,), f"{title}. {caption}", numbers=False)


def write_answer(answer: Answer, path: Path, folder: Path | None = None) -> Path:
    """Write a page and its figures; return the path of the page.

    The figures are in ``folder``, by default `figures` next to the page.
    """
    folder, figures = folder or path.parent / "figures", {}
    for text, figure in answer.figures:
        file = folder / f"{text.name}.png"
        figures[text.name] = PageFigure(text, file, *write_png(figure, file))
    style = Markup(template_text("style.css"))  # noqa: S704  our own file
    write_text(
        path,
        make_environment()
        .get_template("answer.html.j2")
        .render(answer=answer, figure_of=figures, style=style),
    )
    return path
