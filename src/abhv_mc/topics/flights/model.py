"""What each flight did: how they ended, what they drew, what a board has to know of them, and the worst of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.plant.parameters import DISTURBANCES
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.flights.worst_flights import WorstFlight, worst_flights
from abhv_mc.topics.plain import DRAWN

_CYCLES = 5.0  # deg, from side to side: ripple from which a flight is said to cycle
_LIMITS = {"saturates": 0.0, "leaves_tables": 0.0, "cycles": _CYCLES}  # of a record's finding: what is more is said


@dataclass(frozen=True)
class FlightCounts:
    """How the flights of a controller ended."""

    flown: int
    failed: int
    not_computed: int
    outcomes: Mapping[str, int]
    failure_share: Interval


@dataclass(frozen=True)
class Findings:
    """How many flights of a controller show what a board has to know beside their errors."""

    flown: int
    saturated: int | None  # surfaces at a limit of deflection or rate; None where no flight says
    outside_tables: int | None
    cycling: Mapping[str, int]  # by channel
    disturbed: bool  # whether gusts, turbulence or noise are dispersed: what swings then is no limit cycle
    ripple_deg: float = _CYCLES


@dataclass(frozen=True)
class Flights:
    """The flights of each controller."""

    parameters: tuple[str, ...]  # that were dispersed
    dispersions: Mapping[str, Mapping[str, object]]  # as the campaign writes them
    derived: Mapping[str, str]  # parameters that follow from others: their expressions
    counts: Mapping[str, FlightCounts]
    left_out: Mapping[str, int]  # controllers of which the machine computed none, with their flights
    findings: Mapping[str, Findings]
    worst: Mapping[str, tuple[WorstFlight, ...]]
    source: FlownCampaign | None = field(default=None, repr=False, metadata={DRAWN: True})


def compute_flights(results: FlownCampaign) -> Flights:
    """Everything of all controllers."""
    names = results.controllers
    disturbed = not set(DISTURBANCES).isdisjoint(results.campaign.varied)
    return Flights(
        results.dispersed,
        results.campaign.dispersions,
        dict(results.campaign.model.derived),
        {name: _counts(results.flights[name], results.campaign.independent) for name in names},
        _left_out(results),
        {name: _findings(results.flights[name], disturbed) for name in names},
        worst_flights(results),
        results,
    )


def _counts(flights: ControllerFlights, independent: bool) -> FlightCounts:
    flown, failed = int(flights.flight.size), int(flights.failed.sum())
    share = Interval(failed / flown, *(clopper_pearson(failed, flown) if independent else (np.nan, np.nan)))
    return FlightCounts(flown, failed, flights.not_computed, flights.count_outcomes(), share)


def _left_out(results: FlownCampaign) -> dict[str, int]:
    listed = results.manifest.controllers.items()
    lost = {name: ended.outcomes.get("failed_to_run", 0) for name, ended in listed}
    return {name: count for name, count in lost.items() if count and name not in results.controllers}


def _findings(flights: ControllerFlights, disturbed: bool) -> Findings:
    records = {name: record for name, record in flights.records.items() if record.finding and name in flights.metrics}

    def above(finding: str) -> dict[str, int]:
        return {
            record.label.removesuffix(" ripple").lower().replace(" ", "_"): int(
                np.sum(flights.metrics[name] > _LIMITS[finding])
            )
            for name, record in records.items()
            if record.finding == finding
        }

    return Findings(
        int(flights.flight.size),
        max(above("saturates").values(), default=None),
        max(above("leaves_tables").values(), default=None),
        above("cycles"),
        disturbed,
    )
