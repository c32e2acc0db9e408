"""Assessment of a campaign: requirements, controller comparison, reasons, confidence, next step."""

import math
from collections.abc import Iterator, Sequence

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import GAIN_MARGIN
from abhv_mc.report.numbers.judgement_record import Judgement, Met, NextStep
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import MOST_TIMES, Verdict, about, advise
from abhv_mc.statistics.winner import RISK as WINNERS_RISK
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.model import ControllerPair
from abhv_mc.topics.comparison.sentences import by_strength, closer_in, standing, verdict_of
from abhv_mc.topics.drivers import DRIVERS
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import ended_words
from abhv_mc.topics.formatting import (
    count_of,
    fixed,
    joined,
    percent,
    shown_value,
    significant,
    spoken_name,
)
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.model import least_margins
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import ControllerVerdict, Verdicts

MIXED, NO_DIFFERENCE, ALONE = "mixed", "no difference shown", "none to compare"
_REASONS = 3
_MOST_WORDS = 80  # on the first screen; further reasons are in the sections
_SAME_USAGE = 0.05  # largest deviation from 1 of a ratio of control effort that is not mentioned


def judge_campaign(models: Models) -> Judgement:
    """Assess a campaign by the models of its topics."""
    verdicts = models[VERDICTS]
    bound = _binding_statuses(verdicts)
    statuses, better = set().union(*bound.values()), _better_controller(models)
    met: Met = "nothing required"
    if statuses:
        met = "no" if "FAIL" in statuses else "yes" if statuses == {"PASS"} else "not shown"
    sentences = [_runs_words(models), _asked_words(models), _met_words(models)]
    answer = " ".join(filter(None, (*sentences, _better_words(models, better))))
    because, following = list(_reasons(models))[:_REASONS], _next_step(models, met)
    sure = " ".join(filter(None, (_changed_words(models), _confidence_words(models))))
    while because and _count_words(answer, *because, sure, following) > _MOST_WORDS:
        because.pop()
    return Judgement(met, better, tuple(because), sure, following, answer)


def _changed_words(models: Models) -> str:
    """Return the sentence on the last change of requirements after results had been seen."""
    for change in models.results.requirement_changes[-1:]:
        changes = shorten_list(list(change.changes))
        return f"Requirements were changed after results of {change.flights} flights: {changes}."
    return ""


def _count_words(*texts: str | NextStep | None) -> int:
    """Return the number of words on the first screen."""
    lines = (
        f"Next: {text.why}: {text.command}" if isinstance(text, NextStep) else text
        for text in texts
    )
    return sum(len(line.split()) for line in lines if line)


def _runs_words(models: Models) -> str:
    """Return '64 of 2100 flights run.' if the campaign file asks for more flights, else ''."""
    missing = _missing_runs(models)
    runs = models.results.campaign.runs_at_point
    return f"{count_of(runs, missing, 'flights')} run." if missing else ""


def _missing_runs(models: Models) -> int:
    """Return the flights of the campaign file if they exceed those of the folder, else 0."""
    runs = models.results.manifest.file_runs or 0
    return runs if runs > models.results.campaign.runs_at_point else 0


def _asked_words(models: Models) -> str:
    """Return the answer to a question about drivers, margins or the worst flight, else ''."""
    asks = models.results.campaign.model.asks
    if asks == "drivers":
        return next(iter(models.sentences(DRIVERS)), "")
    if asks == "margins":
        return " ".join(models.sentences(MARGINS))
    return _worst_words(models) if asks == "worst" else ""


def _worst_words(models: Models) -> str:
    """Return the sentence on the worst flight of the first controller and its dispersions."""
    names = models.names
    name = next(iter(names.controllers))
    worst = models[FLIGHTS].worst[name][0]
    if worst.by is None:
        text = (
            "terminated early "
            f"({ended_words(worst.outcome, worst.missed, len(names.requirements))})"
        )
    else:
        record = names.metrics[worst.by]
        value = record.with_unit(significant(worst.metrics[worst.by]))
        text = f"has {record.phrase} {value}"
        if names.requirements:
            side = "beyond" if worst.beyond >= 0.0 else "inside"
            text += f", {percent(abs(worst.beyond), 2)} {side} the limit"
    parameters = names.campaign.parameters
    dispersions = ", ".join(
        f"{spoken_name(item.parameter)} {shown_value(item.parameter, item.value, parameters)}"
        for item in worst.largest
    )
    return f"The worst flight of {names.label(name)}, {worst.flight}, {text} ({dispersions})."


