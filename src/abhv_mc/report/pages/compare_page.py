"""The page of a paired comparison: gates, who is better in what and by how much, the flights that only one loses."""

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from abhv_mc.flight.metrics import SURFACE_USAGE
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.report.figures.paired import DifferencePanel, plot_differences
from abhv_mc.report.numbers.compare import CampaignPair, Compared, compare_results, gate_words, read_compared, sides
from abhv_mc.report.numbers.judgement import few
from abhv_mc.report.pages.section_page import Answer, make_table, write_section_page
from abhv_mc.topics.comparison.model import metric_differences
from abhv_mc.topics.comparison.section import failure_table, gain_words, usage_tables
from abhv_mc.topics.figure_style import CYCLE
from abhv_mc.topics.labels import full_labels
from abhv_mc.topics.names import names_of
from abhv_mc.topics.section import Bullets, Cell, FigureText, Item, Lead, Picture, Section, Table, interval_cell
from abhv_mc.topics.topic import Drawn
from abhv_mc.topics.words import ends_of, fixed, joined, p_value, significant

_NAMED = 3  # metrics without a difference, told by name
Labels = tuple[str, str, str]  # how the pair, its first and its second one are called


class Comparison(NamedTuple):
    """Two folders compared: in numbers, in words and tables, and the page where one is asked for."""

    found: Compared
    section: Section
    page: Path | None


def compare_folders(
    folder_a: Path,
    folder_b: Path,
    controllers: Sequence[str] = (),
    margins: Mapping[str, float] | None = None,
    out: Path | None = None,
) -> Comparison:
    """Compare two folders as :func:`compare_results` does; write a page into ``out``. Raises InputError."""
    a, b = read_compared(folder_a, folder_b)
    found = compare_results(a, b, controllers, margins)
    page = None if out is None else write_compare_page(a, b, found, out)
    for results in (a, b):
        results.refuse_changes()
    return Comparison(found, make_comparison(a, b, found), page)


def write_compare_page(a: FlownCampaign, b: FlownCampaign, found: Compared, folder: Path) -> Path:
    """Write `report.html` and `figures/differences.png` of what :func:`compare_results` found into ``folder``."""
    parts = [(_labels(a, b, pair), pair) for pair in found.paired]
    named = [labels for labels, _ in parts]
    one, other = ("", "") if a.folder == b.folder else _folder_names(a, b)
    title = f"{one} against {other}" if one else joined([labels[0] for labels in named])
    question = a.campaign.question or a.campaign.name.replace("_", " ")
    drawn = _figures(a, b, found, [part for part in parts if not _is_same(part[1])])
    section = make_comparison(a, b, found)
    section = replace(section, items=(*section.items, _provenance(a, b, found, folder)))
    return write_section_page(Answer(title, f"Paired comparison · {question}", section), drawn, folder / "report.html")


def make_comparison(a: FlownCampaign, b: FlownCampaign, found: Compared) -> Section:
    """Sentences and tables of what :func:`compare_results` found."""
    answers: list[str] = []
    tables: list[Item] = []
    for pair in found.paired:
        labels = _labels(a, b, pair)
        answers += _sentences(pair, found, labels, a)
        if not _is_same(pair):
            tables += _tables(pair, found, labels, (a, b))
    answers.append(
        "Differences are of the same flights, the first minus the second, with 95 % intervals; a flight that ended "
        "early counts as worse than any that did not."
    )
    return Section("Answer", (_lead(a, b, found), Bullets(tuple(answers)), Picture("differences"), *tables))


