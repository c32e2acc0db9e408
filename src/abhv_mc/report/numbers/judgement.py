"""The judgement on a campaign: are its requirements met, which controller is better, why, how sure, and what next."""

import math
from collections.abc import Iterator, Sequence

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import GAIN_MARGIN
from abhv_mc.report.numbers.judged import Judgement, Met, Next
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import MOST_TIMES, Verdict, about, advise
from abhv_mc.statistics.winner import RISK as WINNERS_RISK
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.model import ControllerPair
from abhv_mc.topics.comparison.sentences import by_strength, closer_in, standing, verdict_of
from abhv_mc.topics.drivers import DRIVERS
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import ended_words
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.model import least_margins
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import ControllerVerdict, Verdicts
from abhv_mc.topics.words import (
    count_of,
    fixed,
    joined,
    percent,
    shown_value,
    significant,
    spoken_name,
)

MIXED, NO_DIFFERENCE, ALONE = "mixed", "no difference shown", "none to compare"
_REASONS = 3
_MOST_WORDS = 80  # on the first screen; reasons beyond are left to the sections
_SAME_USAGE = 0.05  # of a ratio of surface usage: nearer to 1 goes without saying


def judge_campaign(models: Models) -> Judgement:
    """Judge a campaign by the models of its topics."""
    verdicts = models[VERDICTS]
    bound = _bound(verdicts)
    statuses, better = set().union(*bound.values()), _better(models)
    met: Met = "nothing required"
    if statuses:
        met = "no" if "FAIL" in statuses else "yes" if statuses == {"PASS"} else "not shown"
    sentences = [_runs_words(models), _asked_words(models), _met_words(models)]
    answer = " ".join(filter(None, (*sentences, _better_words(models, better))))
    because, following = list(_reasons(models))[:_REASONS], _next(models, met)
    sure = " ".join(filter(None, (_changed_words(models), _sure(models))))
    while because and _count_words(answer, *because, sure, following) > _MOST_WORDS:
        because.pop()
    return Judgement(met, better, tuple(because), sure, following, answer)


def _changed_words(models: Models) -> str:
    """Return which requirements were last changed after results had been seen."""
    for change in models.results.requirement_changes[-1:]:
        words = few(list(change.changes))
        return f"Requirements were changed after results of {change.flights} flights: {words}."
    return ""


def _count_words(*texts: str | Next | None) -> int:
    """Return the number of words on the first screen."""
    lines = (
        f"Next: {text.why}: {text.command}" if isinstance(text, Next) else text for text in texts
    )
    return sum(len(line.split()) for line in lines if line)


def _runs_words(models: Models) -> str:
    """Return '64 of 2100 flights run.' of a run of fewer flights than its campaign file asks for."""
    missing = _missing_runs(models)
    runs = models.results.campaign.runs_at_point
    return f"{count_of(runs, missing, 'flights')} run." if missing else ""


def _missing_runs(models: Models) -> int:
    """Return the flights that the campaign file asks for, if they are more than those of the folder; 0 if not."""
    wanted = models.results.manifest.file_runs or 0
    return wanted if wanted > models.results.campaign.runs_at_point else 0


def _asked_words(models: Models) -> str:
    """Return the answer to a question about drivers, margins or the worst flight; '' of any other question."""
    asks = models.results.campaign.model.asks
    if asks == "drivers":
        return next(iter(models.sentences(DRIVERS)), "")
    if asks == "margins":
        return " ".join(models.sentences(MARGINS))
    return _worst_words(models) if asks == "worst" else ""


def _worst_words(models: Models) -> str:
    """Return what the worst flight of the campaign's first controller is, and what it drew."""
    names = models.names
    name = next(iter(names.controllers))
    worst = models[FLIGHTS].worst[name][0]
    if worst.by is None:
        what = f"ended early ({ended_words(worst.outcome, worst.missed, len(names.requirements))})"
    else:
        record = names.metrics[worst.by]
        value = record.with_unit(significant(worst.metrics[worst.by]))
        what = f"has {record.phrase} {value}"
        if names.requirements:
            side = "beyond" if worst.beyond >= 0.0 else "inside"
            what += f", {percent(abs(worst.beyond), 2)} {side} the limit"
    drawn = ", ".join(
        f"{spoken_name(each.parameter)} {shown_value(each.parameter, each.value, names.campaign.parameters)}"
        for each in worst.largest
    )
    return f"The worst flight of {names.label(name)}, {worst.flight}, {what} ({drawn})."


