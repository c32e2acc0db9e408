"""Stability margins in steady flight (nominal and at corners) and in simulated flights."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.flights.metrics import GAIN_MARGIN, MARGIN_FAULTS, MARGIN_NAMES, PHASE_MARGIN
from abhv_mc.flights.outcomes import LAW_LOST
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.steady_margins import ControllerMargins, LoopMargins, SteadyMargins
from abhv_mc.topics.formatting import count_of, fixed, percent
from abhv_mc.topics.missed_requirements import failed_anyhow
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Heading,
    Item,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    figures_of,
    grouped,
)

LISTED = 5  # number of listed flights, which have the smallest margins


@dataclass(frozen=True)
class Spread:
    """Median and minimum of a margin over the flights."""

    median: float
    least: float


@dataclass(frozen=True)
class LeastFlight:
    """One of the flights with the smallest margins."""

    flight: int
    failed: bool  # whether the flight terminated early or violated a requirement
    margins: Mapping[str, float]  # margins by name (``MARGIN_NAMES``)
    faults: Mapping[str, float]  # counts by fault (``MARGIN_FAULTS``)


@dataclass(frozen=True)
class FlightMargins:
    """Margins of a controller's flights for which margins were requested."""

    flights: int
    unstable: int  # number of flights that are unstable at one or more points
    at_limit: int
    margins: Mapping[str, Spread]
    least: tuple[LeastFlight, ...]  # flights with the smallest gain margins, smallest first
    # numbers of failed and of all flights below the customary gain margin
    failed_below: tuple[int, int] | None
    # numbers of failed and of all flights above the customary gain margin; both None without
    # requirements
    failed_above: tuple[int, int] | None


@dataclass(frozen=True)
class Margins:
    """Stability margins of each controller in steady flight and in simulated flights."""

    steady: SteadyMargins
    points: tuple[str | float, ...]  # points at which margins were computed: "trim" or a time in s
    flights: Mapping[str, FlightMargins]
    missing: Mapping[str, tuple[int, ...]]  # flights whose requested margins could not be computed


@dataclass(frozen=True)
class LeastMargins:
    """Smallest margins of all loops in steady flight; infinite if unbounded."""

    stable: bool
    gain: float = np.inf  # gain margin in dB
    gain_loop: str = ""
    phase: float = np.inf  # phase margin in deg
    phase_loop: str = ""

    @property
    def words(self) -> tuple[str, str]:
        """Gain and phase margin as '14.3 dB (rudder)' and '63 deg (elevator)'; '' if infinite."""
        gain, phase = self.gain, self.phase
        return (
            f"{fixed(gain, 1)} dB ({self.gain_loop})" if np.isfinite(gain) else "",
            f"{fixed(phase, 0)} deg ({self.phase_loop})" if np.isfinite(phase) else "",
        )

    @property
    def little(self) -> bool:
        """Return whether a margin is below its customary value."""
        return self.gain < GAIN_MARGIN.customary or self.phase < PHASE_MARGIN.customary


def compute_margins(results: FlownCampaign) -> Margins:
    """Return the margins in steady flight and the margins of the campaign's flights."""
    campaign = results.campaign
    flights = {
        name: _of_flights(results, name)
        for name in results.controllers
        if campaign.margin_flights and MARGIN_NAMES[0] in results.flights[name].metrics
    }
    missing = {}
    for name in flights:
        table = results.flights[name]
        lost = np.isin(table.outcome, LAW_LOST) | (table.flight >= campaign.margin_flights)
        unknown = np.isnan(table.metrics[MARGIN_NAMES[0]]) & ~lost
        if unknown.any():
            missing[name] = tuple(table.flight[unknown].tolist())
    return Margins(
        results.steady_margins,
        tuple(campaign.model.margins.at if campaign.margin_flights else ()),
        {name: entry for name, entry in flights.items() if entry.flights},
        missing,
    )


def _of_flights(results: FlownCampaign, controller: str) -> FlightMargins:
    flights = results.flights[controller]
    rows = np.flatnonzero(np.isfinite(flights.metrics[MARGIN_NAMES[0]]))
    values = {name: flights.metrics[name][rows] for name in MARGIN_NAMES}
    faults = {signal.name: flights.metrics[signal.name][rows] for signal in MARGIN_FAULTS}
    lost = failed_anyhow(flights, results.campaign.requirements)[rows]
    gain = values[MARGIN_NAMES[0]]
    low = gain < GAIN_MARGIN.customary
    unstable, at_limit = ((values_of_flights > 0).sum() for values_of_flights in faults.values())
    required = bool(results.campaign.requirements and rows.size)
    return FlightMargins(
        flights=rows.size,
        unstable=unstable,
        at_limit=at_limit,
        margins={
            name: Spread(float(np.median(values_of_flights)), float(values_of_flights.min()))
            for name, values_of_flights in values.items()
            if rows.size
        },
        least=tuple(
            LeastFlight(
                int(flights.flight[rows[i]]),
                bool(lost[i]),
                {name: float(values_of_flights[i]) for name, values_of_flights in values.items()},
                {name: float(values_of_flights[i]) for name, values_of_flights in faults.items()},
            )
            for i in np.lexsort((flights.flight[rows], gain))[:LISTED]
        ),
        failed_below=((lost & low).sum(), low.sum()) if required else None,
        failed_above=((lost & ~low).sum(), (~low).sum()) if required else None,
    )


