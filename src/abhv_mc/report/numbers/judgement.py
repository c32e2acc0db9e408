"""Assessment of a campaign: requirements, comparison, reasons, confidence, next step."""

import math
from collections.abc import Iterator, Sequence
from itertools import product

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import GAIN_MARGIN
from abhv_mc.io.phrases import counted, joined
from abhv_mc.report.numbers.judgement_record import Judgement, Met, NextStep
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import (
    MOST_TIMES,
    UNSEARCHED,
    Verdict,
    about,
    advise,
    predict_pass,
)
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
_REASONS = 4
_NAMED = 2  # maximum number of violated requirements or metrics named in a sentence
# largest number of flights for which a command is suggested, as a multiple of the present number
_MOST_LONGER = 100
_FAILS_STAY = "FAIL verdicts are already decided"
_MOST_WORDS = 80  # maximum number of words in the assessment
# smallest difference from 1 of the ratios of control effort that are mentioned
_SAME_USAGE = 0.05


def judge_campaign(models: Models) -> Judgement:
    """Assess a campaign from the models of its topics."""
    verdicts = models[VERDICTS]
    bound = _binding_statuses(verdicts)
    statuses, better = set().union(*bound.values()), _better_controller(models)
    met: Met = "nothing required"
    if statuses:
        met = "no" if "FAIL" in statuses else "yes" if statuses == {"PASS"} else "not shown"
    following = _next_step(models, met)
    sure = " ".join(filter(None, (_changed_words(models), _confidence_words(models, better))))
    answer = ""
    for detail, leads in product((3, 2, 1, 0), (True, False)):
        met_words = _met_words(models, detail, leads=leads)
        sentences = [_runs_words(models), _asked_words(models), met_words]
        answer = " ".join(filter(None, (*sentences, _better_words(models, better))))
        if _count_words(answer, sure, following) <= _MOST_WORDS:
            break
    because = list(_reasons(models, better))[:_REASONS]
    while because and _count_words(answer, *because, sure, following) > _MOST_WORDS:
        because.pop()
    return Judgement(met, better, tuple(because), sure, following, answer)


def _changed_words(models: Models) -> str:
    """Describe a change of the requirements that was made after results had been seen."""
    for change in models.results.requirement_changes[-1:]:
        changes = shorten_list(list(change.changes), "; ")
        return (
            "Requirements were changed after the results of "
            f"{counted(change.flights, 'flight')} were known: {changes}."
        )
    return ""


def _count_words(*texts: str | NextStep | None) -> int:
    """Return the total number of words in all texts."""
    lines = (
        f"Next: {text.why}: {text.command}" if isinstance(text, NextStep) else text
        for text in texts
    )
    return sum(len(line.split()) for line in lines if line)


def _runs_words(models: Models) -> str:
    """Return text such as '64 of 2100 flights have been run.' if flights are missing, else ''."""
    missing = _missing_runs(models)
    runs = models.results.campaign.runs_at_point
    verb = "has" if missing == 1 else "have"
    return f"{count_of(runs, missing, 'flight')} {verb} been run." if missing else ""


def _missing_runs(models: Models) -> int:
    """Return the campaign file's number of flights if fewer flights have been run, else 0."""
    runs = models.results.manifest.file_runs or 0
    return runs if runs > models.results.campaign.runs_at_point else 0


def _asked_words(models: Models) -> str:
    """Return the answer to a question on drivers, margins or the worst flight, else ''."""
    asks = models.results.campaign.model.asks
    if asks == "drivers":
        return next(iter(models.sentences(DRIVERS)), "")
    if asks == "margins":
        return " ".join(models.sentences(MARGINS))
    return _worst_words(models) if asks == "worst" else ""


def _worst_words(models: Models) -> str:
    """Describe the first controller's worst flight and the dispersions of that flight."""
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
            share = percent(abs(worst.beyond), 2)
            text += (
                f", which violates the limit by {share}"
                if worst.beyond >= 0.0
                else f", with a margin of {share} to the limit"
            )
    parameters = names.campaign.parameters
    dispersions = ", ".join(
        f"{spoken_name(item.parameter)} {shown_value(item.parameter, item.value, parameters)}"
        for item in worst.largest
    )
    subject = f"The worst flight of {names.subject(name)}, flight {worst.flight},"
    return f"{subject} {text} ({dispersions})."


