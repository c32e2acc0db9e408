"""Unpaired comparison of two campaigns: verdicts, failure shares, quantiles and figures."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.folder.controller_flights import ControllerFlights, severities
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.inputs import FolderInputs, content_of, describe_changes, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.compare import pair_controllers, select_flights
from abhv_mc.statistics.estimates import LEVELS, Interval, quantile
from abhv_mc.statistics.unpaired import quantile_difference, share_difference
from abhv_mc.topics.figure_style import CYCLE
from abhv_mc.topics.formatting import count_of, estimate, fixed, level_name, percent
from abhv_mc.topics.metrics.figures import make_spread, plot_distributions
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words
from abhv_mc.topics.topic import (
    Cell,
    Drawn,
    FigureText,
    Fold,
    Item,
    Picture,
    Section,
    Table,
    full_labels,
    grouped,
    interval_cell,
    make_records,
)


@dataclass(frozen=True)
class SideVerdict:
    """Verdict of one campaign on a requirement."""

    status: str
    failures: int
    flights: int


@dataclass(frozen=True)
class ContrastRequirement:
    """Verdicts of both campaigns on a requirement, and the change of the failure share."""

    words: str
    probability: float
    before: SideVerdict
    after: SideVerdict
    share_difference: Interval


@dataclass(frozen=True)
class ContrastQuantile:
    """Quantile in both campaigns, and the difference, which is None if it cannot be estimated."""

    before: Interval
    after: Interval
    difference: Interval | None  # second campaign minus first campaign


@dataclass(frozen=True)
class ContrastController:
    """Comparison of one controller in the first campaign with one in the second campaign."""

    controllers: tuple[str, str]
    flights: tuple[int, int]
    requirements: tuple[ContrastRequirement, ...]
    metrics: Mapping[str, Mapping[str, ContrastQuantile]]  # quantiles by metric and level


@dataclass(frozen=True)
class Contrast:
    """Comparison of two campaigns on different samples by the first campaign's requirements."""

    # changed inputs, e.g. 'dispersions.aero.drag.half_width: "15 %" -> "25 %"'
    changes: tuple[str, ...]
    words: Mapping[str, Mapping[str, str]]  # printed names of each metric
    contrasted: tuple[ContrastController, ...]


def contrast_results(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str] = ()
) -> Contrast:
    """Compare the distributions of the metrics that two campaigns have in common.

    Raise InputError for campaigns with unknowns, because their flights are not drawn from a single
    distribution.
    """
    for results in (a, b):
        if results.campaign.unknowns.names:
            raise InputError(
                results.folder,
                "the campaign has unknowns, and its samples differ from those of the other folder",
                "the same samples, or campaigns without unknowns",
            )
    metrics = [name for name in a.compared if name in b.metrics]
    requirements = [item for item in a.campaign.requirements if item.metric in b.metrics]
    is_judged = a.campaign.judged and b.campaign.judged
    contrasted = []
    for pair in pair_controllers(a, b, controllers):
        flights = select_flights(a, b, *pair)
        contrasted.append(
            ContrastController(
                pair,
                (flights[0].flight.size, flights[1].flight.size),
                tuple(_contrast_requirement(item, *flights, is_judged) for item in requirements),
                {metric: _contrast_quantiles(metric, *flights) for metric in metrics},
            )
        )
    records = a.campaign.metrics
    return Contrast(
        tuple(find_changes(a, b)),
        {name: records[name].as_texts() for name in metrics},
        tuple(contrasted),
    )


def find_changes(a: FlownCampaign, b: FlownCampaign) -> list[str]:
    """Return the changes of inputs, requirements and flight code from one campaign to another."""
    before, after = (_read_inputs(results) for results in (a, b))
    changes = describe_changes(before, after, extensible=False)
    changes += [
        f"requirements.{change}" for change in find_requirement_changes(before.data, after.data)
    ]
    if a.manifest.source_hash != b.manifest.source_hash:
        commits = (
            (results.manifest.commit or results.manifest.source_hash)[:12] for results in (a, b)
        )
        changes.append("flight code: {} -> {}".format(*commits))
    return changes


def _read_inputs(results: FlownCampaign) -> FolderInputs:
    """Return the inputs of a folder with contents instead of hashes, which comments change."""
    inputs = read_folder_inputs(CampaignFolder(results.folder), results.manifest)
    paths = {name: results.folder / name for name in inputs.hashes}
    contents = {name: content_of(path) for name, path in paths.items() if path.is_file()}
    return replace(inputs, hashes={**inputs.hashes, **contents})