def _lead(a: FlownCampaign, b: FlownCampaign, found: Compared) -> Lead:
    """Which of the two is better with which controller, in what, and what to do where the second fails more."""
    told: dict[str, list[str]] = {}
    because = []
    for pair in found.paired:
        (title, *labels), sides_of = _labels(a, b, pair), (pair.a, pair.b)
        entries = [(metric, pair.metrics[metric]) for metric in a.asked if metric in pair.metrics]
        won = [
            [found.words[metric]["phrase"] for metric, entry in entries if entry.winner == side] for side in sides_of
        ]
        if not a.campaign.independent:
            answer = "no winner is named, as the flights are not independent"
        elif pair.losing:
            answer = f"{labels[pair.losing == 'a']} is better"
        elif all(won) or any(entry.mixed for _, entry in entries):
            answer = "mixed"
        else:
            better = [label for label, metrics in zip(labels, won, strict=True) if metrics]
            answer = f"{better[0]} is better" if better else "no difference is shown"
        told.setdefault(answer, []).append(title)
        parts = [f"loses {'more' if pair.losing == 'b' else 'fewer'} flights"] if pair.losing else []
        parts += [
            f"is {word} in {few(metrics)}" for word, metrics in zip(("worse", "better"), won, strict=True) if metrics
        ]
        because += [f"{title}: {labels[1]} {joined(parts)}."] if parts and a.campaign.independent else []
    alone = len(told) == 1
    words = "; ".join(answer if alone else f"{answer} ({joined(titles)})" for answer, titles in told.items())
    failed = any(pair.any_failure.only_b for pair in found.paired)
    command = f": `{shlex.join(['abhv-mc', 'explain', b.folder.as_posix(), '--all'])}`"
    if b.campaign.adopted:
        command = " in the second's report"
    following = f"Next: see what makes flights fail{command}." if failed else ""
    return Lead(f"{words[0].upper()}{words[1:]}.", tuple(because[:3]), next=following)


def _is_same(pair: CampaignPair) -> bool:
    """Whether no flight differs in any metric, nor in what it fails."""
    differ = any(entry.a_better or entry.b_better for entry in pair.metrics.values())
    return not differ and not pair.any_failure.only_a and not pair.any_failure.only_b


def _provenance(a: FlownCampaign, b: FlownCampaign, found: Compared, folder: Path) -> Table:
    """Which flights were compared, and how again."""
    seeds = [("adopted" if each.campaign.adopted else str(each.campaign.seed)) for each in (a, b)]
    rows = [
        [str(each.folder), seed, fixed(each.manifest.runs_done, 0), str(each.manifest.digest)]
        for each, seed in zip((a,) if a.folder == b.folder else (a, b), seeds, strict=False)
    ]
    across = next((pair.controllers for pair in found.paired if len(set(pair.controllers)) > 1), None)
    words = ["abhv-mc", "compare", str(a.folder), str(b.folder), "-o", str(folder)]
    words += ["--controllers", ",".join(across)] if across else []
    for pair in found.paired[:1]:
        for metric, gate in pair.not_worse.items():
            words += ["--fail-if-worse", f"{metric}={100.0 * gate.margin:g}%"]
    heads = ("folder", "seed", "flights", "digest of its flights")
    return make_table("What was compared", f"This page again: `{shlex.join(words)}`", heads, rows)


def _folder_names(a: FlownCampaign, b: FlownCampaign) -> tuple[str, str]:
    """Names of two folders that tell them apart."""
    one, other = a.folder.resolve(), b.folder.resolve()
    return (str(one), str(other)) if one.name == other.name else (one.name, other.name)


def _labels(a: FlownCampaign, b: FlownCampaign, pair: CampaignPair) -> Labels:
    one, other = (full_labels(each.folder, [name])[name] for each, name in zip((a, b), pair.controllers, strict=True))
    if a.folder.resolve() == b.folder.resolve():
        return f"{one} against {other}", one, other
    first, second = _folder_names(a, b)
    if one == other:
        return one, first, second
    return f"{first} ({one}) against {second} ({other})", f"{first} ({one})", f"{second} ({other})"


