"""Comparison of two campaigns (answer, gates, differences), and its page."""

import json
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.campaign.file.requirement_set import RequirementSource
from abhv_mc.flight.metrics import SURFACE_USAGE
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.layout import write_text
from abhv_mc.io.input_error import InputError
from abhv_mc.io.phrases import counted, joined
from abhv_mc.report.numbers.compare import (
    CampaignPair,
    Compared,
    compare_results,
    gate_words,
    pair_campaigns,
    select_flights,
)
from abhv_mc.report.numbers.contrast import Contrast, contrast_results
from abhv_mc.report.numbers.runs import COMPARISON_FILE
from abhv_mc.report.pages.contrast_page import contrast_figures, contrast_rows, contrast_section
from abhv_mc.report.pages.page import Answer, make_table, write_answer
from abhv_mc.report.pages.pair_sentences import pair_words, shorten_list, standing, verdict_of
from abhv_mc.topics.comparison import pair_tables
from abhv_mc.topics.comparison.figures import DifferencePanel, plot_differences
from abhv_mc.topics.comparison.model import metric_differences
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.formatting import ends_of, fixed, p_equation
from abhv_mc.topics.json_data import json_data
from abhv_mc.topics.names import Names, full_labels, names_of
from abhv_mc.topics.section import Bullets, FigureText, Fold, Item, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn

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
                ends = difference.value, difference.low, difference.high
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
    try:
        a, b = pair_campaigns(a, b)
    except InputError:
        if margins or is_paired or a.campaign.unknowns.names or b.campaign.unknowns.names:
            raise
        return _contrast(a, b, controllers, out)
    comparison = compare_results(a, b, controllers, margins)
    pairs = _label_pairs(a, b, comparison)

    def draw() -> list[Drawn]:
        return _figures(a, b, {title: pair for title, pair, _ in pairs if not _is_identical(pair)})

    section = _section(a, b, comparison, pairs)
    page = None
    if out is not None:
        name_a, name_b = _folder_names(a, b)
        title = (
            joined([title for title, *_ in pairs])
            if name_a == name_b
            else f"{name_a} against {name_b}"
        )
        kicker = f"Paired comparison · {a.campaign.question or a.campaign.name.replace('_', ' ')}"
        full_section = replace(section, items=(*section.items, _provenance(a, b, comparison, out)))
        page = write_answer(Answer(title, kicker, full_section, draw()), out / "report.html")
        _write_numbers(a, b, comparison, out)
    for results in (a, b):
        results.refuse_changes()
    return Comparison(comparison, section, page, draw)


def _write_numbers(
    a: FlownCampaign, b: FlownCampaign, comparison: Compared | Contrast, out: Path
) -> None:
    """Write `comparison.json`.

    The file contains the numbers, and the digests that `abhv-mc runs` uses to find both campaigns.
    """
    digests = [results.manifest.digest for results in (a, b)]
    content = {"digests": digests, **json_data(comparison)}
    write_text(out / COMPARISON_FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _contrast(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str], out: Path | None
) -> Comparison:
    """Return the comparison of two campaigns on different samples."""
    contrast, titles = contrast_results(a, b, controllers), _folder_names(a, b)
    section, page = contrast_section(a, b, contrast, titles), None

    def draw() -> Iterator[Drawn]:
        return contrast_figures(a, b, contrast, titles)

    if out is not None:
        kicker = f"Comparison on different samples · {a.campaign.question or a.campaign.name}"
        command = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(out)]
        command += ["--controllers", ",".join(controllers)] if controllers else []
        rows = [(str(results.folder), str(results.manifest.digest)) for results in (a, b)]
        provenance = make_table(
            "Compared campaigns",
            f"Remake this page with `{shlex.join(command)}`",
            ("folder", "digest of the flights"),
            rows,
        )
        full_section = replace(section, items=(*section.items, provenance))
        answer = Answer(" and ".join(titles), kicker, full_section, draw())
        page = write_answer(answer, out / "report.html")
        _write_numbers(a, b, contrast, out)
    for results in (a, b):
        results.refuse_changes()
    return Comparison(contrast, section, page, draw)


def _section(
    a: FlownCampaign,
    b: FlownCampaign,
    comparison: Compared,
    pairs: Sequence[tuple[str, CampaignPair, Names]],
) -> Section:
    answers: list[str] = []
    tables: list[Item] = []
    for title, pair, names in pairs:
        answers += _sentences(title, pair, names, comparison)
        if not _is_identical(pair):
            tables += _tables(title, pair, names, comparison)
    answers.append(
        "Differences are computed flight by flight, first minus second, with 95 % intervals; an "
        "early termination counts as worse than any completed flight."
    )
    if any(names.campaign.judged for _, _, names in pairs):
        answers[-1] += (
            " The better side is determined over all required metrics and the control effort, "
            "with a correction for their number."
        )
    unknowns = a.campaign.unknowns
    if unknowns.names:
        count = len(unknowns.points)
        answers.append(
            f"The campaigns are compared at the {counted(count, 'value')} of the unknowns that "
            f"both ran; flight {count} k + p is sample k at value p."
        )
    folders = dict.fromkeys(str(results.folder) for results in (a, b) if results.campaign.can_rerun)
    commands = (
        f"`{shlex.join(['abhv-mc', 'replay', folder])} --controller NAME --flight NUMBER`"
        for folder in folders
    )
    if folders and not unknowns.names:
        answers.append(f"Re-run a flight, bit for bit, with {' or '.join(commands)}.")
    return Section(
        "Summary", (_lead(pairs, b), Bullets(tuple(answers)), Picture("differences"), *tables)
    )


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