def _contrast_requirement(
    item: Requirement, a: ControllerFlights, b: ControllerFlights, is_judged: bool
) -> ContrastRequirement:
    before, after = (_verdict(item, flights, is_judged) for flights in (a, b))
    counts = before.failures, before.flights, after.failures, after.flights
    return ContrastRequirement(
        requirement_words(item, a.records),
        item.probability,
        before,
        after,
        share_difference(*counts),
    )


def _verdict(item: Requirement, flights: ControllerFlights, is_judged: bool) -> SideVerdict:
    failures, absent = requirement_failures(flights, item).sum(), flights.not_computed
    verdict = item.judge(failures, flights.flight.size + absent, absent)
    return SideVerdict(
        verdict.status if is_judged else "ESTIMATE", verdict.failures, verdict.flights
    )


def _contrast_quantiles(
    metric: str, a: ControllerFlights, b: ControllerFlights
) -> dict[str, ContrastQuantile]:
    first, second = (severities(flights, metric) for flights in (a, b))
    sense = a.records[metric].bad
    quantiles = {}
    for level in LEVELS:
        difference = quantile_difference(first, second, level)
        quantiles[level_name(level)] = ContrastQuantile(
            quantile(first, level).in_sense(sense),
            quantile(second, level).in_sense(sense),
            difference and difference.in_sense(sense),
        )
    return quantiles


_MOST_PANELS = 6
_DASH = "\N{EM DASH}"


