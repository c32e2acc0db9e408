"""How sure a report is: what its intervals and verdicts rest on."""

from collections.abc import Mapping
from typing import Any

from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import fixed, joined, percent


def confidence_sentence(models: Models, numbers: Mapping[str, Any]) -> str:
    """What the intervals and verdicts rest on."""
    campaign = numbers["campaign"]
    flown = {counts["flown"] for counts in numbers["flights"].values()}
    flights = joined([fixed(count, 0) for count in sorted(flown)])
    text = f"Based on {flights} flights of each controller, the same dispersions for all"
    text += "; intervals are 95 %." if campaign["independent_flights"] else "."
    if not campaign["independent_flights"]:
        text += (
            f" The flights of a {campaign['sampling']} design are not independent draws: exact binomial statistics do "
            "not hold, so quantiles, differences and their intervals are estimates and no verdict is given."
        )
    elif models[VERDICTS].requirements:
        largest = max(entry.asked.consumer_risk for entry in models[VERDICTS].requirements)
        text += (
            f" A system that just misses a requirement would ever PASS with a probability of at most "
            f"{percent(largest, 2)}, however often one looks or extends the campaign; the intervals are for one look."
        )
        if campaign["stops_when_proven"]:
            text += f" The campaign stops when proven, after at most {fixed(campaign['runs'], 0)} flights."
    for warning in numbers["warnings"]:
        text += f" Note: {warning}."
    if numbers["state"] != "complete":
        text += " The campaign is not complete; all numbers are preliminary."
    return text
