"""The page of a paired comparison: gates, who is better in what and by how much, the flights that only one loses."""

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
from abhv_mc.report.numbers.compare import (
    CampaignPair,
    Compared,
    compare_results,
    gate_words,
    pair_campaigns,
    sides,
)
from abhv_mc.report.numbers.contrast import Contrast, contrast_results
from abhv_mc.report.numbers.judgement import few
from abhv_mc.report.numbers.runs import COMPARISON_FILE
from abhv_mc.report.pages.contrast_page import contrast_figures, contrast_rows, contrast_section
from abhv_mc.report.pages.page import Answer, make_table, write_answer
from abhv_mc.topics.comparison import pair_tables
from abhv_mc.topics.comparison.figures import DifferencePanel, plot_differences
from abhv_mc.topics.comparison.model import metric_differences
from abhv_mc.topics.comparison.sentences import pair_words, standing, verdict_of
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.names import Names, full_labels, names_of
from abhv_mc.topics.plain import plain
from abhv_mc.topics.section import Bullets, FigureText, Item, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn
from abhv_mc.topics.words import ends_of, fixed, joined, p_value

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Comparison:
    """Two campaigns compared: in numbers, in words and tables, as a figure, and as a page if one is asked for.

    Attributes
    ----------
    found
        `Compared`, flight by flight, of the same samples; else `Contrast`.
    page
        The page that was written.
    """

    found: Compared | Contrast
    section: Section = field(repr=False)
    page: Path | None
    _draw: Callable[[], Iterable[Drawn]] = field(repr=False)

    def numbers(self) -> dict[str, Any]:
        """Return the numbers of ``abhv-mc compare --json``."""
        numbers: dict[str, Any] = plain(self.found)
        return numbers

    @property
    def table(self) -> "pd.DataFrame":
        """One row a controller and quantity: differences with their 95 % intervals.

        Of the same samples the first minus the second: the median over flights, and quantiles. Of others the second
        minus the first: the share of flights that fails each requirement, and quantiles, with both sides' values.
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
        """Return the figure of the page. Raise InputError if no flight differs or nothing is drawn."""
        for _, figure in self._draw():
            return figure
        raise InputError("figure", "no metric that differs", "campaigns of which a flight differs")


def _paired_rows(found: Compared) -> Iterator[tuple[object, ...]]:
    """Yield the rows of :attr:`Comparison.table` of a paired comparison."""
    for pair in found.paired:
        for metric, entry in pair.metrics.items():
            names = {"median": entry.median_difference, **entry.quantile_differences}
            for level, difference in names.items():
                words = "median over flights" if level == "median" else f"{level[1:]} % quantile"
                ends = difference.value, difference.low, difference.high
                yield (*pair.controllers, metric, words, nan, nan, *ends)


def compare_folders(
    folder_a: Path,
    folder_b: Path,
    controllers: Sequence[str] = (),
    margins: Mapping[str, float] | None = None,
    out: Path | None = None,
    requirements: RequirementSource | None = None,
    is_paired: bool = False,
) -> Comparison:
    """Compare two folders flight by flight if their samples are the same, else by their distributions.

    Write a page into ``out``. Raise InputError for folders that have nothing in common, and for different samples if
    ``margins`` or ``is_paired`` need flight by flight.
    """
    a, b = (read_flown(folder, requirements) for folder in (folder_a, folder_b))
    try:
        a, b = pair_campaigns(a, b)
    except InputError:
        if margins or is_paired or a.campaign.unknowns.names or b.campaign.unknowns.names:
            raise
        return _contrast(a, b, controllers, out)
    found = compare_results(a, b, controllers, margins)
    told = _told(a, b, found)

    def draw() -> list[Drawn]:
        return _figures(a, b, {words: pair for words, pair, _ in told if not _is_same(pair)})

    section = _section(a, b, found, told)
    page = None
    if out is not None:
        one, other = _folder_names(a, b)
        title = joined([words for words, *_ in told]) if one == other else f"{one} against {other}"
        kicker = f"Paired comparison · {a.campaign.question or a.campaign.name.replace('_', ' ')}"
        whole = replace(section, items=(*section.items, _provenance(a, b, found, out)))
        page = write_answer(Answer(title, kicker, whole, draw()), out / "report.html")
        _write_numbers(a, b, found, out)
    for results in (a, b):
        results.refuse_changes()
    return Comparison(found, section, page, draw)


def _write_numbers(
    a: FlownCampaign, b: FlownCampaign, found: Compared | Contrast, out: Path
) -> None:
    """Write `comparison.json`: the numbers, and the digests by which `abhv-mc runs` finds the page."""
    digests = [each.manifest.digest for each in (a, b)]
    content = {"digests": digests, **plain(found)}
    write_text(out / COMPARISON_FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _contrast(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str], out: Path | None
) -> Comparison:
    """Compare two campaigns on different samples."""
    found, titles = contrast_results(a, b, controllers), _folder_names(a, b)
    section, page = contrast_section(a, b, found, titles), None

    def draw() -> Iterator[Drawn]:
        return contrast_figures(a, b, found, titles)

    if out is not None:
        kicker = f"Comparison on different samples · {a.campaign.question or a.campaign.name}"
        words = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(out)]
        words += ["--controllers", ",".join(controllers)] if controllers else []
        rows = [(str(each.folder), str(each.manifest.digest)) for each in (a, b)]
        made = make_table(
            "What was compared",
            f"This page again: `{shlex.join(words)}`",
            ("folder", "digest of its flights"),
            rows,
        )
        whole = replace(section, items=(*section.items, made))
        shown = Answer(" and ".join(titles), kicker, whole, draw())
        page = write_answer(shown, out / "report.html")
        _write_numbers(a, b, found, out)
    for results in (a, b):
        results.refuse_changes()
    return Comparison(found, section, page, draw)


def _section(
    a: FlownCampaign,
    b: FlownCampaign,
    found: Compared,
    told: Sequence[tuple[str, CampaignPair, Names]],
) -> Section:
    answers: list[str] = []
    tables: list[Item] = []
    for title, pair, names in told:
        answers += _sentences(title, pair, names, found)
        if not _is_same(pair):
            tables += _tables(title, pair, names, found)
    answers.append(
        "Differences are of the same flights, the first minus the second, with 95 % intervals; a flight that ended "
        "early counts as worse than any that did not."
    )
    if any(names.campaign.judged for _, _, names in told):
        answers[-1] += (
            " Who is better allows for all metrics that are asked for and of control usage."
        )
    unknowns = a.campaign.unknowns
    if unknowns.names:
        count = len(unknowns.points)
        answers.append(
            f"Compared at the {count} values of the unknowns that both ran; flight {count} k + p is sample k "
            "at the p-th."
        )
    flying = dict.fromkeys(str(each.folder) for each in (a, b) if each.campaign.can_rerun)
    again = (
        f"`{shlex.join(['abhv-mc', 'replay', one])} --controller NAME --flight NUMBER`"
        for one in flying
    )
    if flying and not unknowns.names:
        answers.append(f"A flight again, bit for bit: {' or '.join(again)}.")
    return Section(
        "Answer", (_lead(told, b), Bullets(tuple(answers)), Picture("differences"), *tables)
    )


def _told(
    a: FlownCampaign, b: FlownCampaign, found: Compared
) -> list[tuple[str, CampaignPair, Names]]:
    """How each pair is called, and what its two sides are."""
    told, names, (first, second) = [], names_of(a), _folder_names(a, b)
    for pair in found.paired:
        one, other = (
            full_labels(of.folder, [name])[name]
            for of, name in zip((a, b), pair.controllers, strict=True)
        )
        title, sides_of = f"{one} against {other}", (one, other)
        if first != second and one == other:
            title, sides_of = one, (first, second)
        elif first != second:
            sides_of = f"{first} ({one})", f"{second} ({other})"
            title = " against ".join(sides_of)
        told.append(
            (
                title,
                pair,
                replace(names, controllers=dict(zip((pair.a, pair.b), sides_of, strict=True))),
            )
        )
    return told


def _folder_names(a: FlownCampaign, b: FlownCampaign) -> tuple[str, str]:
    """Names of two folders that tell them apart; twice the same of one folder."""
    one, other = a.folder.resolve(), b.folder.resolve()
    return (str(one), str(other)) if one.name == other.name else (one.name, other.name)


def _lead(told: Sequence[tuple[str, CampaignPair, Names]], b: FlownCampaign) -> Lead:
    """Which of the two is better with which controller, in what, and what to do where the second fails more."""
    answers: dict[str, list[str]] = {}
    because = []
    for title, pair, names in told:
        held, first, second = standing(pair, names), names.label(pair.a), names.label(pair.b)
        words = {"better": f"{first} is better", "worse": f"{second} is better", "mixed": "mixed",
                 "open": "no difference is shown"}  # fmt: skip
        answer = "no winner is named, as the flights are not independent"
        if names.campaign.judged:
            answer = words[verdict_of(pair, names)]
            parts = (
                [f"loses {'more' if pair.losing == 'b' else 'fewer'} flights"]
                if pair.losing
                else []
            )
            sides_of = (("worse", held["better"]), ("better", held["worse"]))
            parts += [f"is {word} in {few(metrics)}" for word, metrics in sides_of if metrics]
            because += [f"{title}: {second} {joined(parts)}."] if parts else []
        answers.setdefault(answer, []).append(title)
    words_of = "; ".join(f"{answer} ({joined(titles)})" if len(answers) > 1 else answer
                         for answer, titles in answers.items())  # fmt: skip
    command = f": `{shlex.join(['abhv-mc', 'explain', b.folder.as_posix(), '--all'])}`"
    if not b.campaign.can_rerun:
        command = " in the second's report"
    failed = any(pair.any_failure.only_b for _, pair, _ in told)
    following = f"Next: see what makes flights fail{command}." if failed else ""
    return Lead(f"{words_of[0].upper()}{words_of[1:]}.", tuple(because[:3]), next=following)


def _is_same(pair: CampaignPair) -> bool:
    """Whether no flight differs in any metric, nor in what it fails."""
    differ = any(entry.a_better or entry.b_better for entry in pair.metrics.values())
    return not differ and not pair.any_failure.only_a and not pair.any_failure.only_b


def _provenance(a: FlownCampaign, b: FlownCampaign, found: Compared, folder: Path) -> Table:
    """Which flights were compared, and how again."""
    seeds = [(str(each.campaign.seed) if each.campaign.can_rerun else "adopted") for each in (a, b)]
    rows = [
        [str(each.folder), seed, fixed(each.manifest.runs_done, 0), str(each.manifest.digest)]
        for each, seed in zip((a,) if a.folder == b.folder else (a, b), seeds, strict=False)
    ]
    across = next(
        (pair.controllers for pair in found.paired if len(set(pair.controllers)) > 1), None
    )
    words = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(folder)]
    words += ["--controllers", ",".join(across)] if across else []
    for pair in found.paired[:1]:
        for metric, gate in pair.not_worse.items():
            words += ["--fail-if-worse", f"{metric}={100.0 * gate.margin:g}%"]
    heads = ("folder", "seed", "flights", "digest of its flights")
    return make_table("What was compared", f"This page again: `{shlex.join(words)}`", heads, rows)


def _sentences(title: str, pair: CampaignPair, names: Names, of: Compared) -> list[str]:
    a, b = names.label(pair.a), names.label(pair.b)
    found = [
        f"{title}, {names.metrics[metric].phrase}: {gate_words(pair, metric, b, of.requirements)}."
        for metric in pair.not_worse
    ]
    if _is_same(pair):
        return [
            *found,
            f"{title}: the same in all {fixed(pair.pairs, 0)} flights, in every metric.",
        ]
    judged = names.campaign.judged
    words = (
        pair_words(pair, names) if judged else "no winner is named: the flights are not independent"
    )
    found.append(f"{title}, on the same {fixed(pair.pairs, 0)} flights: {words}.")
    failed = pair.any_failure
    if failed.only_a or failed.only_b:
        found.append(
            f"{title}: {fixed(failed.only_a, 0)} flights fail under {a} alone, {fixed(failed.only_b, 0)} under "
            f"{b} alone, {fixed(failed.both, 0)} under both (McNemar p {p_value(failed.p_value)})."
        )
    else:
        found.append(
            f"{title}: no flight fails under one alone, {fixed(failed.both, 0)} under both."
        )
    return found


def _tables(title: str, pair: CampaignPair, names: Names, found: Compared) -> Iterator[Table]:
    """Each with the name of the controllers that it is of, in its title and above it."""
    differing = [item for item in pair.metrics.items() if item[1].a_better or item[1].b_better]
    metrics = dict(sorted(differing, key=lambda item: not item[1].compared))
    for table in pair_tables(pair, names, metrics, found.requirements):
        yield replace(table, title=f"{title}: {table.title}", caption=f"{title}: {table.caption}")


def _figures(a: FlownCampaign, b: FlownCampaign, pairs: Mapping[str, CampaignPair]) -> list[Drawn]:
    """What is asked and how much each surface was used; metrics in which no flight differs are left out."""
    flights = {title: sides(a, b, *pair.controllers) for title, pair in pairs.items()}
    panels, equal = [], []
    for metric in dict.fromkeys((*a.asked, *SURFACE_USAGE)):
        if metric not in a.metrics or metric not in b.metrics:
            continue
        record = a.campaign.metrics[metric]
        differences = {title: metric_differences(*each, metric) for title, each in flights.items()}
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
        "Share of flights at or below each difference; the mark is the median with its 95 % interval. Left of the line "
        "the first has the smaller value. A curve that begins above 0 % or ends below 100 % had flights that only one "
        "of the two lost; axes leave out the outermost 1 % of the flights."
    )
    caption += f" The same in every flight: {joined(equal)}." if equal else ""
    figure = plot_differences(
        panels, {name: name for name in pairs}, controller_colors(tuple(pairs)), "no difference"
    )
    return [(FigureText("differences", "Paired differences", caption), figure)]