def contrast_section(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Section:
    """Return the section with changed inputs, changed verdicts and tables."""
    labels = _labels(a, b, contrast)
    texts = [
        *change_texts(contrast, labels),
        *(
            ("Changed inputs", change)
            for change in contrast.changes
            if not change.startswith("name: ")
        ),
        ("Differences", "second minus first, 95 % intervals (Newcombe, bootstrap), not paired"),
    ]
    differing, every = (
        _quantile_table(a, contrast, labels, titles, shows_all=shows_all)
        for shows_all in (False, True)
    )
    tables = [_verdict_table(a, contrast, labels, titles), differing]
    items: list[Item] = [table for table in tables if table.groups]
    items += [Fold(every.title, (every,))] if every.groups else []
    return Section("Summary", (make_records(texts), Picture("distributions"), *items))


def _labels(a: FlownCampaign, b: FlownCampaign, contrast: Contrast) -> list[str]:
    labels = []
    for pair in contrast.contrasted:
        label_a, label_b = (
            full_labels(results.folder, [name])[name]
            for results, name in zip((a, b), pair.controllers, strict=True)
        )
        labels.append(label_a if label_a == label_b else f"{label_a} -> {label_b}")
    return labels


def change_texts(contrast: Contrast, labels: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each controller's changed verdicts and significant changes of failure shares."""
    for label, controller in zip(labels, contrast.contrasted, strict=True):
        items = controller.requirements
        changes = []
        for item in items:
            before, after, is_shown = item.before, item.after, _is_shown(item.share_difference)
            if after.status != before.status or is_shown:
                shares = (percent(side.failures / side.flights, 2) for side in (before, after))
                shown = "significant" if is_shown else "not significant"
                text = f"{label}: {item.words}, failed {' -> '.join(shares)} ({shown})"
                changes.append((f"{before.status} -> {after.status}", text))
        yield from changes
        if items and not changes:
            passed = sum(item.after.status == "PASS" for item in items)
            yield "Verdicts unchanged", f"{label}: {passed} PASS of {len(items)}"
    if not any(controller.requirements for controller in contrast.contrasted):
        yield "Requirements", "none"


def _verdict_table(
    a: FlownCampaign, contrast: Contrast, labels: Sequence[str], titles: tuple[str, str]
) -> Table:
    flights = {
        (item.before.flights, item.after.flights)
        for controller in contrast.contrasted
        for item in controller.requirements
    }
    groups = []
    for i, asked in enumerate(contrast.contrasted[0].requirements):
        rows = []
        for label, controller in zip(labels, contrast.contrasted, strict=True):
            item = controller.requirements[i]
            shares = vars(item.share_difference).values()
            value, low, high = (percent(share, 2) for share in shares)
            sides = (
                f"{side.status}, {side.failures}"
                if len(flights) == 1
                else f"{side.status}, {count_of(side.failures, side.flights)}"
                for side in (item.before, item.after)
            )
            rows.append((Cell(label), *map(Cell, sides), Cell(value, f"{low} to {high}")))
        groups.append(
            grouped(rows, Cell(f"{asked.words} in {percent(asked.probability)}", head=True))
        )
    counts = ""
    if len(flights) == 1:
        first, second = flights.pop()
        counts = f", in {fixed(first, 0)} and {fixed(second, 0)} flights"
    return Table(
        "Verdicts",
        ("Requirement", a.campaign.kind.capitalize(), *titles, "Difference"),
        tuple(groups),
        "Verdicts and failures by the requirements of the first campaign"
        f"{counts}, and the difference of the failure shares",
        numbers=False,
    )


def contrast_rows(contrast: Contrast) -> Iterator[tuple[object, ...]]:
    """Yield table rows of failure shares and quantiles with their differences."""
    for controller in contrast.contrasted:
        for item in controller.requirements:
            shares = (side.failures / side.flights for side in (item.before, item.after))
            interval = vars(item.share_difference).values()
            yield (*controller.controllers, item.words, "share that fails", *shares, *interval)
        for metric, levels in controller.metrics.items():
            for level, pair in levels.items():
                ends = pair.before.value, pair.after.value
                quantity = f"{level[1:]} % quantile"
                interval = vars(pair.difference or Interval(nan, nan, nan)).values()
                yield (*controller.controllers, metric, quantity, *ends, *interval)


def _is_shown(difference: Interval | None) -> bool:
    return difference is not None and not difference.low <= 0.0 <= difference.high


def _quantile_table(
    a: FlownCampaign,
    contrast: Contrast,
    labels: Sequence[str],
    titles: tuple[str, str],
    *,
    shows_all: bool,
) -> Table:
    """Return a table of all quantiles, or of the differing quantiles of required metrics."""
    groups = []
    for metric, texts in contrast.words.items():
        rows = [
            (
                Cell(label),
                Cell(f"{level[1:]} %"),
                *(Cell(estimate(end)) for end in (pair.before, pair.after)),
                interval_cell(pair.difference) if pair.difference else Cell(_DASH),
            )
            for label, controller in zip(labels, contrast.contrasted, strict=True)
            for level, pair in controller.metrics[metric].items()
            if shows_all or (metric in a.asked and _is_shown(pair.difference))
        ]
        groups += [grouped(rows, Cell(texts["label_with_unit"], head=True))] if rows else []
    title = "All quantiles" if shows_all else "Quantiles with a shown difference"
    caption = f"{title}, of the required metrics"
    if shows_all:
        dash = "fewer than five flights lie beyond the quantile, or early terminations reach it"
        caption = f"{title}. A dash means: {dash}"
    return Table(
        title,
        ("Metric", a.campaign.kind.capitalize(), "Quantile", *titles, "Difference"),
        tuple(groups),
        caption,
    )


def contrast_figures(
    a: FlownCampaign, b: FlownCampaign, contrast: Contrast, titles: tuple[str, str]
) -> Iterator[Drawn]:
    """Yield the figure with the distributions of both campaigns.

    The figure shows the required metrics or, without requirements, the leading metrics.
    """
    metrics = [name for name in a.asked if name in contrast.words][:_MOST_PANELS]
    if not metrics:
        return
    labels = _labels(a, b, contrast)
    colors, flights, dashed = dict[str, str](), dict[str, ControllerFlights](), []
    for i, (label, entry) in enumerate(zip(labels, contrast.contrasted, strict=True)):
        sides = [f"{label}, {title}" for title in titles]
        colors |= dict.fromkeys(sides, CYCLE[i % len(CYCLE)])
        flights |= zip(sides, select_flights(a, b, *entry.controllers), strict=True)
        dashed.append(sides[0])
    caption = (
        "Share of flights at or below each value, dashed for the first campaign. If a curve ends "
        "below 100 % (or begins above 0 %, if small values are bad), the other flights terminated "
        "early."
    )
    spreads = [make_spread(a.campaign, metric, flights) for metric in metrics]
    yield (
        FigureText("distributions", "Distributions of both campaigns", caption),
        plot_distributions(spreads, {name: name for name in flights}, colors, dashed),
    )
