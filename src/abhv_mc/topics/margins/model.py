"""Stability margins in steady flight (nominal and at corners) and in simulated flights."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.flights.metrics import GAIN_MARGIN, MARGIN_FAULTS, MARGIN_NAMES, PHASE_MARGIN
from abhv_mc.flights.outcomes import LAW_LOST
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.steady_margins import SteadyMargins
from abhv_mc.topics.formatting import fixed
from abhv_mc.topics.missed_requirements import failed_anyhow

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
        gain = f"{fixed(self.gain, 1)} dB ({self.gain_loop})" if np.isfinite(self.gain) else ""
        return gain, f"{fixed(self.phase, 0)} deg ({self.phase_loop})" if np.isfinite(
            self.phase
        ) else ""

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
    return Margins(
        results.steady_margins,
        tuple(campaign.model.margins.at if campaign.margin_flights else ()),
        {name: entry for name, entry in flights.items() if entry.flights},
        {
            name: numbers
            for name in flights
            if (numbers := _missing(results.flights[name], campaign.margin_flights))
        },
    )


def _missing(flights: ControllerFlights, flight_count: int) -> tuple[int, ...]:
    lost = np.isin(flights.outcome, LAW_LOST) | (flights.flight >= flight_count)
    return tuple(flights.flight[np.isnan(flights.metrics[MARGIN_NAMES[0]]) & ~lost].tolist())


def _of_flights(results: FlownCampaign, controller: str) -> FlightMargins:
    flights = results.flights[controller]
    rows = np.flatnonzero(np.isfinite(flights.metrics[MARGIN_NAMES[0]]))
    values = {name: flights.metrics[name][rows] for name in MARGIN_NAMES}
    faults = {signal.name: flights.metrics[signal.name][rows] for signal in MARGIN_FAULTS}
    lost = failed_anyhow(flights, results.campaign.requirements)[rows]
    gain = values[MARGIN_NAMES[0]]
    low = gain < GAIN_MARGIN.customary
    unstable, at_limit = (
        int((values_of_flights > 0).sum()) for values_of_flights in faults.values()
    )
    required = bool(results.campaign.requirements and rows.size)
    return FlightMargins(
        flights=int(rows.size),
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
        failed_below=(int((lost & low).sum()), int(low.sum())) if required else None,
        failed_above=(int((lost & ~low).sum()), int((~low).sum())) if required else None,
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
