"""Report section that compares all controllers by metric and by pair."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from abhv_mc.flights.statistic import Statistic
from abhv_mc.topics.comparison.model import (
    ComparedMetric,
    Comparison,
    ControllerPair,
    ListedFailures,
    compute_comparison,
)
from abhv_mc.topics.formatting import count_of, fixed, p_value, percent, significant
from abhv_mc.topics.metrics import metric_statistics
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Item,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    figures_of,
    interval_cell,
)

_EFFORT = "Errors against control effort"
_METHOD = (
    "Median, with 95 % quantile / worst flight; bold (* in text): not beaten, that is, no other "
    "{} is significantly better on the same flights (5 % risk over all metrics and pairs, "
    "at any number of flights) without being worse in the tails or in early terminations."
)


def comparison_section(comparison: Comparison, names: Names) -> Section | None:
    """Return the section that compares controllers, or None for a single controller."""
    if not comparison.pairs:
        return None
    results, records = names.results, names.metrics
    angles = [
        metric
        for metric in results.metrics
        if records[metric].statistic == Statistic.RMS
        and records[metric].unit == "deg"
        and records[metric].group == "tracking"
        and metric not in comparison.standings
    ]
    leading = [metric for metric in comparison.standings if metric in names.asked]
    effort = [metric for metric in comparison.standings if metric not in names.asked]
    groups = [
        tuple(_metric_row(comparison, metric, names) for metric in metrics)
        for metrics in (leading, effort, angles)
        if metrics
    ]
    groups.append(tuple(_failure_counts(names)))
    title = f"{names.kind} comparison"
    heads = ("Metric", *names.controllers.values())
    items: tuple[Item, ...] = (
        Text(_METHOD.format(names.campaign.kind)),
        Picture("variants"),
        Table("Comparison by metric", heads, tuple(groups)),
        Fold("All pairs", tuple(_overviews(comparison, names, leading))),
        *([Fold(_EFFORT, (Picture("error_against_usage"),))] if effort else []),
    )
    return Section(title, items)


def _metric_row(comparison: Comparison, metric: str, names: Names) -> Row:
    record, standing = names.metrics[metric], comparison.standings.get(metric)
    cells = []
    for name in names.controllers:
        entry = metric_statistics(names.results.flights[name], metric, record)
        median, upper = (interval_cell(entry.quantiles[level]).text for level in ("q50", "q95"))
        best = standing is not None and name in standing.not_beaten
        cells.append(Cell(median, f"{upper} / {significant(entry.worst, 3)}", best=best))
    return (Cell(record.label_with_unit, head=True), *cells)


def _failure_counts(names: Names) -> Iterator[Row]:
    """Yield the numbers of failures of each requirement, and of early terminations."""
    flights = [names.results.flights[name] for name in names.controllers]
    masks = {
        f"Failures, {requirement_words(item, names.metrics)}": [
            requirement_failures(entry, item) for entry in flights
        ]
        for item in names.requirements
    }
    masks["Early terminations"] = [entry.failed for entry in flights]
    for text, failed in masks.items():
        cells = [Cell(fixed(mask.sum(), 0), f"of {fixed(mask.size, 0)}") for mask in failed]
        yield (Cell(text, head=True), *cells)


def _overviews(comparison: Comparison, names: Names, metrics: Sequence[str]) -> Iterator[Table]:
    """Yield tables of differences in ``metrics`` and of failures, with one row for each pair."""
    labels = [names.metrics[metric].label_with_unit for metric in metrics]
    pairs = comparison.pairs.values()
    yield Table(
        "Differences of all pairs",
        ("First", "Second", *labels),
        (tuple(_pair_row(pair, names, metrics) for pair in pairs),),
        "Median of first minus second, with 95 % interval, and share of flights on which the first "
        "is better; bold: significant",
    )
    requirements = [requirement_words(item, names.metrics) for item in names.requirements]
    yield Table(
        "Failures of all pairs",
        ("First", "Second", *requirements, "Early terminations"),
        (
            tuple(
                (
                    *_pair_heads(pair, names),
                    *(_only_cell(entry) for entry in pair.requirements),
                    replace(_only_cell(pair.ended_early), best=pair.losing is not None),
                )
                for pair in pairs
            ),
        ),
        "Flights that fail with the first only / with the second only, and McNemar's exact "
        "p-value; bold: significant",
    )


def _pair_heads(pair: ControllerPair, names: Names) -> Row:
    return tuple(Cell(names.label(name), head=True) for name in (pair.a, pair.b))


def _pair_row(pair: ControllerPair, names: Names, metrics: Sequence[str]) -> Row:
    cells = []
    for metric in metrics:
        entry = pair.metrics[metric]
        difference = interval_cell(entry.median_difference)
        notes = difference.note, percent(entry.a_better / pair.pairs, 2)
        cells.append(
            replace(difference, note=", ".join(filter(None, notes)), best=entry.winner is not None)
        )
    return (*_pair_heads(pair, names), *cells)


def _only_cell(failures: ListedFailures) -> Cell:
    return Cell(
        f"{fixed(failures.only_a, 0)} / {fixed(failures.only_b, 0)}",
        f"p {p_value(failures.p_value)}" if failures.only_a or failures.only_b else "",
    )


def pair_tables(
    pair: ControllerPair,
    names: Names,
    metrics: Mapping[str, ComparedMetric],
    requirements: Sequence[str],
) -> Iterator[Table]:
    """Yield a pair's table of differences in ``metrics`` and its table of failures.

    The last row of failures counts early terminations. ``requirements`` are texts.
    """
    a, b = names.label(pair.a), names.label(pair.b)
    rows = []
    for metric, entry in metrics.items():
        _, *tails = entry.quantile_differences.values()
        gain, winner = entry.pairing_gain, "mixed" if entry.mixed else "neither"
        texts = (
            count_of(entry.a_better, pair.pairs),
            f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none",
            (names.label(entry.winner) if entry.winner else winner) if entry.compared else "",
        )
        differences = map(interval_cell, (entry.median_difference, *tails))
        head = Cell(names.metrics[metric].label_with_unit, head=True)
        rows.append((head, *differences, *map(Cell, texts)))
    yield Table(
        "Differences",
        ("Metric", "Median difference", "of 95 % quantiles", "of 99.73 %", f"{a} better in",
         "Pairing gain", "Better"),
        (tuple(rows),),
        f"Medians of the differences, and quantiles of {a} minus quantiles of {b}, with 95 % "
        "intervals. An interval has no bound on a side for which there are too few flights. "
        '"Not reached" means that more flights terminated early than lie beyond the quantile. '
        '"Pairing gain" is the factor by which the number of flights would have to be larger in an '
        "unpaired comparison of the means",
    )  # fmt: skip
    ended = "Completed the mission" if names.campaign.kind == "controller" else "Completed"
    missed = zip([*requirements, ended], [*pair.requirements, pair.ended_early], strict=True)
    yield Table(
        f"Failures of one {names.campaign.kind} only, {a} against {b}",
        ("Requirement", "Both failed", f"Only {a}", f"Only {b}", "Neither", "p-value",
         f"Flights, only {a}", f"Flights, only {b}"),
        (tuple(_failure_row(text, failures) for text, failures in missed),),
        "Paired comparison of failures (McNemar's exact test)",
    )  # fmt: skip


def _failure_row(label: str, failures: ListedFailures) -> Row:
    def flights(listed: tuple[int, ...], count: int) -> str:
        ellipsis = ["\N{HORIZONTAL ELLIPSIS}"] * (count > len(listed))
        return ", ".join([*map(str, listed), *ellipsis]) or "\N{EM DASH}"

    counts = failures.both, failures.only_a, failures.only_b, failures.neither
    texts = (
        *(fixed(count, 0) for count in counts),
        p_value(failures.p_value),
        flights(failures.flights_only_a, failures.only_a),
        flights(failures.flights_only_b, failures.only_b),
    )
    return (Cell(label, head=True), *map(Cell, texts))


COMPARISON = Topic(
    "comparison", Comparison, compute_comparison, comparison_section, figures_of(__name__)
)
