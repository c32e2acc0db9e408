"""Comparison of two campaigns (answer, gates, differences), and its page."""

import json
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.campaign.file.requirement_set import RequirementSource
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.layout import write_text
from abhv_mc.io.messages import InputError, grouped_digits, joined
from abhv_mc.report.numbers.compare import (
    CampaignPair,
    Compared,
    compare_results,
    gate_text,
    pair_campaigns,
    select_flights,
)
from abhv_mc.report.numbers.runs import COMPARISON_FILE
from abhv_mc.report.pages.contrast_page import (
    Contrast,
    contrast_figures,
    contrast_results,
    contrast_rows,
    contrast_section,
)
from abhv_mc.report.pages.page import Answer, make_table, write_answer
from abhv_mc.topics.comparison import pair_tables
from abhv_mc.topics.comparison.figures import DifferencePanel, plot_differences
from abhv_mc.topics.comparison.model import metric_differences, usage_metrics
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.formatting import ends_of, json_data, p_equation, percent, significant
from abhv_mc.topics.topic import (
    Drawn,
    FigureText,
    Fold,
    Item,
    Names,
    Picture,
    Section,
    Table,
    full_labels,
    make_records,
    names_of,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_AGAINST = " against "  # separates the two sides in the title of a pair


@dataclass(frozen=True)
class Comparison:
    """Comparison of two campaigns as numbers, table, figure and optional page.

    Attributes
    ----------
    found
        `Compared` (flight by flight) if the samples are equal, else `Contrast`.
    page
        Path of the page, or None if no page was requested.
    """

    found: Compared | Contrast
    section: Section = field(repr=False)
    page: Path | None
    _draw: Callable[[], Iterable[Drawn]] = field(repr=False)

    def numbers(self) -> dict[str, Any]:
        """Return the numbers of ``abhv-mc compare --json``."""
        numbers: dict[str, Any] = json_data(self.found)
        return numbers

    @property
    def table(self) -> "pd.DataFrame":
        """Differences with their 95 % intervals, one row per controller and quantity.

        If the samples are the same, the rows contain the medians over the flights and the
        quantiles of the differences, first minus second. If the samples differ, the rows contain
        the failure shares and the quantiles of both campaigns, and the differences, second minus
        first.
        """
        import pandas as pd

        rows = (
            _paired_rows(self.found)
            if isinstance(self.found, Compared)
            else contrast_rows(self.found)
        )
        columns = ("a", "b", "metric", "quantity", "first", "second", "difference", "low", "high")
        return pd.DataFrame(list(rows), columns=list(columns))

    def figure(self) -> "Figure":
        """Return the figure of the comparison. Raise InputError if no metric differs."""
        for _, figure in self._draw():
            return figure
        raise InputError(
            "figure", "no metric differs", "campaigns that differ in at least one flight"
        )


def _paired_rows(comparison: Compared) -> Iterator[tuple[object, ...]]:
    """Yield rows of :attr:`Comparison.table` for a paired comparison."""
    for pair in comparison.paired:
        for metric, entry in pair.metrics.items():
            names = {"median": entry.median_difference, **entry.quantile_differences}
            for level, difference in names.items():
                quantity = "median over flights" if level == "median" else f"{level[1:]} % quantile"
                ends = vars(difference).values()
                yield (*pair.controllers, metric, quantity, nan, nan, *ends)


def compare_folders(
    folder_a: Path,
    folder_b: Path,
    controllers: Sequence[str] = (),
    margins: Mapping[str, float] | None = None,
    out: Path | None = None,
    requirements: RequirementSource | None = None,
    is_paired: bool = False,
) -> Comparison:
    """Compare two folders, flight by flight if their samples are equal, else unpaired.

    If ``out`` is given, write a page to this folder. Raise InputError if the folders have nothing
    in common, or if their samples differ and ``margins`` or ``is_paired`` require pairs.
    """
    a, b = (read_flown(folder, requirements) for folder in (folder_a, folder_b))
    first, second = titles = _folder_names(a, b)
    options, subject = [], a.campaign.question or a.campaign.name.replace("_", " ")
    comparison: Compared | Contrast
    try:
        a, b = pair_campaigns(a, b)
    except InputError:
        if margins or is_paired or a.campaign.unknowns.names or b.campaign.unknowns.names:
            raise
        comparison = contrast = contrast_results(a, b, controllers)
        section = contrast_section(a, b, contrast, titles)
        kicker, title = "Comparison on different samples", " and ".join(titles)

        def draw() -> Iterable[Drawn]:
            return contrast_figures(a, b, contrast, titles)
    else:
        comparison = compared = compare_results(a, b, controllers, margins)
        pairs = _label_pairs(a, b, compared)
        section, kicker = _section(a, b, compared, pairs), "Paired comparison"
        differing = {title: pair for title, pair, _ in pairs if not _is_identical(pair)}
        title = joined([title for title, *_ in pairs]) if first == second else _AGAINST.join(titles)
        for metric, margin in (margins or {}).items():
            options += ["--fail-if-worse", f"{metric}={100.0 * margin:g}%"]

        def draw() -> Iterable[Drawn]:
            return _figures(a, b, differing)

    page = None
    if out is not None:
        options += ["--controllers", ",".join(controllers)] if controllers else []
        section_with_source = replace(section, items=(*section.items, _source(a, b, out, options)))
        answer = Answer(title, f"{kicker} · {subject}", section_with_source, draw())
        page = write_answer(answer, out / "report.html")
        # `abhv-mc runs` finds both campaigns by their digests.
        content = {"digests": [x.manifest.digest for x in (a, b)], **json_data(comparison)}
        write_text(out / COMPARISON_FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")
    for results in (a, b):
        results.refuse_changes()
    return Comparison(comparison, section, page, draw)


def _source(a: FlownCampaign, b: FlownCampaign, out: Path, options: Sequence[str]) -> Table:
    """Return the table of the compared campaigns, with the command that remakes the page."""
    rows = [
        [
            str(results.folder),
            str(results.campaign.seed) if results.campaign.can_rerun else "imported",
            grouped_digits(results.manifest.runs_done),
            str(results.manifest.digest),
        ]
        for results in (a, b)[: 1 + (a.folder != b.folder)]
    ]
    command = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(out), *options]
    heads = ("folder", "seed", "flights", "digest of the flights")
    return make_table(
        "Compared campaigns", f"Remake this page with `{shlex.join(command)}`", heads, rows
    )


def _section(
    a: FlownCampaign,
    b: FlownCampaign,
    comparison: Compared,
    pairs: Sequence[tuple[str, CampaignPair, Names]],
) -> Section:
    texts: list[tuple[str, str]] = []
    tables: list[Item] = []
    for title, pair, names in pairs:
        texts += _pair_texts(title, pair, names, comparison)
        if not _is_identical(pair):
            tables += _tables(title, pair, names, comparison)
    texts.append(("Differences", "flight by flight, first minus second, 95 % intervals"))
    unknowns = a.campaign.unknowns
    if unknowns.names:
        count = len(unknowns.points)
        texts.append(
            ("Unknowns", f"{count} common values; flight {count} k + p: sample k, value p")
        )
    folders = dict.fromkeys(str(results.folder) for results in (a, b) if results.campaign.can_rerun)
    for folder in folders if not unknowns.names else ():
        command = shlex.join(["abhv-mc", "replay", folder])
        texts.append(("Re-run a flight", f"`{command} --controller NAME --flight NUMBER`"))
    if any(pair.any_failure.only_b for _, pair, _ in pairs) and b.campaign.can_rerun:
        command = shlex.join(["abhv-mc", "explain", b.folder.as_posix(), "--all"])
        texts.append(("Next", f"`{command}`: flights that fail in the second campaign only"))
    return Section("Summary", (make_records(texts), Picture("differences"), *tables))


def _label_pairs(
    a: FlownCampaign, b: FlownCampaign, comparison: Compared
) -> list[tuple[str, CampaignPair, Names]]:
    """Return each pair with its title and with names that label its two controllers."""
    pairs, names, (first, second) = [], names_of(a), _folder_names(a, b)
    for pair in comparison.paired:
        label_a, label_b = (
            full_labels(results.folder, [name])[name]
            for results, name in zip((a, b), pair.controllers, strict=True)
        )
        title, labels = f"{label_a}{_AGAINST}{label_b}", (label_a, label_b)
        if first != second and label_a == label_b:
            title, labels = label_a, (first, second)
        elif first != second:
            labels = f"{first} ({label_a})", f"{second} ({label_b})"
            title = _AGAINST.join(labels)
        pairs.append(
            (
                title,
                pair,
                replace(names, controllers=dict(zip((pair.a, pair.b), labels, strict=True))),
            )
        )
    return pairs


def _folder_names(a: FlownCampaign, b: FlownCampaign) -> tuple[str, str]:
    """Return names that distinguish two folders; for the same folder the names are equal."""
    path_a, path_b = a.folder.resolve(), b.folder.resolve()
    return (str(path_a), str(path_b)) if path_a.name == path_b.name else (path_a.name, path_b.name)


def _is_identical(pair: CampaignPair) -> bool:
    """Return whether all paired flights agree in every metric and every failure."""
    differ = any(entry.a_better or entry.b_better for entry in pair.metrics.values())
    return not differ and not pair.any_failure.only_a and not pair.any_failure.only_b


def _pair_texts(
    title: str, pair: CampaignPair, names: Names, comparison: Compared
) -> Iterator[tuple[str, str]]:
    """Yield the labelled results of a pair: gates, winners, early terminations and failures."""
    for metric in pair.not_worse:
        gate = gate_text(pair, metric, comparison.requirements)
        yield "Gate", f"{title}: {names.metrics[metric].phrase}, {gate}"
    flights = f"{title}, {grouped_digits(pair.pairs)} flights"
    if _is_identical(pair):
        yield "Identical", flights
        return
    for label, metrics in _group_metrics(pair, names).items():
        yield label, f"{title}: {', '.join(metrics)}" if metrics else ""
    effort = [
        f"{names.metrics[metric].label} {significant(ratio.value, 2)}"
        for metric, ratio in pair.surfaces.items()
        if ratio
    ]
    text = f"{title}, first / second: {', '.join(effort)}"
    yield "Control effort", text if effort else ""
    failed, early = pair.any_failure, pair.ended_early
    for label, counts in (("Failed flights", failed), ("Early terminations", early)):
        only_a, only_b, both = map(grouped_digits, (counts.only_a, counts.only_b, counts.both))
        text = f"{names.label(pair.a)} only {only_a}, {names.label(pair.b)} only {only_b}"
        yield label, f"{flights}: {text}, both {both} ({p_equation(counts.p_value)})"


def _group_metrics(pair: CampaignPair, names: Names) -> dict[str, list[str]]:
    """Return the leading metrics with shares of flights, by the result of the comparison."""
    undecided = "No difference shown" if names.campaign.judged else "Estimates, no winner"
    groups: dict[str, list[str]] = {
        f"Better: {names.label(pair.a)}": [],
        f"Better: {names.label(pair.b)}": [],
        "Mixed": [],
        undecided: [],
    }
    for metric, entry in pair.metrics.items():
        if metric not in names.asked:
            continue
        label = "Mixed" if entry.mixed else undecided
        if entry.winner:
            label = f"Better: {names.label(entry.winner)}"
        shares = (percent(count / pair.pairs, 2) for count in (entry.a_better, entry.b_better))
        worst = " / ".join(map(significant, entry.worst))
        texts = [f"better on {' / '.join(shares)}", f"worst {worst}"]
        texts += [f"worse {100.0 * level:.4g} % quantile" for level in entry.worse_tails[:1]]
        texts += ["more early terminations"] if entry.loses_more else []
        groups[label].append(f"{names.metrics[metric].phrase} ({', '.join(texts)})")
    return groups


def _tables(title: str, pair: CampaignPair, names: Names, comparison: Compared) -> Iterator[Item]:
    """Yield the tables of a pair; tables of metrics that are not compared are collapsed."""
    differing = {
        name: entry for name, entry in pair.metrics.items() if entry.a_better or entry.b_better
    }
    compared, folded = (
        {name: entry for name, entry in differing.items() if entry.compared is is_compared}
        for is_compared in (True, False)
    )
    tables = [
        replace(table, title=f"{title}: {table.title}", caption=f"{title}: {table.caption}")
        for table in pair_tables(pair, names, compared or folded, comparison.requirements)
    ]
    yield from tables
    if compared and folded:
        other, _ = pair_tables(pair, names, folded, comparison.requirements)
        yield Fold(f"{title}: other metrics", (other,))


def _figures(a: FlownCampaign, b: FlownCampaign, pairs: Mapping[str, CampaignPair]) -> list[Drawn]:
    """Return the figure of the differences in required metrics and in control effort.

    Metrics in which no flight differs are omitted.
    """
    flights = {title: select_flights(a, b, *pair.controllers) for title, pair in pairs.items()}
    panels, equal = [], []
    usage = usage_metrics(next(iter(a.flights.values())))
    for metric in dict.fromkeys((*a.asked, *usage)):
        if metric not in a.metrics or metric not in b.metrics:
            continue
        record = a.campaign.metrics[metric]
        differences = {
            title: metric_differences(*pair_flights, metric)
            for title, pair_flights in flights.items()
        }
        if not any(values.any() for values in differences.values()):
            equal.append(record.phrase)
            continue
        ends = {
            title: ends_of(pair.metrics[metric].median_difference) for title, pair in pairs.items()
        }
        panels.append(DifferencePanel(record.label_with_unit, differences, ends))
    if not panels:
        return []
    caption = (
        "Share of flights at or below each difference; the mark is the median with its 95 % "
        "interval. To the left of the line, the first campaign has the smaller value. If a curve "
        "begins above 0 % or ends below 100 %, the other flights terminated early in only one of "
        "the two campaigns. The axes omit the outermost 1 % of the flights."
    )
    caption += f" Equal in every flight: {joined(equal)}." if equal else ""
    figure = plot_differences(
        panels, {name: name for name in pairs}, controller_colors(pairs), "no difference"
    )
    return [(FigureText("differences", "Paired differences", caption), figure)]