def least_margins(margins: Margins, controller: str) -> LeastMargins | None:
    """Return the nominal vehicle's smallest margins in steady flight; None if unknown."""
    entry = margins.steady.controllers.get(controller)
    if entry is None or entry.fault is not None:
        return None
    *loops, together = entry.nominal
    if not together.stable:
        return LeastMargins(stable=False)
    loops = [row for row in loops if row.counts]
    gain, loop = min((row.gain_db, row.loop) for row in loops)
    phases = [(row.phase_margin_deg, row.loop) for row in loops if row.phase_margin_deg]
    phase, which = min(phases, default=(np.inf, loop))
    return LeastMargins(True, gain, loop_name(loop), phase, loop_name(which))


def corners_unstable(margins: Margins, controller: str) -> tuple[int, int]:
    """Return the numbers of unstable corners and of all corners of the dispersions' range.

    Unstable corners are counted only if the controller is stable without dispersions.
    """
    entry = margins.steady.controllers.get(controller)
    return entry.corners_unstable if entry else 0, margins.steady.corners


def loop_name(loop: str) -> str:
    """Return the printed name of a control loop."""
    return {"equivalence_ratio": "throttle", "all": "all at once"}.get(loop, loop)


def missing_margins(margins: Margins, names: Names) -> Sequence[str]:
    """Return clauses on the flights whose margins could not be computed."""
    clauses = []
    for name, flights in margins.missing.items():
        listed = ", ".join([*map(str, flights[:LISTED]), *["..."] * (len(flights) > LISTED)])
        clauses.append(
            f"margins not computed of {names.label(name)}: {len(flights)} (flights {listed})"
        )
    return clauses


def _margin_fault(entry: ControllerMargins) -> str:
    """Return why a controller has no margins in steady flight; '' if it has margins."""
    if entry.fault is not None:
        return f"no margins in steady flight at the mission's start: {entry.fault}"
    if entry.nominal[-1].stable:
        return ""
    poles = ", ".join(
        f"+{real:.3f}" + f" {_BOTH} {imaginary:.2f}j" * bool(imaginary)
        for real, imaginary in entry.nominal[-1].poles
        if real > 0.0
    )
    return f"unstable in steady, level flight (poles at {poles} per second)"


_DIGITS = dict(zip(MARGIN_NAMES, (1, 0, 0, 2), strict=True))
_HEADS = ("Gain (dB)", "Phase (deg)", "Delay (ms)", "Disk margin")
_BOTH = "\N{PLUS-MINUS SIGN}"


def margin_section(margins: Margins, names: Names) -> Section | None:
    """Return the section on stability margins; None if there are none."""
    steady = margins.steady
    if not steady.controllers:
        return None
    title = "Stability margins of each loop, nominal and smallest over the corners"
    heads = ("Controller", "Loop", "Gain (dB)", "corners", "Phase (deg)", "corners", "Delay (ms)",
             "corners")  # fmt: skip
    groups = tuple(
        _steady_group(names.label(name), entry, steady.corners)
        for name, entry in steady.controllers.items()
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
        Fold(title, (Table(title, heads, groups),)),
    ]
    return Section("Stability margins", (*items, *_flight_items(margins, names)))


def _steady_group(label: str, entry: ControllerMargins, corners: int) -> tuple[Row, ...]:
    if why := _margin_fault(entry):
        return grouped([(Cell(""),) * 7], Cell(label, why, head=True))
    unstable = entry.corners_unstable
    note = f"unstable corners: {count_of(unstable, corners)}" if unstable else ""
    least = {row.loop: row for row in entry.corners}
    rows = [_loop_row(row, least.get(row.loop, LoopMargins(row.loop))) for row in entry.nominal]
    return grouped(rows, Cell(label, note, head=True))


def _loop_row(row: LoopMargins, corner: LoopMargins) -> Row:
    both = row, corner
    if row.loop == "all":
        texts = [_margin(margins.disk_gain_db, 1, _BOTH) for margins in both]
        texts += [_margin(margins.disk_phase_deg, 0, _BOTH) for margins in both]
    else:
        texts = [
            f"{_margin(margins.gain_margin_low_db, 1)} / {_margin(margins.gain_margin_high_db, 1)}"
            for margins in both
        ]
        texts += [_margin(margins.phase_margin_deg, 0) for margins in both]
    texts += [_margin(margins.delay_margin_ms, 0) for margins in both]
    return (Cell(loop_name(row.loop), head=True), *map(Cell, texts))


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
    failed = [
        f"{count_of(*counts)} ({percent(counts[0] / counts[1], 2)}) {side}"
        for counts, side in (
            (entry.failed_below, "below 6 dB"),
            (entry.failed_above, "at 6 dB or above"),
        )
        if counts and counts[1]
    ]
    return (Cell(label, head=True), *map(Cell, (*ends, *counts, ", ".join(failed))))


def _least_group(controller: str, entry: FlightMargins, names: Names) -> tuple[Row, ...]:
    command = f"`abhv-mc replay {names.folder} --flight {{}} --controller {controller}`"
    rows = [
        (
            Cell(str(flight.flight), head=True),
            *(Cell(fixed(flight.margins[name], digits)) for name, digits in _DIGITS.items()),
            Cell("yes" if flight.failed else "no"),
            Cell(command.format(flight.flight)),
        )
        for flight in entry.least
    ]
    return grouped(rows, Cell(names.label(controller), head=True))


MARGINS = Topic("margins", Margins, compute_margins, margin_section, figures_of(__name__))
