"""The judgement on a campaign: are its requirements met, which controller is better, why, how sure, and what next."""

import math
from collections.abc import Iterator

from abhv_mc.flight.metrics import GAIN_MARGIN
from abhv_mc.report.numbers.judged import Judgement, Met, Next
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import advise
from abhv_mc.statistics.winner import RISK as WINNERS_RISK
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.model import ControllerPair
from abhv_mc.topics.comparison.sentences import by_strength, closer_in, standing, verdict_of
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.model import least_margins
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import Verdicts
from abhv_mc.topics.words import count_of, fixed, joined, percent, significant

MIXED, NO_DIFFERENCE, ALONE = "mixed", "no difference shown", "none to compare"
_REASONS = 3
_SAME_USAGE = 0.05  # of a ratio of surface usage: nearer to 1 goes without saying
_MOST_TIMES = 10  # the flights flown: an extension beyond that is not advised
_FAIR = 0.25  # chance of a PASS with which one is


def judge_campaign(models: Models) -> Judgement:
    """The one judgement on a campaign, of the models of its topics."""
    verdicts, names = models[VERDICTS], models.names
    bound = _bound(verdicts)
    statuses, better = set().union(*bound.values()), _better(models)
    met: Met = "nothing required"
    if statuses:
        met = "no" if "FAIL" in statuses else "yes" if statuses == {"PASS"} else "not shown"
    failed = [name for name, found in bound.items() if "FAIL" in found]
    passed = [name for name, found in bound.items() if found == {"PASS"}]
    open_ones = [name for name in bound if name not in (*failed, *passed)]

    def who(them: list[str]) -> str:
        return (
            joined(list(map(names.label, them)))
            if len(them) <= 2
            else f"{len(them)} {names.campaign.kind}s"
        )

    free = [name for name in names.controllers if name not in bound]
    others = [name for name in free if set(verdicts.statuses(name)) == {"PASS"}]
    too = (
        f"; {joined(list(map(names.label, others)))} meet{'s' * (len(others) == 1)} them, too"
        if others
        else ""
    )
    also = f"; not shown for {who(open_ones)}" if open_ones else ""
    told = {
        "yes": f"Requirements met by {who(passed)}{too}.",
        "no": f"Requirements not met by {who(failed)}{also}.",
        "not shown": f"Not shown that {who(open_ones)} meet{'s' * (len(open_ones) == 1)} the requirements.",
        "nothing required": "Nothing is required.",
    }
    winner = {
        MIXED: " None is better throughout.", NO_DIFFERENCE: f" No {names.campaign.kind} is shown to be better.",
        ALONE: "",
    }  # fmt: skip
    answer = told[met] + (
        winner[better] if better in winner else f" {names.label(better)} is better."
    )
    because = tuple(_reasons(models))[:_REASONS]
    return Judgement(met, better, because, _sure(models), _next(models, met), answer)


def _bound(verdicts: Verdicts) -> dict[str, set[str]]:
    """The statuses of what binds each controller; NOT SHOWN where none of its flights could be computed."""
    found: dict[str, set[str]] = {}
    for item in verdicts.requirements:
        for name in item.asked.controllers:
            held = item.controllers.get(name)
            found.setdefault(name, set()).add(held.status if held else "NOT SHOWN")
    return found


def _better(models: Models) -> str:
    pairs, names = list(models[COMPARISON].pairs.values()), models.names
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
    if missed:
        yield f"Missed: {'; '.join(f'{who} in {few(what)}' for who, what in missed.items())}."
    if names.campaign.judged:
        pairs = by_strength(models[COMPARISON], names)
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
    """'TLC is closer in sideslip, LQR robust in altitude at 0.34 times the surface usage.'; '' where nothing tells."""
    held = {
        side: joined(metrics) if len(metrics) <= _REASONS else f"{len(metrics)} metrics"
        for side, metrics in standing(pair, names).items()
    }
    parts = [f"{names.label(pair.a)} is closer in {held['better']}"] if held["better"] else []
    if held["worse"]:
        parts.append(
            f"{names.label(pair.b)} {'' if parts else 'is closer '}in {held['worse']}{_usage(pair)}"
        )
    return f"{', '.join(parts)}." if parts else ""


def _angles(pair: ControllerPair, names: Names) -> str:
    """'By rms TLC is closer than LQR in sideslip, in bank only when settled.': which has the smaller rms error on more
    flights; '' where the campaign counts no rms error of settled stretches."""
    found = closer_in(pair, names)
    sides = {
        (True, True): "",
        (False, True): " only when settled",
        (True, False): " but not when settled",
    }
    parts = [f"in {joined(found[side])}{words}" for side, words in sides.items() if side in found]
    words = ", ".join(parts) if parts else "in no angle"
    return (
        f"By rms {names.label(pair.a)} is closer than {names.label(pair.b)} {words}."
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
    return f" at {significant(1.0 / ratios[0], 2)} times the surface usage"


def _sure(models: Models) -> str:
    """How sure the verdicts are, each and jointly."""
    verdicts, state = models[VERDICTS], models.results.manifest.state
    if state != "complete":
        return f"This campaign is {state}: all numbers are preliminary."
    held = verdicts.held_together
    if not verdicts.requirements:
        return ""
    if held is None:
        return "Exact for independent flights only: no verdicts for this design."
    risk = max(entry.asked.consumer_risk for entry in verdicts.requirements)
    passed = held.stand + len(held.dropped)
    text = f"Verdicts at {percent(risk, 2)} risk."
    if models.names.campaign.judged and models[COMPARISON].pairs:
        text = f"Verdicts at {percent(risk, 2)} risk, winners at {percent(WINNERS_RISK, 2)}."
    if passed > 1:
        text += f" Jointly {held.stand or 'none'} of {passed} PASS stand{'s' if held.stand == 1 else ''}."
    return text


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
    if models.results.manifest.state != "complete" or not models.names.campaign.independent:
        return None
    verdicts, flies = models[VERDICTS], models.names.campaign.can_rerun
    why_failed = Next("why flights fail", "abhv-mc explain DIR --all")
    if not flies:
        why_failed = Next("see 'Why flights fail' in the report")
    if met == "no":
        return why_failed
    if met == "not shown":
        binding = [
            item.controllers.get(name)
            for item in verdicts.requirements
            for name in item.asked.controllers
        ]
        open_ones = [each for each in binding if each and each.status == "NOT SHOWN"]
        if not open_ones:
            return None
        found = [advise(each) for each in open_ones]
        if any(each is None or each.chance < _FAIR for each in found):
            return why_failed
        need = max(each.flights for each in found if each)
        if need > _MOST_TIMES * max(each.flights for each in open_ones):
            return Next(
                f"{fixed(need, 0)} flights would do, more than {_MOST_TIMES} times those flown"
            )
        return _more(need, f"{fixed(need, 0)} flights would do for each by itself", flies)
    jointly = flights_jointly(verdicts)
    if jointly:
        return _more(jointly, f"all stand with {fixed(jointly, 0)} flights if no more fail", flies)
    return Next("nothing more needs to fly") if met == "yes" else None


def _more(flights: int, why: str, flies: bool) -> Next:
    if not flies:
        return Next(f"adopt a larger table: {why}")
    return Next(why, f"abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}")
