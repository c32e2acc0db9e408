"""How large the errors are: distributions, and a table for each group of metrics."""

from collections.abc import Iterator

from abhv_mc.topics.metrics.model import ControllerMetric, Metrics, MetricTable
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Fold, Picture, Row, Section, Table, Text, interval_cell
from abhv_mc.topics.words import significant

GROUPS = {
    "asked": "What is asked",
    "tracking": "Tracking errors",
    "usage": "Control usage",
    "loads": "Loads and validity",
    "stability": "Stability margins",
    "user": "Metrics of this campaign",
}
_HEADS = ("Median", "95 %", "99.73 %", "Worst", "Flight")


def metric_section(found: Metrics, names: Names) -> Section:
    """What is asked, then by group; settled metrics where they say something else."""
    text = (
        "Quantiles over the flights with their exact 95 % intervals (order statistics), to the digits that the number "
        "of flights allows, and the worst flight. Where small values are the bad ones the quantiles are taken from "
        'below. "Not reached": more flights ended early than lie beyond the quantile. `metrics.csv` has all metrics; '
        "on paper stand those that are asked."
    )
    if not names.independent:
        text += " These intervals would be exact for independent flights, which those of this design are not."
    return Section("How large the errors are", (Text(text), Picture("distribution_asked"), *_folds(found, names)))


def _folds(found: Metrics, names: Names) -> Iterator[Fold]:
    for group, title in GROUPS.items():
        listed = []
        for metric, table in found.table.items():
            own = "asked" if metric in names.asked else table.words["group"]
            if own == group and (group == "asked" or not table.same_as):
                listed.append(_rows(table, names))
        if listed:
            yield Fold(title, (Table(title, ("Metric", names.kind.capitalize(), *_HEADS), tuple(listed)),))


def _rows(table: MetricTable, names: Names) -> tuple[Row, ...]:
    words = table.words
    note = "small is bad" if words["bad"] == "low" else ""
    head = Cell(words["label_with_unit"], note, rows=len(table.controllers), head=True, hint=words["doc"])
    rows = [_row(names.label(name), cell) for name, cell in table.controllers.items()]
    return ((head, *rows[0]), *rows[1:])


def _row(label: str, found: ControllerMetric) -> Row:
    flight = found.worst_flight
    worst = Cell("\N{EM DASH}" if flight is None else str(flight))
    levels = map(interval_cell, found.quantiles.values())
    return (Cell(label, head=True), *levels, Cell(significant(found.worst, 4)), worst)
