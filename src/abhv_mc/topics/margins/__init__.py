"""Report topic: stability margins of each controller in steady and in simulated flight."""

from collections.abc import Iterator, Sequence

from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.folder.steady_margins import ControllerMargins, LoopMargins
from abhv_mc.topics.formatting import count_of, fixed, percent
from abhv_mc.topics.margins.model import (
    LISTED,
    FlightMargins,
    Margins,
    compute_margins,
    loop_name,
)
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import (
    Cell,
    Fold,
    Heading,
    Item,
    Picture,
    Row,
    Section,
    Table,
    Text,
    grouped,
)
from abhv_mc.topics.topic import Topic, figures_of


def missing_margins(margins: Margins, names: Names) -> Sequence[str]:
    """Return clauses on the flights whose margins could not be computed."""
    clauses = []
    for name, flights in margins.missing.items():
        listed = ", ".join([*map(str, flights[:LISTED]), *["..."] * (len(flights) > LISTED)])
        clauses.append(
            f"margins not computed of {names.label(name)}: {len(flights)} (flights {listed})"
        )
    return clauses


def _margin_fault(margins: Margins, controller: str) -> str:
    """Return why a controller has no margins in steady flight; '' if it has margins."""
    entry = margins.steady.controllers.get(controller)
    if entry is None:
        return ""
    if entry.fault is not None:
        return f"no margins in steady flight at the mission's start: {entry.fault}"
    together = entry.nominal[-1]
    if not together.stable:
        poles = ", ".join(_pole(*pole) for pole in together.poles if pole[0] > 0.0)
        return f"unstable in steady, level flight (poles at {poles} per second)"
    return ""


def _pole(real: float, imaginary: float) -> str:
    return f"+{real:.3f}" + (f" \N{PLUS-MINUS SIGN} {imaginary:.2f}j" if imaginary else "")


_DIGITS = dict(zip(MARGIN_NAMES, (1, 0, 0, 2), strict=True))
_HEADS = ("Gain (dB)", "Phase (deg)", "Delay (ms)", "Disk margin")
_BOTH = "\N{PLUS-MINUS SIGN}"


def margin_section(margins: Margins, names: Names) -> Section | None:
    """Return the section on stability margins; None if there are none."""
    steady = margins.steady
    if not steady.controllers:
        return None
    title = "Stability margins of each loop, nominal and smallest over the corners"
    table = Table(
        title,
        (
            "Controller",
            "Loop",
            "Gain (dB)",
            "corners",
            "Phase (deg)",
            "corners",
            "Delay (ms)",
            "corners",
        ),
        tuple(
            _steady_group(names.label(name), entry, steady.corners, _margin_fault(margins, name))
            for name, entry in steady.controllers.items()
        ),
    )
    items: list[Item] = [
        Text(
            "The closed loop (plant, actuators, engine and sampled control law) is linearized "
            "in steady, level flight at the mission's start. Each loop is broken at its actuator "
            "with the others closed. Values are nominal, followed by the smallest over "
            f"{'all' if steady.all_corners else 'random'} {steady.corners} corners of the "
            "dispersions. Gain margins are given for a decrease / an increase of the gain in dB; "
            '"all at once" denotes the disk margin, the permissible simultaneous gain or phase '
            "perturbation of all loops."
        ),
        Fold(title, (table,)),
    ]
    return Section("Stability margins", (*items, *_flight_items(margins, names)))


def _steady_group(label: str, entry: ControllerMargins, corners: int, why: str) -> tuple[Row, ...]:
    if not entry.nominal or not entry.nominal[-1].stable:
        return ((Cell(label, head=True), Cell(why, columns=7)),)
    note = (
        f"unstable corners: {count_of(entry.corners_unstable, corners)}"
        if entry.corners_unstable
        else ""
    )
    least = {row.loop: row for row in entry.corners}
    rows = [_loop_row(row, least.get(row.loop, LoopMargins(row.loop))) for row in entry.nominal]
    return grouped(rows, Cell(label, note, head=True))


