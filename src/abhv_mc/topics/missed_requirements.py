"""Flights that count as failures, grouped by failure mode."""

from collections.abc import Mapping

from abhv_mc.array_types import Mask
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flights.metrics import Metric
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import FlownCampaign

EARLY = "ended early"


def requirement_failures(flights: ControllerFlights, requirement: Requirement) -> Mask:
    """Return a mask [flight] of the flights that fail to meet a requirement.

    Early terminations count as failures unless the requirement judges their measured values.
    """
    return requirement.failures(flights.metrics[requirement.metric], flights.failed)


def failed_anyhow(flights: ControllerFlights, requirements: tuple[Requirement, ...]) -> Mask:
    """Return a mask [flight] of flights that terminate early or miss a requirement."""
    failed = flights.failed.copy()
    for item in requirements:
        failed |= requirement_failures(flights, item)
    return failed


def requirement_words(requirement: Requirement, records: Mapping[str, Metric]) -> str:
    """Return a requirement as text, such as 'Altitude error, max < 50 m'."""
    return limit_words(records[requirement.metric], requirement.limits)


def limit_words(metric: Metric, limits: Bounds) -> str:
    """Return the printed name of a metric with its limits."""
    return f"{metric.label} {metric.with_unit(limits.symbols)}"


def failure_kinds(results: FlownCampaign, controller: str) -> list[tuple[str, Mask]]:
    """Return each failure mode that occurred, with a mask [flight] of its flights."""
    early = results.flights[controller].failed
    kinds = [(EARLY, early)]
    kinds += [
        (
            f"missed: {requirement_words(item, results.campaign.metrics)}",
            requirement_failures(results.flights[controller], item),
        )
        for item in results.campaign.requirements
    ]
    return [(mode, failed) for mode, failed in kinds if failed.any()]
