"""Report section that compares controllers by medians, differences and failures."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from abhv_mc.topics.comparison.model import (
    ComparedMetric,
    Comparison,
    ControllerPair,
    ListedFailures,
    compute_comparison,
)
from abhv_mc.topics.comparison.sentences import asked_of, comparison_sentences, survival_sentences
from abhv_mc.topics.formatting import count_of, fixed, p_value, significant
from abhv_mc.topics.missed_requirements import requirement_words
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import (
    Bullets,
    Cell,
    Fold,
    Item,
    Picture,
    Row,
    Section,
    Table,
    Text,
    interval_cell,
)
from abhv_mc.topics.topic import Topic, figures_of

_DASH = "\N{EM DASH}"
_BETTER = (
    "The table lists medians, and the median of the flight-by-flight differences with its 95 % "
    'interval. "Better" names a winner whose advantage is significant after correction for '
    "multiple comparisons (5 % over all rows and rivals, at any number of flights), and which is "
    "not worse in the tails or in the number of early terminations."
)


def comparison_section(comparison: Comparison, names: Names) -> Section | None:
    """Return the section that compares controllers, or None for a single controller."""
    if not comparison.pairs:
        return None
    first = names.label(next(iter(names.controllers)))
    requirement_texts = [requirement_words(item, names.metrics) for item in names.requirements]
    heads = ("Metric", names.campaign.kind.capitalize(), "Median", f"{first} minus this", "Better")
    pairs = [
        Fold(
            f"{names.label(pair.a)} against {names.label(pair.b)}",
            (
                _difference_table(pair, names, asked_of(pair, names)),
                _failure_table(pair, names, requirement_texts),
            ),
        )
        for pair in comparison.pairs.values()
    ]
    required_rows = tuple(
        tuple(_metric_rows(comparison, m, names)) for m in comparison.medians if m in names.asked
    )
    usage = tuple(
        _usage_row(comparison, m, names) for m in comparison.medians if m not in names.asked
    )
    labels = names.controllers.values()
    usage_heads = ("Metric", *labels, *(f"{first} minus {label}" for label in list(labels)[1:]))
    lost = survival_sentences(comparison, names)
    title, picture = "Differences in control effort", Picture("error_against_usage")
    items: tuple[Item, ...] = (
        *([Bullets(tuple(lost))] if lost else []),
        Text(_BETTER),
        Table("Differences in the required metrics", heads, required_rows),
        *([Fold(title, (Table(title, usage_heads, (usage,)), picture))] if usage else [picture]),
    )
    return Section(f"{names.campaign.kind.capitalize()} comparison", (*items, *pairs))


def _metric_rows(comparison: Comparison, metric: str, names: Names) -> Iterator[Row]:
    first = next(iter(names.controllers))
    head = Cell(names.metrics[metric].label_with_unit, rows=len(names.controllers), head=True)
    for name, label in names.controllers.items():
        pair = comparison.pairs.get(f"{first} - {name}")
        cells: Row = (
            Cell(label, head=True),
            Cell(interval_cell(comparison.medians[metric][name]).text),
        )
        if pair is None:
            cells = (*cells, Cell(""), Cell(""))
        else:
            entry = pair.metrics[metric]
            cells = (*cells, interval_cell(entry.median_difference), _winner_cell(entry, names))
        yield (head, *cells) if name == first else cells


def _usage_row(comparison: Comparison, metric: str, names: Names) -> Row:
    """Return a row with each controller's median, then each rival's median difference."""
    first, *rivals = names.controllers
    pairs = [comparison.pairs.get(f"{first} - {name}") for name in rivals]
    return (
        Cell(names.metrics[metric].label_with_unit, head=True),
        *(Cell(interval_cell(comparison.medians[metric][name]).text) for name in names.controllers),
        *(
            interval_cell(pair.metrics[metric].median_difference) if pair else Cell("")
            for pair in pairs
        ),
    )


def _winner_cell(entry: ComparedMetric, names: Names) -> Cell:
    if not entry.compared:
        return Cell("")
    return Cell(
        "mixed" if entry.mixed else names.label(entry.winner) if entry.winner else "neither"
    )


def pair_tables(
    pair: ControllerPair,
    names: Names,
    metrics: Mapping[str, ComparedMetric],
    requirements: Sequence[str],
) -> Iterator[Table]:
    """Yield a pair's table of differences in ``metrics`` and its table of failures."""
    table = _difference_table(pair, names, metrics)
    rows = tuple(
        (label, interval_cell(entry.median_difference), *cells, _winner_cell(entry, names))
        for (label, _, *cells), entry in zip(table.groups[0], metrics.values(), strict=True)
    )
    heads = (
        "Metric",
        "Median difference",
        "of 95 % quantiles",
        "of 99.73 %",
        *table.heads[4:],
        "Better",
    )
    yield replace(
        table,
        title="Differences",
        heads=heads,
        groups=(rows,),
        caption=table.caption.replace(
            "Quantiles of", "Medians of the differences, and quantiles of", 1
        ),
    )
    yield _failure_table(pair, names, requirements)