def _met_words(models: Models) -> str:
    """Return the sentence on controllers that meet all requirements and those that do not."""
    verdicts, names = models[VERDICTS], models.names
    number = len(verdicts.requirements)
    if not number:
        return "Nothing is required."
    bound = _binding_statuses(verdicts)
    own = {name: _binding_verdicts(verdicts, name) for name in (*bound, *names.controllers)}
    meeting = [
        name
        for name, entries in own.items()
        if all(verdict and verdict.status == "PASS" for _, verdict in entries)
    ]
    concerned = dict.fromkeys((*bound, *names.campaign.compared))
    falling = [name for name in concerned if name not in meeting]
    requirements = f"all {number} requirements" if number > 1 else "the requirement"
    if any(len(own[name]) < number for name in meeting):
        requirements = (
            "all of their requirements" if len(meeting) > 1 else "all of its requirements"
        )
    meet = (
        f"{_name_controllers(meeting, names)} meet{'s' * (len(meeting) == 1)} {requirements}"
        if meeting
        else ""
    )
    short = [f"{names.label(name)} {_short_words(own[name], names)}" for name in falling]
    if len(short) > _REASONS:
        short = [
            f"{_name_controllers(falling, names)} miss requirements or are not shown to meet them"
        ]
    parts = [*short, meet] if bound.keys() & falling else [meet, *short]
    return f"{'; '.join(filter(None, parts))}."


def _name_controllers(controllers: list[str], names: Names) -> str:
    if len(controllers) > _REASONS:
        return f"{len(controllers)} {names.campaign.kind}s"
    return joined(list(map(names.label, controllers)))


def _binding_verdicts(
    verdicts: Verdicts, name: str
) -> list[tuple[Requirement, ControllerVerdict | None]]:
    """Return the requirements that bind a controller, or all if none does, with its verdicts.

    The verdict is None if no flight of the controller could be computed.
    """
    binding = [item for item in verdicts.requirements if name in item.asked.controllers]
    return [(item.asked, item.controllers.get(name)) for item in binding or verdicts.requirements]


def _short_words(own: list[tuple[Requirement, ControllerVerdict | None]], names: Names) -> str:
    """Return 'misses the speed error requirement (101 of 1000 flights)' or 'misses 2 of 5 ...'."""
    missed = [entry for entry in own if entry[1] and entry[1].status == "FAIL"]
    unshown = [entry for entry in own if not entry[1] or entry[1].status not in ("PASS", "FAIL")]
    verb, listed = ("misses", missed) if missed else ("is not shown to meet", unshown)
    if len(listed) > 1:
        all_of_them = "all" if missed else "any of"
        number = f"{len(listed)} of" if len(listed) < len(own) else all_of_them
        return f"{verb} {number} {len(own)} requirements"
    ((item, verdict),) = listed
    counts = f" ({count_of(verdict.failures, verdict.flights, 'flights')})" if verdict else ""
    return f"{verb} the {names.metrics[item.metric].phrase} requirement{counts if missed else ''}"


def _better_words(models: Models, better: str) -> str:
    """Return the sentence on the better controller, if the statistics name one."""
    names = models.names
    if better == ALONE:
        return ""
    if better == NO_DIFFERENCE:
        return f"No {names.campaign.kind} is shown to be better."
    if better == MIXED:
        two = len(_compared_pairs(models)) == 1
        return f"{'Neither' if two else 'None'} is better on every metric."
    return f"{names.label(better)} is better."


def _compared_pairs(models: Models) -> list[ControllerPair]:
    """Return the pairs of controllers in the question, by default those with the first."""
    pairs, compared = models[COMPARISON].pairs.values(), models.results.campaign.compared
    return [pair for pair in pairs if not compared or {pair.a, pair.b} <= set(compared)]


