"""How each number of a report settled as flights came in."""

from typing import Any

from abhv_mc.folder.controller_flights import severities
from abhv_mc.folder.results import Results
from abhv_mc.statistics.convergence import Trace, failure_trace, looks, quantile_traces
from abhv_mc.statistics.estimates import LEVELS
from abhv_mc.topics.failed_flights import requirement_failures
from abhv_mc.topics.plain import level_name, plain


def _series(trace: Trace, sense: str = "high") -> dict[str, Any]:
    if sense == "low":
        trace = Trace(trace.flights, [-v for v in trace.value], [-v for v in trace.high], [-v for v in trace.low])
    return {"value": plain(trace.value), "low": plain(trace.low), "high": plain(trace.high)}


def convergence_numbers(results: Results) -> dict[str, Any]:
    """Quantiles of every metric and failures of every requirement against the number of flights, in flight order."""
    numbers: dict[str, Any] = {}
    for controller in results.controllers:
        flights = results.flights[controller]
        counts = looks(flights.flight.size)
        metrics = {}
        for metric in results.metrics:
            traces = quantile_traces(severities(flights, metric), counts)
            sense = flights.records[metric].bad
            metrics[metric] = {
                level_name(level): _series(trace, sense) for level, trace in zip(LEVELS, traces, strict=True)
            }
        numbers[controller] = {
            "flights": counts.tolist(),
            "metrics": metrics,
            "requirements": [
                _series(failure_trace(requirement_failures(flights, item), counts))
                for item in results.campaign.requirements
            ],
        }
    return numbers