def _difference_table(
    pair: ControllerPair, names: Names, metrics: Mapping[str, ComparedMetric]
) -> Table:
    a, b = names.label(pair.a), names.label(pair.b)
    rows = tuple(
        (
            Cell(names.metrics[metric].label_with_unit, head=True),
            *map(interval_cell, entry.quantile_differences.values()),
            Cell(count_of(entry.a_better, pair.pairs)),
            Cell(_gain_words(entry)),
        )
        for metric, entry in metrics.items()
    )
    return Table(
        f"Quantile differences, {a} minus {b}",
        ("Metric", "Median", "95 %", "99.73 %", f"{a} better in", "Pairing gain"),
        (rows,),
        f"Quantiles of {a} minus quantiles of {b}, with 95 % intervals. An interval has no bound "
        'on a side for which there are too few flights. "Not reached" means that more flights '
        'terminated early than lie beyond the quantile. "Pairing gain" is the factor by which the '
        "number of flights would have to be larger in an unpaired comparison of the means",
    )


def _gain_words(entry: ComparedMetric) -> str:
    """Return the pairing gain as text, such as '1.4 times', or 'none'."""
    gain = entry.pairing_gain
    return f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none"


def _failure_table(pair: ControllerPair, names: Names, requirements: Sequence[str]) -> Table:
    """Return a table that counts, by requirement, flights that fail under only one controller.

    The last row counts early terminations. ``requirements`` contains the requirements as text.
    """
    a, b = names.label(pair.a), names.label(pair.b)
    ended = "Completed the mission" if names.campaign.kind == "controller" else "Completed"
    missed = zip([*requirements, ended], [*pair.requirements, pair.ended_early], strict=True)
    return Table(
        f"Failures of one {names.campaign.kind} only, {a} against {b}",
        ("Requirement", "Both failed", f"Only {a}", f"Only {b}", "Neither", "p-value",
         f"Flights, only {a}", f"Flights, only {b}"),
        (tuple(_failure_row(text, failures) for text, failures in missed),),
        "Paired comparison of failures (McNemar's exact test)",
    )  # fmt: skip


def _failure_row(label: str, failures: ListedFailures) -> Row:
    def flights(listed: tuple[int, ...], count: int) -> str:
        ellipsis = "" if count == len(listed) else ", \N{HORIZONTAL ELLIPSIS}"
        return ", ".join(map(str, listed)) + ellipsis if listed else _DASH

    counts = (
        fixed(count, 0)
        for count in (failures.both, failures.only_a, failures.only_b, failures.neither)
    )
    only = (
        flights(failures.flights_only_a, failures.only_a),
        flights(failures.flights_only_b, failures.only_b),
    )
    return (Cell(label, head=True), *map(Cell, (*counts, p_value(failures.p_value), *only)))


COMPARISON = Topic(
    "comparison",
    Comparison,
    compute_comparison,
    comparison_section,
    comparison_sentences,
    figures_of(__name__),
)