def _loop_row(row: LoopMargins, corner: LoopMargins) -> Row:
    cells = [Cell(loop_name(row.loop), head=True)]
    if row.loop == "all":
        cells += [
            Cell(_margin(loop_margins.disk_gain_db, 1, _BOTH)) for loop_margins in (row, corner)
        ]
        cells += [
            Cell(_margin(loop_margins.disk_phase_deg, 0, _BOTH)) for loop_margins in (row, corner)
        ]
    else:
        pairs = [
            (loop_margins.gain_margin_low_db, loop_margins.gain_margin_high_db)
            for loop_margins in (row, corner)
        ]
        cells += [Cell(f"{_margin(low, 1)} / {_margin(high, 1)}") for low, high in pairs]
        cells += [Cell(_margin(loop_margins.phase_margin_deg, 0)) for loop_margins in (row, corner)]
    cells += [Cell(_margin(loop_margins.delay_margin_ms, 0)) for loop_margins in (row, corner)]
    return tuple(cells)


def _margin(value: float | None, digits: int, sign: str = "") -> str:
    return "none" if value is None else f"{sign}{fixed(value, digits)}"


def _flight_items(margins: Margins, names: Names) -> Iterator[Item]:
    if not margins.flights:
        return
    where = " and ".join(
        "in steady flight at the start"
        if point == "trim"
        else f"{point:g} s into the flight (reference frozen)"
        for point in margins.points
    )
    yield Heading("Margins of the flights")
    yield Text(
        f"Smallest margin over all loops {where}, with the dispersions of each flight. Unstable "
        "points and points with a command at a limit count as zero. Values: median / smallest."
    )
    yield Table(
        "Margins of the flights, median / smallest",
        ("Controller", *_HEADS, "Unstable", "At a limit", "Flights that failed, by gain margin"),
        (tuple(_flights_row(names.label(name), entry) for name, entry in margins.flights.items()),),
    )
    yield Table(
        "Flights with the smallest gain margin",
        ("Controller", "Flight", *_HEADS, "Failed", "Command"),
        tuple(_least_group(name, entry, names) for name, entry in margins.flights.items()),
    )
    yield Picture("margins")


def _flights_row(label: str, entry: FlightMargins) -> Row:
    ends = [
        f"{fixed(entry.margins[name].median, digits)} / {fixed(entry.margins[name].least, digits)}"
        for name, digits in _DIGITS.items()
    ]
    counts = [count_of(count, entry.flights) for count in (entry.unstable, entry.at_limit)]
    return (
        Cell(label, head=True),
        *map(Cell, ends),
        *map(Cell, counts),
        Cell(_failed_words(entry)),
    )


def _failed_words(entry: FlightMargins) -> str:
    """Count the failures among flights with small and with sufficient gain margins.

    Return text such as '3 of 40 (7.5 %) below 6 dB, 0 of 60 (0 %) at 6 dB or above'. Without
    requirements, the text is empty.
    """
    clauses = []
    for counts, side in (
        (entry.failed_below, "below 6 dB"),
        (entry.failed_above, "at 6 dB or above"),
    ):
        if counts and counts[1]:
            clauses.append(f"{count_of(*counts)} ({percent(counts[0] / counts[1], 2)}) {side}")
    return ", ".join(clauses)


def _least_group(controller: str, entry: FlightMargins, names: Names) -> tuple[Row, ...]:
    rows = []
    for flight in entry.least:
        values = [Cell(fixed(flight.margins[name], digits)) for name, digits in _DIGITS.items()]
        command = (
            f"`abhv-mc replay {names.folder} --flight {flight.flight} --controller {controller}`"
        )
        failed = Cell("yes" if flight.failed else "no")
        rows.append((Cell(str(flight.flight), head=True), *values, failed, Cell(command)))
    return grouped(rows, Cell(names.label(controller), head=True))


MARGINS = Topic("margins", Margins, compute_margins, margin_section, figures_of(__name__))