def _met_words(models: Models, detail: int, *, leads: bool) -> str:
    """State which controllers meet all their requirements and which controllers do not.

    A larger `detail` (up to 3) adds names and numbers of missed requirements. If `leads`, the
    text begins with the statement that no controller meets all requirements.
    """
    verdicts, names = models[VERDICTS], models.names
    number = len(verdicts.requirements)
    if not number:
        return "The campaign has no requirements."
    bound = _binding_statuses(verdicts)
    own = {name: _binding_verdicts(verdicts, name) for name in (*bound, *names.controllers)}
    meeting = [
        name
        for name, entries in own.items()
        if all(verdict and verdict.status == "PASS" for _, verdict in entries)
    ]
    falling = [name for name in _concerned_controllers(models) if name not in meeting]
    requirements = f"{_all_of(number)} requirements" if number > 1 else "the requirement"
    if any(len(own[name]) < number for name in meeting):
        requirements = (
            "all of their requirements" if len(meeting) > 1 else "all of its requirements"
        )
    meet = (
        f"{_name_controllers(meeting, names)} meet{'s' * (len(meeting) == 1)} {requirements}"
        if meeting
        else ""
    )
    groups: dict[str, list[str]] = {}  # clause -> controllers to which it applies
    previous: tuple[list[Requirement], bool] = [], False
    for name in falling:
        entries = _listed_entries(own[name])
        listed = [item for item, _ in entries], _has_failed(entries)
        is_named = len(listed[0]) == 1 and listed == previous
        words = _short_words(own[name], names, detail, is_named=is_named)
        groups.setdefault(words, []).append(names.subject(name))
        previous = listed
    short = [_subject_words(controllers, words) for words, controllers in groups.items()]
    if len(short) > _REASONS:
        short = [
            f"{_name_controllers(falling, names)} miss requirements or are not shown to meet them"
        ]
    parts = [*short, meet] if bound.keys() & falling else [meet, *short]
    text = "; ".join(filter(None, parts))
    if meeting or len(own) == 1 or (len(own) == len(falling) and not leads):
        return f"{text[:1].upper()}{text[1:]}."
    all_miss = all(_has_failed(entries) for entries in own.values())
    verb = "meets" if all_miss else "is shown to meet"
    return f"No {names.campaign.kind} {verb} {requirements}: {text}."


def _subject_words(controllers: list[str], words: str) -> str:
    """Return a clause on one or several controllers.

    `words` starts with a singular verb, or contains {} in place of the controllers' names.
    """
    if " of {} are " in words:
        return words.replace("{}", joined(controllers), 1)
    also = "also " * words.startswith("also ")
    verb, _, rest = words.removeprefix("also ").partition(" ")
    if len(controllers) > 1:
        verb = {"is": "are", "misses": "miss"}[verb]
    return f"{joined(controllers)} {also}{verb} {rest}"


def _name_controllers(controllers: list[str], names: Names) -> str:
    if len(controllers) > _REASONS:
        total = "All " * (len(controllers) == len(names.controllers))
        return f"{total}{len(controllers)} {names.campaign.kind}s"
    return joined(list(map(names.subject, controllers)))


def _all_of(number: int) -> str:
    """Return 'both' for two, otherwise text such as 'all 3'."""
    return "both" if number == 2 else f"all {number}"


def _concerned_controllers(models: Models) -> list[str]:
    """Return the controllers to which requirements apply or that the question names.

    If the campaign has no question, all controllers are returned.
    """
    campaign = models.results.campaign
    asked = campaign.compared if campaign.model.asks else tuple(models.names.controllers)
    return list(dict.fromkeys((*_binding_statuses(models[VERDICTS]), *asked)))


def _binding_verdicts(
    verdicts: Verdicts, name: str
) -> list[tuple[Requirement, ControllerVerdict | None]]:
    """Return the requirements on a controller (all if there are none) with their verdicts.

    The verdict is None if no flight of the controller could be computed.
    """
    binding = [item for item in verdicts.requirements if name in item.asked.controllers]
    return [(item.asked, item.controllers.get(name)) for item in binding or verdicts.requirements]


