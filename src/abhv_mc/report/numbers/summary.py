"""What joins the topics of a campaign, in sentences: the answer, what endangers each controller, and how sure it is."""

from collections.abc import Iterator, Mapping, Sequence

from abhv_mc.folder.siblings import name_siblings
from abhv_mc.report.numbers.report_numbers import warnings_of
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.sentences import pair_sentences, survival_sentences
from abhv_mc.topics.convergence import CONVERGENCE
from abhv_mc.topics.drivers import DRIVERS
from abhv_mc.topics.failed_flights import EARLY
from abhv_mc.topics.failure_cases import FAILURE_CASES
from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.failures.model import Failures
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import Findings, FlightCounts
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.sentences import margin_words
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import count_of, fixed, joined, percent
from abhv_mc.vehicle.sensing import IN_WIND


def summary_sentences(models: Models) -> list[str]:
    """What a reader with two minutes should know, most important first: lost flights, the answer against the
    strongest rival, the requirements, what endangers each controller's flights, the other rivals, then why.
    """
    comparison = models[COMPARISON], models.names
    wins = pair_sentences(*comparison)
    known = [*models.sentences(VERDICTS), *finding_sentences(models)]
    lost = [*models.sentences(FAILURE_CASES), *survival_sentences(*comparison)]
    return [*lost, *wins[:1], *known, *wins[1:], *models.sentences(DRIVERS)]


def section_leads(models: Models, warnings: Sequence[str] = ()) -> Mapping[str, Sequence[str]]:
    """Sentences that stand first in a topic's section on the page, by its name: what takes other topics to say.

    ``warnings``: what else is missing.
    """
    siblings, command = name_siblings(models.results.folder, models.results.manifest)
    held = models[VERDICTS].held_together
    jointly = models.sentences(VERDICTS) if held is not None and held.dropped else ()  # tells which do not stand
    beside = [f"{siblings} All judged together: `{command}`"] if siblings else []
    return {
        VERDICTS.name: [*jointly, *finding_sentences(models, off_cards=True), *beside],
        CONVERGENCE.name: [confidence_sentence(models, warnings)],
    }


def finding_sentences(models: Models, off_cards: bool = False) -> Iterator[str]:
    """One of each controller: flights not computed, its loops, flights that cycle or end early, saturated surfaces,
    tables left; ``off_cards`` what of it the cards of the first screen do not show."""
    yield from (f"{words[:1].upper()}{words[1:]}." for words in warnings_of(models) if words.startswith(IN_WIND))
    flights, margins = models[FLIGHTS], models[MARGINS]
    for name, count in flights.left_out.items():
        yield f"{name}: the machine could compute none of {count} flights, so it is not in this report; it met nothing."
    for name, part in flights.findings.items():
        counts = flights.counts[name]
        known = [_in("the vehicle's tables are left in", part.outside_tables, part.flown)]
        if not off_cards:
            known = [
                _in("the machine could not compute", counts.not_computed, counts.flown + counts.not_computed),
                margin_words(margins, name), _cycles(part), _early(models[FAILURES], counts, name),
                _in("surfaces reach a limit of deflection or rate in", part.saturated, part.flown), *known,
            ]  # fmt: skip
        words = [text for text in known if text]
        if words:
            yield f"{models.names.label(name)}: {'; '.join(words)}."


def _in(words: str, count: int | None, flown: int) -> str:
    return f"{words} {count_of(count, flown, 'flights')}" if count else ""


def _cycles(part: Findings) -> str:
    found = [
        f"{channel.replace('_', ' ')} in {count_of(count, part.flown, 'flights')}"
        for channel, count in part.cycling.items()
        if count
    ]
    what = "swings, in gusts, turbulence or noise," if part.disturbed else "limit cycle"
    return f"{what} (> {part.ripple_deg:g} deg) in {joined(found)}" if found else ""


def _early(failures: Failures, counts: FlightCounts, name: str) -> str:
    """'3 of 40 flights ended early, 70 % of them where lift > +8 % (and 3 % of the others)'."""
    if not counts.failed:
        return ""
    text = f"{count_of(counts.failed, counts.flown, 'flights')} ended early"
    rules = next((kind.rules for kind in failures.controllers.get(name, ()) if kind.kind == EARLY), ())
    if not rules:
        return text
    first = rules[0]
    inside, others = first.failures_inside / first.failures, first.others_inside / first.others
    return f"{text}, {percent(inside, 2)} of them where {first.where} (and {percent(others, 2)} of the others)"


def confidence_sentence(models: Models, warnings: Sequence[str] = ()) -> str:
    """What the intervals and verdicts rest on; ``warnings``: what else is missing."""
    campaign, names, requirements = models.results.campaign, models.names, models[VERDICTS].requirements
    flights = joined([fixed(count, 0) for count in sorted({each.flown for each in models[FLIGHTS].counts.values()})])
    text = f"Based on {flights} flights of each {names.kind}, the same dispersions for all"
    text += "; intervals are 95 %." if names.independent else "."
    if campaign.unknowns.names:
        text += (
            f" They are {fixed(campaign.runs_at_point, 0)} flights at each of {len(campaign.unknowns.points)} values "
            "of the unknowns. A verdict is of every one of these; what lies between them was searched, not proven. "
            "Quantiles, envelopes and differences are of all of them together; a winner is named where it is one at "
            "every value."
        )
    elif not names.independent:
        text += (
            f" The flights of a {names.design} design are not independent draws: exact binomial statistics do "
            "not hold, so quantiles, differences and their intervals are estimates and no verdict is given."
        )
    elif requirements:
        largest = max(entry.asked.consumer_risk for entry in requirements)
        text += (
            f" A system that just misses a requirement would ever PASS with a probability of at most "
            f"{percent(largest, 2)}, however often one looks or extends the campaign; the intervals are for one look."
        )
        if campaign.stops_when_proven:
            text += f" The campaign stops when proven, after at most {fixed(campaign.runs, 0)} flights."
    for warning in (*warnings_of(models), *warnings):
        text += f" Note: {warning}."
    if models.results.manifest.complete is False:
        text += " The campaign is not complete; all numbers are preliminary."
    return text