def _lead(pairs: Sequence[tuple[str, CampaignPair, Names]], b: FlownCampaign) -> Lead:
    """Return the lead of the page: the better side of each pair, reasons, and the next step."""
    answers: dict[str, list[str]] = {}
    because = []
    for title, pair, names in pairs:
        metrics_by_side, first, second = (
            standing(pair, names),
            names.subject(pair.a),
            names.subject(pair.b),
        )
        answer_of = {
            "better": f"{first} is better than {second}",
            "worse": f"{second} is better than {first}",
            "mixed": "mixed",
            "open": "no difference is shown",
        }
        answer = "no winner is named, because the flights are not independent"
        if names.campaign.judged:
            answer = answer_of[verdict_of(pair, names)]
            differences = (
                [f"has {'more' if pair.losing == pair.b else 'fewer'} early terminations"]
                if pair.losing
                else []
            )
            directions = (
                ("worse", metrics_by_side["better"]),
                ("better", metrics_by_side["worse"]),
            )
            differences += [
                f"is {direction} in {shorten_list(metrics)}"
                for direction, metrics in directions
                if metrics
            ]
            because += [f"{_spoken(title)}: {second} {joined(differences)}."] if differences else []
        answers.setdefault(answer, []).append(title)
    text = "; ".join(f"{answer} ({joined(titles)})" if len(answers) > 1 else answer
                         for answer, titles in answers.items())  # fmt: skip
    command = f": `{shlex.join(['abhv-mc', 'explain', b.folder.as_posix(), '--all'])}`"
    if not b.campaign.can_rerun:
        command = " in the report of the second campaign."
    failed = any(pair.any_failure.only_b for _, pair, _ in pairs)
    following = f"Next: find out why flights fail{command}" if failed else ""
    return Lead(f"{text[0].upper()}{text[1:]}.", tuple(because[:3]), next=following)


def _is_identical(pair: CampaignPair) -> bool:
    """Return whether all paired flights agree in every metric and every failure."""
    differ = any(entry.a_better or entry.b_better for entry in pair.metrics.values())
    return not differ and not pair.any_failure.only_a and not pair.any_failure.only_b


def _provenance(a: FlownCampaign, b: FlownCampaign, comparison: Compared, folder: Path) -> Table:
    """Return the provenance table of both campaigns, with the command that remakes the page."""
    seeds = [
        (str(results.campaign.seed) if results.campaign.can_rerun else "imported")
        for results in (a, b)
    ]
    rows = [
        [
            str(results.folder),
            seed,
            fixed(results.manifest.runs_done, 0),
            str(results.manifest.digest),
        ]
        for results, seed in zip((a,) if a.folder == b.folder else (a, b), seeds, strict=False)
    ]
    controllers = next(
        (pair.controllers for pair in comparison.paired if len(set(pair.controllers)) > 1), None
    )
    command = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(folder)]
    command += ["--controllers", ",".join(controllers)] if controllers else []
    for pair in comparison.paired[:1]:
        for metric, gate in pair.not_worse.items():
            command += ["--fail-if-worse", f"{metric}={100.0 * gate.margin:g}%"]
    heads = ("folder", "seed", "flights", "digest of the flights")
    caption = f"Remake this page with `{shlex.join(command)}`"
    return make_table("Compared campaigns", caption, heads, rows)


def _spoken(title: str) -> str:
    """Return a pair's title for use in a sentence; lower-case names are quoted."""
    return _AGAINST.join(
        f"'{name}'" if name[:1].islower() else name for name in title.split(_AGAINST)
    )


def _sides(title: str, pair: CampaignPair, names: Names) -> tuple[str, str]:
    """Return names of both sides; the title is the controller if the labels are folders."""
    a, b = names.subject(pair.a), names.subject(pair.b)
    if _AGAINST in title:
        return a, b
    controller = _spoken(title)
    return f"{controller} of campaign {a}", f"{controller} of campaign {b}"


def _sentences(title: str, pair: CampaignPair, names: Names, comparison: Compared) -> list[str]:
    a, b = names.subject(pair.a), names.subject(pair.b)
    sides, title = _sides(title, pair, names), _spoken(title)
    sentences = [
        f"In {names.metrics[metric].phrase}, "
        f"{gate_words(pair, metric, sides, comparison.requirements)}."
        for metric in pair.not_worse
    ]
    flights = counted(pair.pairs, "flight")
    if _is_identical(pair):
        agree = "the only flight agrees" if pair.pairs == 1 else f"all {flights} agree"
        return [*sentences, f"{title}: {agree} in every metric."]
    judged = names.campaign.judged
    verdict = (
        pair_words(pair, names) if judged else "no winner is named: the flights are not independent"
    )
    sentences.append(f"{title}, on the same {flights}: {verdict}.")
    failed = pair.any_failure
    if failed.only_a or failed.only_b:
        sentences.append(
            f"{title}: {counted(failed.only_a, 'flight fails/flights fail')} with {a} only, "
            f"{fixed(failed.only_b, 0)} with {b} only, {fixed(failed.both, 0)} with both "
            f"(McNemar's test, {p_equation(failed.p_value)})."
        )
    elif not failed.both:
        sentences.append(f"{title}: no flight fails.")
    else:
        sentences.append(
            f"{title}: the same flights fail with both controllers "
            f"({counted(failed.both, 'flight')})."
        )
    return sentences


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
    for metric in dict.fromkeys((*a.asked, *SURFACE_USAGE)):
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
        panels, {name: name for name in pairs}, controller_colors(tuple(pairs)), "no difference"
    )
    return [(FigureText("differences", "Paired differences", caption), figure)]