def _listed_entries(
    own: list[tuple[Requirement, ControllerVerdict | None]],
) -> list[tuple[Requirement, ControllerVerdict | None]]:
    """Return the missed requirements or, if none is missed, those not shown to be met."""
    missed = [entry for entry in own if entry[1] and entry[1].status == "FAIL"]
    return missed or [entry for entry in own if not entry[1] or entry[1].status != "PASS"]


def _has_failed(entries: list[tuple[Requirement, ControllerVerdict | None]]) -> bool:
    """Return True if any verdict is FAIL."""
    return any(verdict and verdict.status == "FAIL" for _, verdict in entries)


def _short_words(
    own: list[tuple[Requirement, ControllerVerdict | None]],
    names: Names,
    detail: int,
    *,
    is_named: bool,
) -> str:
    """Describe the missed requirements of one controller.

    For example, 'misses the speed error requirement (101 of 1000 flights, 10 %; 1 % allowed)'. Two
    missed requirements are named, as in 'misses 2 of 5 requirements: speed error and sideslip'; if
    there are more, they are only counted. Undecided requirements are the subject, as in '2 of 5
    requirements of {} are undecided'. If `is_named`, the preceding clause makes the same statement
    on another controller; the requirement is then called 'it', as in 'also misses it'.
    """
    listed = _listed_entries(own)
    missed = _has_failed(listed)
    also = "also " * is_named
    verb = f"{also}misses" if missed else f"is {also}not shown to meet"
    passed = sum(verdict is not None and verdict.status == "PASS" for _, verdict in own)
    others = len(own) - len(listed) - passed
    suffix = f", with {others} other requirement{'s' * (others > 1)} undecided" if others else ""
    phrases, counts, allowed = [], [], detail > 1 and not is_named
    for item, verdict in listed:
        phrases.append(names.metrics[item.metric].phrase)
        counts.append(f" ({_failure_words(item, verdict, allowed)})" if verdict and detail else "")
    if len(listed) == 1:
        subject = "it" if is_named else f"the {phrases[0]} requirement"
        return f"{verb} {subject}{counts[0]}{suffix}"
    number = f"{len(listed)} of {len(own)}"
    if len(listed) == len(own):
        number = _all_of(len(own))
    head = f"misses {number} requirements"
    if not missed:
        head = f"{number} requirements of {{}} are undecided"
    if len(listed) > _NAMED or not detail:
        return f"{head}{suffix}"
    if detail > 2:
        phrases = [phrase + count for phrase, count in zip(phrases, counts, strict=True)]
    return f"{head}: {joined(phrases)}{suffix}"


def _failure_words(item: Requirement, verdict: Verdict, with_allowed: bool) -> str:
    """Return the failures and their share and, if `with_allowed`, the allowed share."""
    text = f"no failures in {counted(verdict.flights, 'flight')}"
    if verdict.failures:
        count = count_of(verdict.failures, verdict.flights, "flight")
        text = f"{count}, {percent(verdict.failures / verdict.flights, 2)}"
    return f"{text}; {percent(1.0 - item.probability)} allowed" if with_allowed else text


def _better_words(models: Models, better: str) -> str:
    """Return the sentence on the better controller, if the statistics show that one is better."""
    names, pairs = models.names, _compared_pairs(models)
    if better == ALONE:
        return ""
    if better in (NO_DIFFERENCE, MIXED):
        shown = "is shown to be" if better == NO_DIFFERENCE or _losing(pairs) else "is"
        suffix = "" if shown == "is shown to be" else " on every metric"
        if len(pairs) == 1:
            a, b = names.subject(pairs[0].a), names.subject(pairs[0].b)
            return f"Neither {a} nor {b} {shown} better than the other{suffix}."
        return f"No {names.campaign.kind} {shown} better than the others{suffix}."
    if better == pairs[0].a:
        return _better_than(better, pairs, names)
    sentence = _better_than(better, [pair for pair in pairs if pair.b == better], names)
    others = [pair for pair in pairs if pair.b != better]
    return f"{sentence} {_better_than(pairs[0].a, others, names)}" if others else sentence


def _losing(pairs: Sequence[ControllerPair]) -> bool:
    """Return whether early terminations differ significantly in any pair of controllers."""
    return any(pair.losing for pair in pairs)