def _sentences(pair: CampaignPair, of: Compared, labels: Labels, results: FlownCampaign) -> list[str]:
    (title, a, b), words = labels, of.words
    found = [
        f"{title}, {words[metric]['phrase']}: {gate_words(pair, metric, b, of.requirements)}."
        for metric in pair.not_worse
    ]
    if _is_same(pair):
        return [*found, f"{title}: the same in all {fixed(pair.pairs, 0)} flights, in every metric."]
    parts = "no winner is named: the flights are not independent"
    if results.campaign.independent:
        asked = [metric for metric in pair.metrics if metric in results.asked]
        rest = [metric for metric, entry in pair.metrics.items() if entry.compared and metric not in results.asked]
        parts = standing_words(pair, words, a, b, asked or rest)
        parts += _count_words(pair, a, b, rest) if asked and rest else ""
    found.append(f"{title}, on the same {fixed(pair.pairs, 0)} flights: {parts}.")
    failed = pair.any_failure
    if failed.only_a or failed.only_b:
        found.append(
            f"{title}: {fixed(failed.only_a, 0)} flights fail under {a} alone, {fixed(failed.only_b, 0)} under "
            f"{b} alone, {fixed(failed.both, 0)} under both (McNemar p {p_value(failed.p_value)})."
        )
    else:
        found.append(f"{title}: no flight fails under one alone, {fixed(failed.both, 0)} under both.")
    return found


def _count_words(pair: CampaignPair, a: str, b: str, metrics: Sequence[str]) -> str:
    """'; of 13 others A is better in 11, B in 2': usage and the like, which the table has one by one."""
    won = Counter(pair.metrics[metric].winner for metric in metrics if not pair.metrics[metric].mixed)
    sides = [(name, won[side]) for side, name in ((pair.a, a), (pair.b, b)) if won[side]]
    parts = [f"{name} {'' if i else 'is better '}in {count}" for i, (name, count) in enumerate(sides)]
    return f"; of {len(metrics)} metrics of usage {', '.join(parts)}" if parts else ""


def standing_words(
    pair: CampaignPair, words: Mapping[str, Mapping[str, str]], a: str, b: str, metrics: Sequence[str]
) -> str:
    """'A is better in ... (worst 1.2 deg, against 3.4), B in ...; undecided in ...; no difference is shown in ...'."""
    found: dict[str, list[str]] = {pair.a: [], pair.b: [], "mixed": [], "": []}
    for metric in metrics:
        entry = pair.metrics[metric]
        text, won = words[metric]["phrase"], "mixed" if entry.mixed else entry.winner or ""
        if entry.winner:
            own, other = map(significant, entry.worst[:: 1 if won == pair.a else -1])
            text += f" (worst {own} {words[metric]['unit'].removeprefix('-')}".rstrip() + f", against {other})"
        found[won].append(text)
    if len(found[""]) > _NAMED:
        told = any(found[side] for side in found if side)
        found[""] = [f"{'the other' if told else 'any of the'} {len(found[''])} metrics compared"]
    undecided = "undecided (the tails or lost flights contradict) in"
    heads = {pair.a: f"{a} is better in", pair.b: f"{b} is better in", "mixed": undecided}
    heads[""] = "no difference is shown in"
    return "; ".join(f"{heads[side]} {joined(named)}" for side, named in found.items() if named)