def _met_words(models: Models) -> str:
    """Return who meets all requirements, and who of those asked about does not, in what."""
    verdicts, names = models[VERDICTS], models.names
    number = len(verdicts.requirements)
    if not number:
        return "Nothing is required."
    bound = _bound(verdicts)
    own = {name: _own(verdicts, name) for name in (*bound, *names.controllers)}
    meeting = [
        name
        for name, found in own.items()
        if all(verdict and verdict.status == "PASS" for _, verdict in found)
    ]
    asked = dict.fromkeys((*bound, *names.campaign.compared))
    falling = [name for name in asked if name not in meeting]
    what = f"all {number} requirements" if number > 1 else "the requirement"
    if any(len(own[name]) < number for name in meeting):
        what = "all of their requirements" if len(meeting) > 1 else "all of its requirements"
    meet = f"{_who(meeting, names)} meet{'s' * (len(meeting) == 1)} {what}" if meeting else ""
    short = [f"{names.label(name)} {_short_words(own[name], names)}" for name in falling]
    if len(short) > _REASONS:
        short = [f"{_who(falling, names)} miss requirements or are not shown to meet them"]
    parts = [*short, meet] if bound.keys() & falling else [meet, *short]
    return f"{'; '.join(filter(None, parts))}."


def _who(controllers: list[str], names: Names) -> str:
    if len(controllers) > _REASONS:
        return f"{len(controllers)} {names.campaign.kind}s"
    return joined(list(map(names.label, controllers)))


def _own(verdicts: Verdicts, name: str) -> list[tuple[Requirement, ControllerVerdict | None]]:
    """Return the requirements that bind a controller, or all if none does, with its verdicts.

    A controller of which no flight could be computed has none.
    """
    binding = [item for item in verdicts.requirements if name in item.asked.controllers]
    return [(item.asked, item.controllers.get(name)) for item in binding or verdicts.requirements]


def _short_words(own: list[tuple[Requirement, ControllerVerdict | None]], names: Names) -> str:
    """Return 'misses the speed error requirement (101 of 1000 flights)', 'misses 2 of 5 requirements'."""
    missed = [each for each in own if each[1] and each[1].status == "FAIL"]
    unshown = [each for each in own if not each[1] or each[1].status not in ("PASS", "FAIL")]
    verb, listed = ("misses", missed) if missed else ("is not shown to meet", unshown)
    if len(listed) > 1:
        all_of_them = "all" if missed else "any of"
        number = f"{len(listed)} of" if len(listed) < len(own) else all_of_them
        return f"{verb} {number} {len(own)} requirements"
    ((item, verdict),) = listed
    counts = f" ({count_of(verdict.failures, verdict.flights, 'flights')})" if verdict else ""
    return f"{verb} the {names.metrics[item.metric].phrase} requirement{counts if missed else ''}"


def _better_words(models: Models, better: str) -> str:
    """Return who is better, if the statistics name a winner."""
    names = models.names
    if better == ALONE:
        return ""
    if better == NO_DIFFERENCE:
        return f"No {names.campaign.kind} is shown to be better."
    if better == MIXED:
        two = len(_pairs(models)) == 1
        return f"{'Neither' if two else 'None'} is better on every metric."
    return f"{names.label(better)} is better."


def _pairs(models: Models) -> list[ControllerPair]:
    """Return the pairs of controllers that the question compares: by default all with the first."""
    pairs, compared = models[COMPARISON].pairs.values(), models.results.campaign.compared
    return [pair for pair in pairs if not compared or {pair.a, pair.b} <= set(compared)]