def _better_than(better: str, pairs: Sequence[ControllerPair], names: Names) -> str:
    """Return a sentence that states why the controller `better` is better than its rivals."""
    if len(pairs) == 1 and pairs[0].losing:
        pair, lost = pairs[0], pairs[0].ended_early
        counts = {pair.a: lost.both + lost.only_a, pair.b: lost.both + lost.only_b}
        (rival,) = counts.keys() - {better}
        compared = (
            f"{fixed(counts[better], 0)} against {count_of(counts[rival], pair.pairs, 'flight')}"
        )
        winner, loser = names.subject(better), names.subject(rival)
        return f"{winner} is better than {loser}: {compared} terminated early."
    rivals: dict[str, list[str]] = {}  # reason -> rival controllers to which it applies
    for pair in pairs:
        reason = "with fewer early terminations"
        if not pair.losing:
            standings = standing(pair, names)
            won = standings["better" if better == pair.a else "worse"]
            total = sum(map(len, standings.values()))
            listed = joined(won) if len(won) <= _NAMED else ""
            reason = f"on {count_of(len(won), total, 'metric')}" + (
                f" ({listed})" if listed else ""
            )
            reason = f"{reason} and worse on none" if total > 1 else f"on {listed}"
        rivals.setdefault(reason, []).append(names.subject(pair.b if better == pair.a else pair.a))
    if len(rivals) > _NAMED:
        return f"{names.subject(better)} is better than {_all_of(len(pairs))} others."
    reasons = [f"than {shorten_list(labels)} {reason}" for reason, labels in rivals.items()]
    basis = "" if _losing(pairs) else "Flight by flight, "
    return f"{basis}{names.subject(better)} is better {'; '.join(reasons)}."


def _compared_pairs(models: Models) -> list[ControllerPair]:
    """Return the pairs to compare; by default, all pairs that include the first controller."""
    pairs, compared = models[COMPARISON].pairs.values(), models.results.campaign.compared
    return [pair for pair in pairs if not compared or {pair.a, pair.b} <= set(compared)]


def _binding_statuses(verdicts: Verdicts) -> dict[str, set[str]]:
    """Return the statuses of the requirements that apply to each controller.

    The status is NOT SHOWN if none of the controller's flights could be computed.
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


def _reasons(models: Models, better: str) -> Iterator[str]:
    names, verdicts, flights = models.names, models[VERDICTS], models[FLIGHTS].counts
    lost = [
        f"{count_of(count.failed, count.flown, 'flight')} with {names.subject(name)}"
        for name, count in flights.items()
        if count.failed
    ]
    pairs = _compared_pairs(models)
    is_answered = len(names.controllers) == 2 and better in names.controllers and _losing(pairs)
    if lost and not is_answered:
        yield f"Early terminations: {shorten_list(lost)}."
    margins = {name: least_margins(models[MARGINS], name) for name in names.controllers}
    loops = [
        f"{names.subject(name)} {least.words[0] if least.stable else 'unstable'}"
        for name, least in margins.items()
        if least and (not least.stable or least.gain < GAIN_MARGIN.customary)
    ]
    if loops:
        yield f"Gain margin below {GAIN_MARGIN.customary:g} dB: {shorten_list(loops)}."
    missed: dict[str, list[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            if name in item.controllers and item.controllers[name].status == "FAIL":
                missed.setdefault(names.subject(name), []).append(
                    names.metrics[item.asked.metric].phrase
                )
    several = [
        f"{label} in {shorten_list(phrases)}"
        for label, phrases in missed.items()
        if len(phrases) > _NAMED
    ]
    if several:
        # The answer names up to two violated requirements; of more, it states only the number.
        yield f"Missed requirements: {'; '.join(several)}."
    if names.campaign.judged:
        ranked = [pair for pair in by_strength(models[COMPARISON], names) if pair in pairs]
        angles = [*filter(None, (_angle_words(pair, names) for pair in ranked))]
        if angles or better in (MIXED, NO_DIFFERENCE) or _losing(pairs):
            yield from angles or filter(None, (_error_words(pair, names) for pair in ranked[:1]))


def shorten_list(items: list[str], separator: str = ", ") -> str:
    """Return 'a, b and c', or 'a, b and 2 more' for longer lists.

    A separator such as '; ' suits items that contain commas, as in 'a; b; and 2 more'.
    """
    more = [f"{len(items) - 2} more"] if len(items) > _REASONS else []
    listed = items[:2] if more else items
    if separator == ", ":
        return joined([*listed, *more])
    return separator.join([*listed, *(f"and {text}" for text in more)])


def _error_words(pair: ControllerPair, names: Names) -> str:
    """Return a sentence on the metrics in which each controller has smaller errors, or ''.

    For example, 'TLC has the smaller sideslip, LQR robust the smaller altitude error, at 0.34 times
    the control effort.'
    """
    metrics_by_side = {
        side: joined(metrics) if len(metrics) <= _REASONS else f"{len(metrics)} metrics"
        for side, metrics in standing(pair, names).items()
    }
    parts = (
        [f"{names.subject(pair.a)} has the smaller {metrics_by_side['better']}"]
        if metrics_by_side["better"]
        else []
    )
    if metrics_by_side["worse"]:
        parts.append(
            f"{names.subject(pair.b)} {'' if parts else 'has '}the smaller "
            f"{metrics_by_side['worse']}{_usage_words(pair)}"
        )
    return f"{', '.join(parts)}." if parts else ""


def _angle_words(pair: ControllerPair, names: Names) -> str:
    """Return a sentence on the rms errors of angles, or '' if the metrics are missing.

    For example, 'TLC has a smaller rms error than LQR in sideslip, in bank only outside the
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
        f"{names.subject(pair.a)} has a smaller rms error than {names.subject(pair.b)} {phrase}."
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