def _tables(pair: CampaignPair, found: Compared, labels: Labels, of: Sequence[FlownCampaign]) -> Iterator[Table]:
    title, a, b = labels
    rows = []
    differing = [item for item in pair.metrics.items() if item[1].a_better or item[1].b_better]
    for metric, entry in sorted(differing, key=lambda item: not item[1].compared):
        won = "mixed" if entry.mixed else {pair.a: a, pair.b: b}.get(entry.winner or "", "neither")
        counts = [fixed(count, 0) for count in (entry.a_better, entry.b_better)]
        rows.append((
            Cell(found.words[metric]["label_with_unit"], head=True),
            *map(interval_cell, (entry.median_difference, entry.quantile_differences["q95"])),
            *map(Cell, (*counts, gain_words(entry), won if entry.compared else "")),
        ))  # fmt: skip
    heads = ("Metric", "Median difference", "of 95 % quantiles", f"{a} better", f"{b} better", "Pairing gain", "Better")
    used = " and in control usage" if any(pair.usage.values()) else ""
    caption = (
        f"{title}: {a} minus {b}, with 95 % intervals, over {fixed(pair.pairs, 0)} flights; not reached: more flights "
        f"were lost than lie beyond the quantile. A winner is named in what is asked{used}, allowing for all of these. "
        "Pairing gain: an unpaired comparison of the means would need this many times the flights."
    )
    yield Table(f"{title}: differences", heads, (tuple(rows),), caption)
    requirements = tuple(item for item in of[0].campaign.requirements if item.metric in found.words)
    names = replace(names_of(of[0]), controllers={pair.a: a, pair.b: b}, requirements=requirements)
    yield _titled(title, failure_table(pair, names))
    if lost := _lost_rows(pair, found.requirements, labels, of):
        caption = "Of each requirement and side the first ten"
        if not all(each.campaign.adopted for each in of):
            caption += "; each is flown again, bit for bit, by the command"
        columns = ("flight", "fails under", "and not under", "what", "flown again by")
        yield make_table(f"{title}: flights that only one fails", caption, columns, lost)
    yield from (_titled(title, table) for table in usage_tables(pair, names))


def _titled(of: str, table: Table) -> Table:
    """A table with the name of the controllers that it is of, in its title and above it."""
    return replace(table, title=f"{of}: {table.title}", caption=f"{of}: {table.caption or table.title}")


def _lost_rows(
    pair: CampaignPair, requirements: Sequence[str], labels: Labels, of: Sequence[FlownCampaign]
) -> list[list[str]]:
    """A row for each listed flight that only one fails."""
    missed: dict[tuple[int, int], list[str]] = {}  # side and flight: what it fails there and not on the other side
    for words, entry in zip(["ended early", *requirements], [pair.ended_early, *pair.requirements], strict=True):
        for side, flights in enumerate((entry.flights_only_a, entry.flights_only_b)):
            for flight in flights:
                missed.setdefault((side, flight), []).append(words)
    return [
        [
            str(flight), labels[1 + side], labels[2 - side], "; ".join(words),
            "" if of[side].campaign.adopted else "`" + shlex.join(
                ["abhv-mc", "replay", str(of[side].folder), "--flight", str(flight), "--controller",
                 pair.controllers[side]]) + "`",
        ]
        for (side, flight), words in sorted(missed.items())
    ]  # fmt: skip


def _figures(
    a: FlownCampaign, b: FlownCampaign, found: Compared, parts: list[tuple[Labels, CampaignPair]]
) -> list[Drawn]:
    """What is asked and how much each surface was used; metrics in which no flight differs are left out."""
    pairs = {labels[0]: pair for labels, pair in parts}
    flights = {name: sides(a, b, *pair.controllers) for name, pair in pairs.items()}
    panels, equal = [], []
    for metric in dict.fromkeys((*a.asked, *SURFACE_USAGE)):
        if metric not in found.words:
            continue
        differences = {name: metric_differences(*each, metric) for name, each in flights.items()}
        label = found.words[metric]["label_with_unit"]
        if not any(values.any() for values in differences.values()):
            equal.append(found.words[metric]["phrase"])
            continue
        medians = {name: pair.metrics[metric].median_difference for name, pair in pairs.items()}
        ends = {name: ends_of(entry) for name, entry in medians.items()}
        panels.append(DifferencePanel(label, differences, ends))
    if not panels:
        return []
    caption = (
        "Share of flights at or below each difference; the mark is the median with its 95 % interval. Left of the line "
        "the first has the smaller value. A curve that begins above 0 % or ends below 100 % had flights that only one "
        "of the two lost; axes leave out the outermost 1 % of the flights."
    )
    caption += f" The same in every flight: {joined(equal)}." if equal else ""
    colors = {name: CYCLE[i % len(CYCLE)] for i, name in enumerate(pairs)}
    figure = plot_differences(panels, {name: name for name in pairs}, colors, "no difference")
    return [(FigureText("differences", "Paired differences", caption), figure)]
