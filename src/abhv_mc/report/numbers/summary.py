"""What joins the topics of a campaign, in sentences, and how sure it is."""

from collections.abc import Mapping, Sequence

from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.folder.pooled_campaigns import suggest_merge
from abhv_mc.report.numbers.report_numbers import warnings_of
from abhv_mc.topics.convergence import CONVERGENCE
from abhv_mc.topics.flights import FLIGHTS, flight_sentences
from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import fixed, joined, percent
from abhv_mc.vehicle.shared_keys import IN_WIND


def summary_sentences(models: Models) -> list[str]:
    """What a reader with two minutes should know: the answer of each topic in words."""
    return [sentence for topic in all_topics(models.users) for sentence in models.sentences(topic)]


def section_leads(models: Models, warnings: Sequence[str] = ()) -> Mapping[str, Sequence[str]]:
    """What stands first in a topic's section and takes other topics to say; ``warnings``: what else is missing."""
    siblings, command = suggest_merge(models.results.folder, models.results.manifest)
    held = models[VERDICTS].held_together
    jointly = (
        models.sentences(VERDICTS) if held is not None and held.dropped else ()
    )  # tells which do not stand
    windy = [
        f"{words[:1].upper()}{words[1:]}."
        for words in warnings_of(models)
        if words.startswith(IN_WIND)
    ]
    beside = [f"{siblings} All judged together: `{command}`"] if siblings else []
    flights = flight_sentences(models[FLIGHTS], models.names, off_cards=True)
    return {
        VERDICTS.name: [*jointly, *windy, *flights, *beside],
        CONVERGENCE.name: [confidence_sentence(models, warnings)],
    }


def _judged_words(unknowns: Unknowns) -> str:
    shared = unknowns.shared
    if shared is None or shared == len(unknowns.points):
        return "A verdict is of every one of these"
    return (
        f"A verdict is of the first {shared} of these, and of those where the search saw its "
        "requirement fail most often"
    )


def confidence_sentence(models: Models, warnings: Sequence[str] = ()) -> str:
    """What the intervals and verdicts rest on; ``warnings``: what else is missing."""
    campaign, names, requirements = (
        models.results.campaign,
        models.names,
        models[VERDICTS].requirements,
    )
    flights = joined(
        [
            fixed(count, 0)
            for count in sorted({each.flown for each in models[FLIGHTS].counts.values()})
        ]
    )
    text = f"Based on {flights} flights of each {names.campaign.kind}, the same dispersions for all"
    text += "; intervals are 95 %." if campaign.independent else "."
    if campaign.unknowns.names:
        text += (
            f" They are {fixed(campaign.runs_at_point, 0)} flights at each of {len(campaign.unknowns.points)} values "
            f"of the unknowns. {_judged_words(campaign.unknowns)}; what lies between them was searched, not proven. "
            "Quantiles, envelopes and differences are of all of them together; a winner is named where it is one at "
            "every value."
        )
    elif not campaign.independent:
        text += (
            f" {campaign.dependence[:1].upper()}{campaign.dependence[1:]}: exact binomial statistics do not hold, so "
            "quantiles, differences and their intervals are estimates and no verdict is given."
        )
    elif requirements:
        largest = max(entry.asked.consumer_risk for entry in requirements)
        text += (
            f" A system that just misses a requirement would ever PASS with a probability of at most "
            f"{percent(largest, 2)}, however often one looks or extends the campaign; the intervals are for one look."
        )
        if campaign.model.stop:
            text += (
                f" The campaign stops when proven, after at most {fixed(campaign.runs, 0)} flights."
            )
    for warning in (*warnings_of(models), *warnings):
        text += f" Note: {warning}."
    if models.results.manifest.complete is False:
        text += " The campaign is not complete; all numbers are preliminary."
    return text
