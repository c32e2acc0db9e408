"""The report's section on failures in flight."""

from collections.abc import Sequence

from abhv_mc.flight.failure_case import NO_FAILURE
from abhv_mc.topics.failure_cases.model import CaseFlights, FailureCase, FailureCases
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Picture, Row, Section, Table, Text
from abhv_mc.topics.words import count_of, percent


def failure_case_sentences(found: FailureCases, names: Names) -> Sequence[str]:
    """How many flights of each controller survived each single failure; none where none came alone."""
    words = []
    for entry in found.cases:
        if entry.case != NO_FAILURE and " + " not in entry.case:
            each = [
                f"{names.label(name)} {count_of(cell.flights - cell.lost, cell.flights)}"
                for name, cell in entry.controllers.items()
            ]
            words.append(f"{entry.case}: {', '.join(each)}")
    return [f"Flights that survived one failure alone: {'; '.join(words)}."] if words else []


def failure_case_section(found: FailureCases, names: Names) -> Section | None:
    """A row for each case and controller; None where no failure is dispersed."""
    if not found.cases:
        return None
    heads = ("What fails", "Flights", "Controller", "Survived (95 % interval)", "Lost",
             "Median time from the failure to the loss", "Requirements")  # fmt: skip
    return Section(
        "Failures in flight",
        (
            Text(
                "A flight survives if it reaches the end of the mission. Cases are what was drawn to fail before that, "
                "the same flights for every controller. Verdicts are of the flights of the case alone, each by itself: "
                "no allowance is made for their number."
            ),
            Table("Survival by failure case", heads, tuple(_group(entry, names) for entry in found.cases)),
            Picture("failure_survival"),
            Picture("failure_bands"),
        ),
    )


def _group(entry: FailureCase, names: Names) -> tuple[Row, ...]:
    rows = [_row(names.label(name), cell) for name, cell in entry.controllers.items()]
    case = Cell(entry.case, rows=len(rows), head=True), Cell(str(entry.flights), rows=len(rows))
    return ((*case, *rows[0]), *rows[1:])


def _row(label: str, cell: CaseFlights) -> Row:
    share = cell.survived
    bounds = f"{percent(share.low, 1)} to {percent(share.high, 1)}" if share.low == share.low else ""  # nan: none
    time = "" if cell.median_time_to_loss_s is None else f"{cell.median_time_to_loss_s:.1f} s"
    words = [f"{words}: missed by {each.missed}, {each.status}" for words, each in cell.requirements.items()]
    if cell.margins is not None:
        unstable = count_of(cell.margins.unstable, cell.margins.flights)
        words.append(f"least gain margin {cell.margins.median_db:.1f} dB in the median, unstable at a point {unstable}")
    cells = Cell(percent(share.value, 1), bounds), Cell(str(cell.lost)), Cell(time), Cell("; ".join(words))
    return (Cell(label, head=True), *cells)
