"""How sure a report is: what its intervals and verdicts rest on, one by one and together."""

from collections.abc import Mapping
from typing import Any

from abhv_mc.report.numbers.words import fixed, joined, percent, significant
from abhv_mc.statistics.verdict_words import risk_words


def _stopping_sentence(campaign: Mapping[str, Any], flown: int) -> str:
    """When it was looked at, and when it stopped."""
    most = fixed(campaign["runs"], 0)
    passed = [look for look in campaign["looks"] if look <= flown]
    if flown == campaign["runs"]:
        return f"The requirements were looked at {len(passed)} times, the last time after all {most} flights allowed."
    return (
        f"The campaign stopped at look {len(passed)} of {len(campaign['looks'])}, after {fixed(flown, 0)} of at most "
        f"{most} flights, because every requirement was settled; the other intervals do not allow for that."
    )


def sureness_sentence(numbers: Mapping[str, Any]) -> str:
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
        if numbers["sobol"]:
            text += " The intervals of the Sobol indices are 95 %, from resampled groups of flights."
    elif numbers["requirements"]:
        risks = sorted({entry["consumer_risk"] for entry in numbers["requirements"]})
        rule = risk_words(risks[-1], bool(campaign["looks"]))  # the largest holds for all
        text += f" {rule[0].upper()}{rule[1:]}.{_family_words(numbers)}"
    if campaign["looks"] and len(flown) == 1:
        text += " " + _stopping_sentence(campaign, flown.pop())
    for warning in numbers["warnings"]:
        text += f" Note: {warning}."
    if numbers["state"] != "complete":
        text += " The campaign is not complete; all numbers are preliminary."
    return text


def _family_words(numbers: Mapping[str, Any]) -> str:
    """What holds for all verdicts together: the chance of any false PASS, or how many to expect; what would stand."""
    verdicts = [verdict for entry in numbers["requirements"] for verdict in entry["controllers"].values()]
    bound, expected = numbers["any_false_pass"], numbers["expected_false_passes"]
    if bound is None or len(verdicts) < 2:
        return ""
    if numbers["family_risk"]:
        return (
            f" The chance of any false PASS among all {len(verdicts)} verdicts is at most {percent(bound, 2)} (held by "
            "the campaign's family of verdicts)."
        )
    if round(expected, 9) < 1.0:  # ten risks of 0.1 add up to a bit less than 1
        text = f" Among all {len(verdicts)} verdicts the chance of any false PASS is at most {percent(bound, 2)}."
    else:
        text = (
            f" That is the risk of each of the {len(verdicts)} verdicts by itself: were every requirement just missed "
            f"by every controller, up to {significant(expected, 2)} of them would PASS on average."
        )
    passes = sum(verdict["status"] == "PASS" for verdict in verdicts)
    held = numbers["held_together"]
    if passes and held["stand"] is not None:
        text += (
            f" Judged together, at a chance of {percent(held['risk'], 2)} of any false PASS (Holm; 'family' in the "
            f"campaign), {held['stand'] or 'none'} of the {passes} PASS would stand on these flights."
        )
    return text