def _binding_statuses(verdicts: Verdicts) -> dict[str, set[str]]:
    """Return the statuses of the requirements that bind each controller.

    The status is NOT SHOWN if none of its flights could be computed.
    """
    statuses: dict[str, set[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            verdict = item.controllers.get(name)
            statuses.setdefault(name, set()).add(verdict.status if verdict else "NOT SHOWN")
    return statuses


def _better_controller(models: Models) -> str:
    pairs, names = _compared_pairs(models), models.names
    if not pairs:
        return ALONE
    if not names.campaign.judged:
        return NO_DIFFERENCE
    outcomes = [verdict_of(pair, names) for pair in pairs]
    if set(outcomes) == {"better"}:
        return pairs[0].a
    if outcomes.count("worse") == 1 and set(outcomes) <= {"worse", "better"}:
        return pairs[outcomes.index("worse")].b
    return NO_DIFFERENCE if set(outcomes) <= {"open", "better"} else MIXED


def _reasons(models: Models) -> Iterator[str]:
    names, verdicts, flights = models.names, models[VERDICTS], models[FLIGHTS].counts
    lost = [
        f"{names.label(name)} {count_of(count.failed, count.flown)}"
        for name, count in flights.items()
        if count.failed
    ]
    if lost:
        yield f"Lost flights: {shorten_list(lost)}."
    margins = {name: least_margins(models[MARGINS], name) for name in names.controllers}
    loops = [
        f"{names.label(name)} {least.words[0] if least.stable else 'unstable'}"
        for name, least in margins.items()
        if least and (not least.stable or least.gain < GAIN_MARGIN.customary)
    ]
    if loops:
        yield f"Gain margin below {GAIN_MARGIN.customary:g} dB: {shorten_list(loops)}."
    missed: dict[str, list[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            if name in item.controllers and item.controllers[name].status == "FAIL":
                missed.setdefault(names.label(name), []).append(
                    names.metrics[item.asked.metric].phrase
                )
    several = [
        f"{label} in {shorten_list(phrases)}"
        for label, phrases in missed.items()
        if len(phrases) > 1
    ]
    if several:  # a single missed requirement is named in the answer
        yield f"Missed: {'; '.join(several)}."
    if names.campaign.judged:
        pairs = [
            pair
            for pair in by_strength(models[COMPARISON], names)
            if pair in _compared_pairs(models)
        ]
        angles = [*filter(None, (_angle_words(pair, names) for pair in pairs))]
        yield from angles or filter(None, (_error_words(pair, names) for pair in pairs[:1]))


def shorten_list(items: list[str]) -> str:
    """Return 'a, b and c', or 'a, b and 2 more' of longer lists."""
    return (
        joined(items)
        if len(items) <= _REASONS
        else f"{', '.join(items[:2])} and {len(items) - 2} more"
    )


def _error_words(pair: ControllerPair, names: Names) -> str:
    """Return the sentence on the smaller errors of each side, '' without a shown difference.

    For example 'TLC has the smaller sideslip, LQR robust the smaller altitude error, at 0.34 times
    the control effort.'
    """
    metrics_by_side = {
        side: joined(metrics) if len(metrics) <= _REASONS else f"{len(metrics)} metrics"
        for side, metrics in standing(pair, names).items()
    }
    parts = (
        [f"{names.label(pair.a)} has the smaller {metrics_by_side['better']}"]
        if metrics_by_side["better"]
        else []
    )
    if metrics_by_side["worse"]:
        parts.append(
            f"{names.label(pair.b)} {'' if parts else 'has '}the smaller "
            f"{metrics_by_side['worse']}{_usage_words(pair)}"
        )
    return f"{', '.join(parts)}." if parts else ""


def _angle_words(pair: ControllerPair, names: Names) -> str:
    """Return the sentence on rms errors of angles, '' without rms errors outside the transients.

    For example 'TLC has a smaller rms error than LQR in sideslip, in bank only outside the
    transients.'
    """
    angles = closer_in(pair, names)
    sides = {
        (True, True): "",
        (False, True): " only outside the transients",
        (True, False): " but not outside the transients",
    }
    parts = [
        f"in {joined(angles[side])}{suffix}" for side, suffix in sides.items() if side in angles
    ]
    phrase = ", ".join(parts) if parts else "in no angle"
    return (
        f"{names.label(pair.a)} has a smaller rms error than {names.label(pair.b)} {phrase}."
        if angles
        else ""
    )


def _usage_words(pair: ControllerPair) -> str:
    ratios = [entry.usage_ratio.value for entry in pair.usage.values() if entry]
    if (
        not ratios
        or not ratios[0]
        or not math.isfinite(ratios[0])
        or abs(ratios[0] - 1.0) < _SAME_USAGE
    ):
        return ""
    return f" at {significant(1.0 / ratios[0], 2)} times the control effort"


def _confidence_words(models: Models) -> str:
    """Return the sentence on the risk of each verdict and of all jointly."""
    verdicts, state = models[VERDICTS], models.results.manifest.state
    if state != "complete":
        return f"This campaign is {state}: all numbers are preliminary."
    joint = verdicts.held_together
    if not verdicts.requirements:
        return ""
    if joint is None:
        why = models.results.campaign.dependence
        return f"Estimates, no verdicts: {why}."
    risk = max(entry.asked.consumer_risk for entry in verdicts.requirements)
    passed = joint.stand + len(joint.dropped)
    text = f"{'Each' if passed else 'A'} PASS has at most {percent(risk, 2)} consumer's risk"
    if passed > 1:
        jointly = f"all {passed}" if joint.stand == passed else f"{joint.stand} of {passed}"
        if joint.stand:
            text += f"; {jointly} also hold{'s' * (joint.stand == 1)} jointly"
        else:
            text += f"; jointly, none of the {passed} holds"
    if models.names.campaign.judged and _compared_pairs(models):
        text += f". The risk of naming a wrong winner is at most {percent(WINNERS_RISK, 2)}"
    return f"{text}."


def flights_for_joint_verdicts(verdicts: Verdicts) -> int | None:
    """Return the flights at which every PASS holds jointly if no more fail; None if all hold.

    The joint verdicts follow Holm's procedure.
    """
    joint = verdicts.held_together
    if joint is None or not joint.dropped:
        return None
    all_verdicts = [
        verdict for item in verdicts.requirements for verdict in item.controllers.values()
    ]
    passed = sorted(
        (verdict for verdict in all_verdicts if verdict.status == "PASS"),
        key=lambda verdict: verdict.p_value,
    )
    shares = [joint.risk / (joint.verdicts - rank) for rank in range(len(passed))]
    return max(
        flights_to_pass(verdict.failures, verdict.probability, min(verdict.consumer_risk, share))
        for verdict, share in zip(passed, shares, strict=True)
    )


def _next_step(models: Models, met: Met) -> NextStep | None:
    """Return the next step: an explanation of failures, or more flights, or none."""
    if models.results.manifest.state != "complete":
        return None
    if missing := _missing_runs(models):
        return NextStep(
            "resume the campaign", f"abhv-mc run DIR/campaign.yaml -o DIR --runs {missing}"
        )
    if not models.names.campaign.independent:
        return None
    verdicts, flies = models[VERDICTS], models.names.campaign.can_rerun
    why_failed = NextStep("see why flights fail", "abhv-mc explain DIR --all")
    if not flies:
        why_failed = NextStep("see 'Failure analysis' in the report")
    if met == "no":
        return why_failed
    if met == "not shown":
        binding = [
            verdict
            for item in verdicts.requirements
            for name in item.asked.controllers
            if (verdict := item.controllers.get(name))
        ]
        return _advise_flights(binding, flies)
    jointly = flights_for_joint_verdicts(verdicts)
    if jointly:
        return _longer_run(
            jointly, f"all hold jointly with {fixed(jointly, 0)} flights if no more fail", flies
        )
    return NextStep("no further flights are needed") if met == "yes" else None


def _advise_flights(binding: Sequence[Verdict], flies: bool) -> NextStep | None:
    """Return the number of flights at which all binding verdicts are likely to be PASS."""
    open_ones = [verdict for verdict in binding if verdict.status == "NOT SHOWN"]
    if not open_ones:
        return None
    if advice := advise(binding):
        condition = ", more if their true failure rates are alike" if len(binding) > 1 else ""
        all_of_them = f"all {len(binding)} verdicts" if len(binding) > 1 else "the verdict"
        chance = f"{all_of_them} PASS with a chance of {about(advice.chance)}{condition}"
        return _longer_run(
            advice.flights, f"with {fixed(advice.flights, 0)} flights {chance}", flies
        )
    separate = [single for verdict in open_ones if (single := advise([verdict]))]
    most = fixed(MOST_TIMES * max(verdict.flights for verdict in open_ones), 0)
    goal = "a PASS of all verdicts" if len(binding) > 1 else "a PASS"
    text = f"no number of flights up to {most} makes {goal} likely"
    if separate:
        need = fixed(max(single.flights for single in separate), 0)
        text += f"; {need} flights would do for {len(separate)} of the {len(open_ones)} verdicts"
    return NextStep(text)


def _longer_run(flights: int, why: str, flies: bool) -> NextStep:
    if not flies:
        return NextStep(f"adopt a larger table: {why}")
    return NextStep(why, f"abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}")