def _bound(verdicts: Verdicts) -> dict[str, set[str]]:
    """The statuses of what binds each controller; NOT SHOWN where none of its flights could be computed."""
    found: dict[str, set[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            held = item.controllers.get(name)
            found.setdefault(name, set()).add(held.status if held else "NOT SHOWN")
    return found


def _better(models: Models) -> str:
    pairs, names = _pairs(models), models.names
    if not pairs:
        return ALONE
    if not names.campaign.judged:
        return NO_DIFFERENCE
    found = [verdict_of(pair, names) for pair in pairs]
    if set(found) == {"better"}:
        return pairs[0].a
    if found.count("worse") == 1 and set(found) <= {"worse", "better"}:
        return pairs[found.index("worse")].b
    return NO_DIFFERENCE if set(found) <= {"open", "better"} else MIXED


def _reasons(models: Models) -> Iterator[str]:
    names, verdicts, flights = models.names, models[VERDICTS], models[FLIGHTS].counts
    lost = [
        f"{names.label(name)} {count_of(each.failed, each.flown)}"
        for name, each in flights.items()
        if each.failed
    ]
    if lost:
        yield f"Lost flights: {few(lost)}."
    margins = {name: least_margins(models[MARGINS], name) for name in names.controllers}
    loops = [
        f"{names.label(name)} {found.words[0] if found.stable else 'unstable'}"
        for name, found in margins.items()
        if found and (not found.stable or found.gain < GAIN_MARGIN.customary)
    ]
    if loops:
        yield f"Gain margin below {GAIN_MARGIN.customary:g} dB: {few(loops)}."
    missed: dict[str, list[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            if name in item.controllers and item.controllers[name].status == "FAIL":
                missed.setdefault(names.label(name), []).append(
                    names.metrics[item.asked.metric].phrase
                )
    several = [f"{who} in {few(what)}" for who, what in missed.items() if len(what) > 1]
    if several:  # a single one is named in the answer
        yield f"Missed: {'; '.join(several)}."
    if names.campaign.judged:
        pairs = [pair for pair in by_strength(models[COMPARISON], names) if pair in _pairs(models)]
        angles = [*filter(None, (_angles(pair, names) for pair in pairs))]
        yield from angles or filter(None, (_closer(pair, names) for pair in pairs[:1]))


def few(words: list[str]) -> str:
    """'a, b and c', or 'a, b and 2 more'."""
    return (
        joined(words)
        if len(words) <= _REASONS
        else f"{', '.join(words[:2])} and {len(words) - 2} more"
    )


def _closer(pair: ControllerPair, names: Names) -> str:
    """'TLC has the smaller sideslip, LQR robust the smaller altitude error, at 0.34 times the control effort.'; '' if
    nothing tells."""
    held = {
        side: joined(metrics) if len(metrics) <= _REASONS else f"{len(metrics)} metrics"
        for side, metrics in standing(pair, names).items()
    }
    parts = [f"{names.label(pair.a)} has the smaller {held['better']}"] if held["better"] else []
    if held["worse"]:
        parts.append(
            f"{names.label(pair.b)} {'' if parts else 'has '}the smaller {held['worse']}{_usage(pair)}"
        )
    return f"{', '.join(parts)}." if parts else ""


def _angles(pair: ControllerPair, names: Names) -> str:
    """'TLC has the smaller rms error than LQR in sideslip, in bank only outside the transients.'; '' if the campaign
    counts no rms error outside the transients."""
    found = closer_in(pair, names)
    sides = {
        (True, True): "",
        (False, True): " only outside the transients",
        (True, False): " but not outside the transients",
    }
    parts = [f"in {joined(found[side])}{words}" for side, words in sides.items() if side in found]
    words = ", ".join(parts) if parts else "in no angle"
    return (
        f"{names.label(pair.a)} has a smaller rms error than {names.label(pair.b)} {words}."
        if found
        else ""
    )


def _usage(pair: ControllerPair) -> str:
    ratios = [entry.usage_ratio.value for entry in pair.usage.values() if entry]
    if (
        not ratios
        or not ratios[0]
        or not math.isfinite(ratios[0])
        or abs(ratios[0] - 1.0) < _SAME_USAGE
    ):
        return ""
    return f" at {significant(1.0 / ratios[0], 2)} times the control effort"


def _sure(models: Models) -> str:
    """How sure the verdicts are, each and jointly."""
    verdicts, state = models[VERDICTS], models.results.manifest.state
    if state != "complete":
        return f"This campaign is {state}: all numbers are preliminary."
    held = verdicts.held_together
    if not verdicts.requirements:
        return ""
    if held is None:
        why = models.results.campaign.dependence
        return f"Estimates, no verdicts: {why}."
    risk = max(entry.asked.consumer_risk for entry in verdicts.requirements)
    passed = held.stand + len(held.dropped)
    text = f"{'Each' if passed else 'A'} PASS has at most {percent(risk, 2)} consumer's risk"
    if passed > 1:
        jointly = f"all {passed}" if held.stand == passed else f"{held.stand} of {passed}"
        if held.stand:
            text += f"; {jointly} also hold{'s' * (held.stand == 1)} jointly"
        else:
            text += f"; jointly, none of the {passed} holds"
    if models.names.campaign.judged and _pairs(models):
        text += f". The risk of naming a wrong winner is at most {percent(WINNERS_RISK, 2)}"
    return f"{text}."


def flights_jointly(verdicts: Verdicts) -> int | None:
    """With how many flights, none more failing, every PASS would stand in Holm's procedure; None where all do."""
    held = verdicts.held_together
    if held is None or not held.dropped:
        return None
    found = [verdict for item in verdicts.requirements for verdict in item.controllers.values()]
    passed = sorted(
        (each for each in found if each.status == "PASS"), key=lambda each: each.p_value
    )
    shares = [held.risk / (held.verdicts - rank) for rank in range(len(passed))]
    return max(
        flights_to_pass(each.failures, each.probability, min(each.consumer_risk, share))
        for each, share in zip(passed, shares, strict=True)
    )


def _next(models: Models, met: Met) -> Next | None:
    """What helps: why flights fail; more flights, where they promise a PASS; what is missing for all jointly."""
    if models.results.manifest.state != "complete":
        return None
    if missing := _missing_runs(models):
        return Next("resume the campaign", f"abhv-mc run DIR/campaign.yaml -o DIR --runs {missing}")
    if not models.names.campaign.independent:
        return None
    verdicts, flies = models[VERDICTS], models.names.campaign.can_rerun
    why_failed = Next("why flights fail", "abhv-mc explain DIR --all")
    if not flies:
        why_failed = Next("see 'Why flights fail' in the report")
    if met == "no":
        return why_failed
    if met == "not shown":
        binding = [
            verdict
            for item in verdicts.requirements
            for name in item.asked.controllers
            if (verdict := item.controllers.get(name))
        ]
        return _extend(binding, flies)
    jointly = flights_jointly(verdicts)
    if jointly:
        return _more(jointly, f"all stand with {fixed(jointly, 0)} flights if no more fail", flies)
    return Next("no further flights are needed") if met == "yes" else None


def _extend(binding: Sequence[Verdict], flies: bool) -> Next | None:
    """Return with how many flights all binding verdicts are likely to be PASS, and how likely that is."""
    open_ones = [verdict for verdict in binding if verdict.status == "NOT SHOWN"]
    if not open_ones:
        return None
    if found := advise(binding):
        alike = ", more if their true failure rates are alike" if len(binding) > 1 else ""
        all_of_them = f"all {len(binding)} verdicts" if len(binding) > 1 else "the verdict"
        chance = f"{all_of_them} PASS with a chance of {about(found.chance)}{alike}"
        return _more(found.flights, f"with {fixed(found.flights, 0)} flights {chance}", flies)
    own = [each for verdict in open_ones if (each := advise([verdict]))]
    most = fixed(MOST_TIMES * max(verdict.flights for verdict in open_ones), 0)
    text = f"no number of flights up to {most} is likely to do"
    if len(binding) > 1:
        text += " for all verdicts"
    if own:
        need = fixed(max(each.flights for each in own), 0)
        text += f"; each by itself: {len(own)} of {len(open_ones)} not shown with {need}"
    return Next(text)


def _more(flights: int, why: str, flies: bool) -> Next:
    if not flies:
        return Next(f"adopt a larger table: {why}")
    return Next(why, f"abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}")