def _confidence_words(models: Models, better: str) -> str:
    """Return the sentence on the risk of each verdict and the joint risk of all verdicts."""
    verdicts, state = models[VERDICTS], models.results.manifest.state
    if state != "complete":
        return f"This campaign is {state}: all numbers are preliminary."
    joint = verdicts.held_together
    if not verdicts.requirements:
        return ""
    if joint is None:
        why = models.results.campaign.dependence
        return f"Results are estimates, not verdicts: {why}."
    risk = max(entry.asked.consumer_risk for entry in verdicts.requirements)
    passed = joint.stand + len(joint.dropped)
    sentences = []
    if passed:
        text = f"Each PASS has at most {percent(risk, 2)} consumer's risk"
        if passed > 1 and joint.stand:
            jointly = _all_of(passed) if joint.stand == passed else f"{joint.stand} of {passed}"
            text += f"; {jointly} PASS verdicts also hold{'s' * (joint.stand == 1)} jointly"
        elif passed > 1:
            none = "neither" if passed == 2 else "none"
            text += f"; after the joint correction, {none} of the {passed} PASS verdicts holds"
        sentences.append(f"{text}.")
    if better in models.names.controllers:
        sentences.append(
            f"The risk of naming a wrong winner is at most {percent(WINNERS_RISK, 2)}."
        )
    return " ".join(sentences)


