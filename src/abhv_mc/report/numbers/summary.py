"""Summary sentences of a campaign, and the statement on statistical confidence."""

from collections.abc import Mapping, Sequence

from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.folder.pooled_campaigns import suggest_merge
from abhv_mc.io.phrases import counted, joined
from abhv_mc.report.numbers.report_numbers import warnings_of
from abhv_mc.topics.convergence import CONVERGENCE
from abhv_mc.topics.flights import FLIGHTS, flight_sentences
from abhv_mc.topics.formatting import fixed, percent
from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.vehicle.shared_keys import IN_WIND


def summary_sentences(models: Models) -> list[str]:
    """Return the summary of a campaign: the sentences of all topics."""
    return [sentence for topic in all_topics(models.users) for sentence in models.sentences(topic)]


def section_leads(models: Models, warnings: Sequence[str] = ()) -> Mapping[str, Sequence[str]]:
    """Return introductory sentences for topics whose sentences depend on other topics.

    ``warnings`` are added to the warnings of the run and of the topics.
    """
    siblings, command = suggest_merge(models.results.folder, models.results.manifest)
    joint = models[VERDICTS].held_together
    # The sentences on verdicts name the verdicts that do not hold jointly.
    jointly = models.sentences(VERDICTS) if joint is not None and joint.dropped else ()
    windy = [
        f"{warning[:1].upper()}{warning[1:]}."
        for warning in warnings_of(models)
        if warning.startswith(IN_WIND)
    ]
    pooled = [f"{siblings} Merge and judge them with `{command}`"] if siblings else []
    flights = flight_sentences(models[FLIGHTS], models.names, off_cards=True)
    return {
        VERDICTS.name: [*jointly, *windy, *flights, *pooled],
        CONVERGENCE.name: [confidence_sentence(models, warnings)],
    }


def _judged_words(unknowns: Unknowns) -> str:
    shared = unknowns.shared
    if shared is None or shared == len(unknowns.points):
        return "Each verdict covers all of these values"
    return (
        f"Each verdict covers the first {counted(shared, 'value')} and those at which the search "
        "found the most failures of its requirement"
    )


def confidence_sentence(models: Models, warnings: Sequence[str] = ()) -> str:
    """Return sentences on the basis of intervals and verdicts, with ``warnings`` as notes."""
    campaign, names, requirements = (
        models.results.campaign,
        models.names,
        models[VERDICTS].requirements,
    )
    numbers = sorted({counts.flown for counts in models[FLIGHTS].counts.values()})
    flights = joined([fixed(number, 0) for number in numbers], "or")
    noun = "flight" if numbers == [1] else "flights"
    text = (
        f"The results are based on {flights} {noun} of each {names.campaign.kind}, with the same "
        "dispersions for all"
    )
    text += "; intervals have 95 % confidence." if campaign.independent else "."
    if campaign.unknowns.names:
        text += (
            f" These are {counted(campaign.runs_at_point, 'flight')} at each of "
            f"{counted(len(campaign.unknowns.points), 'value')} of the unknowns. "
            f"{_judged_words(campaign.unknowns)}; values in between were searched, but nothing is "
            "proven for them. Quantiles, envelopes and differences combine all values; a "
            f"{names.campaign.kind} is named better only if it is better at every value."
        )
    elif not campaign.independent:
        text += (
            f" {campaign.dependence[:1].upper()}{campaign.dependence[1:]}: exact binomial "
            "statistics do not apply, so quantiles, differences and their intervals are estimates "
            "and no verdict is given."
        )
    elif models[VERDICTS].held_together:
        largest = max(entry.asked.consumer_risk for entry in requirements)
        text += (
            " A system that just misses a requirement gets a PASS with a probability of at most "
            f"{percent(largest, 2)}, even if results are checked repeatedly or the campaign is "
            "extended; the intervals hold for a single check."
        )
        if campaign.model.stop:
            text += (
                " The campaign stops when every verdict is PASS or FAIL, after at most "
                f"{counted(campaign.runs, 'flight')}."
            )
    for warning in (*warnings_of(models), *warnings):
        text += f" Note: {warning}."
    if models.results.manifest.complete is False:
        text += " The campaign is not complete; all numbers are preliminary."
    return text