def flights_for_joint_verdicts(verdicts: Verdicts) -> int | None:
    """Return the number of flights at which all PASS verdicts would hold jointly.

    Return None if they already hold jointly. Joint verdicts follow Holm's procedure; the estimate
    assumes no further failures.
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
    """Recommend an explanation of failures, more flights, or no further flights."""
    if models.results.manifest.state != "complete":
        return None
    statuses = _concerned_statuses(models)
    missing, unshown = _missing_runs(models), statuses.count("NOT SHOWN")
    verdicts, flies = models[VERDICTS], models.names.campaign.can_rerun
    undecided = sum(
        verdict.status == "NOT SHOWN"
        for item in verdicts.requirements
        for verdict in item.controllers.values()
    )
    if missing and (unshown or "FAIL" not in statuses):
        remaining = counted(missing - models.results.campaign.runs_at_point, "remaining flight")
        why = f"{'run' if flies else 'import'} the {remaining} of the campaign file"
        if unshown:
            why += f", because {counted(undecided, 'verdict is/verdicts are')} undecided"
        elif "PASS" in statuses:
            why += "; no verdict is undecided"
        if "FAIL" in statuses:
            why += f"; {_FAILS_STAY}"
        command = f"abhv-mc run DIR/campaign.yaml -o DIR --runs {missing}"
        return NextStep(why, command if flies else "")
    if not models.names.campaign.judged:
        return None
    if met == "nothing required":
        if not flies:
            return None
        why = "for verdicts, add requirements to the campaign file; stored flights are kept"
        return NextStep(why, "abhv-mc run FILE -o DIR")
    if met == "no" or (missing and "FAIL" in statuses):
        changes = models.results.requirement_changes
        # These requirements apply only to this report, not to the folder.
        if flies and changes and not changes[-1].time:
            return NextStep(
                "these requirements apply only to this report; to adopt them, add them to the "
                "campaign file and run the campaign, which keeps the stored flights",
                "abhv-mc run FILE -o DIR",
            )
        stay = f"; {_FAILS_STAY}" if missing else ""
        if flies:
            return NextStep(f"find out why flights fail{stay}", "abhv-mc explain DIR --all")
        return NextStep(f"see 'Failure analysis' in the report{stay}")
    if met == "not shown":
        binding = [
            verdict
            for item in verdicts.requirements
            for name in item.asked.controllers
            if (verdict := item.controllers.get(name))
        ]
        return _advise_flights(binding, flies, bool(models.names.campaign.unknowns.names))
    jointly = flights_for_joint_verdicts(verdicts)
    if jointly:
        return _longer_run(
            jointly,
            f"all PASS verdicts hold jointly with {counted(jointly, 'flight')} if no more fail",
            flies,
        )
    if met != "yes":
        return None
    bound = list(_binding_statuses(verdicts))
    scope = f" for {_name_controllers(bound, models.names)}" if unshown else ""
    return NextStep(f"no further flights are needed{scope}")


def _concerned_statuses(models: Models) -> list[str]:
    """Return the statuses of the verdicts on the controllers of interest."""
    return [
        verdict.status
        for name in _concerned_controllers(models)
        for _, verdict in _binding_verdicts(models[VERDICTS], name)
        if verdict
    ]


def _advise_flights(binding: Sequence[Verdict], flies: bool, has_unknowns: bool) -> NextStep | None:
    """Recommend a number of flights at which all binding verdicts are likely to be PASS.

    With unknown parameters, the numbers of flights and the chances are those at the worst point of
    each verdict.
    """
    open_ones = [verdict for verdict in binding if verdict.status == "NOT SHOWN"]
    if not open_ones:
        return None
    if any(UNSEARCHED in verdict.note for verdict in open_ones):
        return NextStep(
            "run a campaign with these requirements in a new folder, because the worst values of "
            "the unknowns were not searched for"
        )
    several, each = len(binding) > 1, " at each point" if has_unknowns else ""
    if advice := advise(binding):
        condition = ", or more if their failure rates are correlated" if several else ""
        subject = f"all {len(binding)} verdicts are" if several else "the verdict is"
        at_worst = f" at the worst point{'s' * several}" * has_unknowns
        chance = f"{subject} PASS{at_worst} with a chance of {about(advice.chance)}{condition}"
        return _longer_run(
            advice.flights, f"with {counted(advice.flights, 'flight')}{each} {chance}", flies
        )
    separate = [single for verdict in open_ones if (single := advise([verdict]))]
    flights = max(verdict.flights for verdict in open_ones)
    least = max(
        flights_to_pass(verdict.failures, verdict.probability, verdict.consumer_risk)
        for verdict in open_ones
    )
    if least > MOST_TIMES * flights and not separate:
        least_chance = min(predict_pass(verdict, least) for verdict in open_ones)
        subject = "each verdict then has" if several else "the verdict then has"
        text = (
            f"at least {counted(least, 'flight')}{each} are needed; {subject} a chance of PASS of "
            f"{about(least_chance)}{' or more' if several else ''}"
        )
        if least > _MOST_LONGER * flights:
            return NextStep(text)
        return _longer_run(least, text, flies)
    goal = "a PASS of all verdicts" if several else "a PASS"
    text = f"no number of flights{each} up to {fixed(MOST_TIMES * flights, 0)} makes {goal} likely"
    if separate:
        need = counted(max(single.flights for single in separate), "flight")
        number = f"{len(separate)} of the {counted(len(open_ones), 'undecided verdict')}"
        text += f"; individually, PASS is likely for {number} with up to {need}"
    else:
        text += f"; {goal} needs at least {counted(least, 'flight')}"
    return NextStep(text)


def _longer_run(flights: int, why: str, flies: bool) -> NextStep:
    if not flies:
        return NextStep(f"import a larger table: {why}")
    return NextStep(why, f"abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}")
