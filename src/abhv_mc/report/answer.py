"""The campaign's answer in sentences: verdicts, who wins and by how much, how sure."""

from collections.abc import Mapping, Sequence
from typing import Any

from abhv_mc.report.failures import EARLY
from abhv_mc.report.metrics import FOLLOWING, HOLDING, controller_label
from abhv_mc.report.parameters import spoken_name
from abhv_mc.report.words import count_of, fixed, p_value, percent, significant
from abhv_mc.statistics.verdict_words import risk_words

_SHORT = {
    "angle_of_attack_error_rms_deg": "angle of attack",
    "sideslip_rms_deg": "sideslip",
    "bank_error_rms_deg": "bank",
    "altitude_error_max_m": "altitude",
    "speed_error_max_mps": "speed",
}
_NAMED = 2  # drivers of an error
_MOVED = 2  # controllers whose drivers are told
_LOST_RISK = 0.05  # of saying that one controller loses more flights where both are as good
_LEAST_SHARE = 0.05  # of the variance, by the lower end of the total index


def joined(words: Sequence[str]) -> str:
    """'a', 'a and b', 'a, b and c'."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


def _requirements_sentence(numbers: Mapping[str, Any]) -> str:
    parts = []
    for name in numbers["campaign"]["controllers"]:
        words = [entry["controllers"][name]["status"] for entry in numbers["requirements"]]
        counts = [f"{words.count(word)} {word}" for word in ("PASS", "FAIL", "NOT SHOWN") if word in words]
        if "ESTIMATE" in words:
            kept = sum(entry["controllers"][name]["failures"] == 0 for entry in numbers["requirements"])
            counts = [f"{count_of(kept, len(words))} kept in every flight"]
        parts.append(f"{controller_label(name)} {joined(counts)}")
    return f"Requirements: {'; '.join(parts)}."


def _standing(pair: Mapping[str, Any]) -> dict[str, list[str]]:
    """What the first controller of a pair is better in, worse in, mixed, and where no difference is shown."""
    found: dict[str, list[str]] = {"better": [], "worse": [], "mixed": [], "open": []}
    for metric in (*FOLLOWING, *HOLDING):
        if metric in pair["metrics"]:
            entry = pair["metrics"][metric]
            won = {pair["a"]: "better", pair["b"]: "worse"}.get(entry["winner"], "open")
            words = _SHORT[metric]
            if entry["mixed"]:
                won, words = "mixed", f"{words} ({_contradiction(entry)})"
            found[won].append(words)
    return found


def _contradiction(entry: Mapping[str, Any]) -> str:
    """Why the controller that is closer in the median is no winner."""
    closer = controller_label(entry["closer"]) if entry.get("closer") else "one"
    reasons = [f"larger {100.0 * level:.4g} % quantile" for level in entry.get("worse_tails", [])[:1]]
    reasons += ["more flights lost"] if entry.get("loses_more") else []
    return f"{closer} has the smaller median but {joined(reasons)}" if reasons else f"{closer} in the median alone"


def _verdict_of(pair: Mapping[str, Any]) -> str:
    """'better', 'worse', 'mixed' or 'open' over all errors of a pair, lost flights among them."""
    found, lost = _standing(pair), pair["ended_early"]
    sides = {side for side in ("better", "worse") if found[side]}
    if found["mixed"] or len(sides) == 2:
        return "mixed"
    if lost["p_value"] <= _LOST_RISK and lost["only_a"] != lost["only_b"]:
        sides.add("worse" if lost["only_a"] > lost["only_b"] else "better")
    return "mixed" if len(sides) == 2 else next(iter(sides), "open")


def _by_strength(numbers: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The pairs, the rival first against which the first controller stands worst."""
    order = {"worse": 0, "mixed": 1, "open": 2, "better": 3}
    pairs = list(numbers["paired"].values())
    return sorted(
        pairs, key=lambda p: (order[_verdict_of(p)], len(_standing(p)["better"]) - len(_standing(p)["worse"]))
    )


def _pair_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """Against each rival, the strongest first; the first sentence begins with the answer over all rivals."""
    pairs = [pair for pair in _by_strength(numbers) if any(_standing(pair).values())]
    if not pairs:
        return []
    verdicts = {_verdict_of(pair) for pair in pairs}
    name = controller_label(pairs[0]["a"])
    overall = {"better": f"{name} is better: ", "worse": f"{name} is worse: ", "open": "No difference is shown: "}
    head = overall.get(next(iter(verdicts)), "Mixed: ") if len(verdicts) == 1 else "Mixed: "
    sentences = [_pair_sentence(pair) for pair in pairs]
    return [f"{head}{sentences[0]}", *(f"{text[0].upper()}{text[1:]}" for text in sentences[1:])]


def _pair_sentence(pair: Mapping[str, Any]) -> str:
    found = _standing(pair)
    parts = []
    if found["better"]:
        parts.append(f"it has the smaller errors in {joined(found['better'])}")
    if found["worse"]:
        parts.append(f"it has the larger errors in {joined(found['worse'])}")
    if found["mixed"]:
        parts.append(f"undecided in {joined(found['mixed'])}")
    if found["open"]:
        parts.append(f"no difference is shown in {joined(found['open'])}")
    text = "; ".join(parts).replace("it has", f"{controller_label(pair['a'])} has", 1) + _tails_words(pair)
    flights = f"on the same {fixed(pair['pairs'], 0)} flights"
    return f"against {controller_label(pair['b'])}, {flights}, {text}{_usage_words(pair)}."


def _tails_words(pair: Mapping[str, Any]) -> str:
    """'; tails not compared ...' where the flights are too few to compare the tails of an error with a winner."""
    metrics = [m for m in (*FOLLOWING, *HOLDING) if m in pair["metrics"]]
    entries = [pair["metrics"][m] for m in metrics if pair["metrics"][m]["winner"]]
    levels = sorted({level for entry in entries for level in entry.get("uncompared_tails", [])})
    if not levels:
        return ""
    shown = joined([f"{100.0 * level:.4g} %" for level in levels])
    return f"; tails not compared at {shown}, for which the flights are too few"


def _noteworthy_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """Saturated surfaces, flights that cycle, and flights beyond the tables, all controllers in one sentence each."""
    found = numbers.get("noteworthy", {})
    texts = []
    kinds = (
        ("saturated", "Surfaces reach a limit of deflection or rate in"),
        ("outside_tables", "The vehicle's tables are left in"),
    )
    for key, words in kinds:
        parts = [
            f"{count_of(part[key], part['flown'], 'flights')} of {controller_label(name)}"
            for name, part in found.items()
            if part[key]
        ]
        if parts:
            texts.append(f"{words} {joined(parts)}.")
    parts = [
        f"{controller_label(name)} in {channel.replace('_', ' ')} ({count_of(count, part['flown'], 'flights')})"
        for name, part in found.items()
        for channel, count in part["cycling"].items()
        if count
    ]
    if parts:
        least = next(iter(found.values()))["ripple_deg"]
        texts.append(f"Some flights cycle (swing by more than {least:g} deg about a steady command): {joined(parts)}.")
    return texts


def _usage_words(pair: Mapping[str, Any]) -> str:
    """'; it uses 1.2 times the aileron, as much rudder, and 0.3 times the elevator', from the medians of the ratios."""
    parts = []
    for metric, ratio in pair["surfaces"].items():
        if ratio is None:
            continue
        surface = metric.split("_", 1)[0]
        value = ratio["value"]
        if abs(value - 1.0) < 0.01:
            parts.append(f"as much {surface}")
        elif abs(value - 1.0) < 0.2:
            parts.append(f"{percent(abs(value - 1.0), 2)} {'more' if value > 1.0 else 'less'} {surface}")
        else:
            parts.append(f"{significant(value, 2)} times the {surface}")
    return f"; {controller_label(pair['a'])} uses {joined(parts)} (rms)" if parts else ""


def _early_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """Which controller loses fewer flights, how many each ended early, and where those flights live."""
    sentences = []
    for pair in numbers["paired"].values():
        found = pair["ended_early"]
        if found["only_a"] or found["only_b"]:
            sentences.append(
                f"{fixed(found['only_b'], 0)} flights ended early under {controller_label(pair['b'])} alone, "
                f"{fixed(found['only_a'], 0)} under {controller_label(pair['a'])} alone "
                f"(the chance of such a split were both as good: {p_value(found['p_value'])})."
            )
    for name, counts in numbers["flights"].items():
        if not counts["failed"]:
            continue
        failed = count_of(counts["failed"], counts["flown"], "flights")
        text = f"{controller_label(name)} ended {failed} early"
        kinds = numbers["drivers"].get("controllers", {}).get(name, {}).get("failures", [])
        rules: list[Any] = next((kind["rules"] for kind in kinds if kind["kind"] == EARLY), [])
        sentences.append(f"{text}, most of all where {rules[0]['rule']}." if rules else f"{text}.")
    return sentences


def _driver_sentence(numbers: Mapping[str, Any], name: str) -> str:
    """What moves each headline error of a controller most, by Sobol's total index or by rank correlation."""
    sobol = numbers["sobol"].get("controllers", {}).get(name, {}).get("metrics", {})
    ranks = numbers["drivers"].get("controllers", {}).get(name, {}).get("metrics", {})
    parts, widths = [], [0.0]
    for metric in (*HOLDING, *FOLLOWING):
        if metric in sobol:
            top = [e for e in sobol[metric] if e["total"][1] > _LEAST_SHARE][:_NAMED]
            widths += [(e[kind][2] - e[kind][1]) / 2.0 for e in top for kind in ("first", "total")]
            words = [f"{spoken_name(e['parameter'])} ({_share(e['total'])}, {_share(e['first'])} alone)" for e in top]
        else:
            found = [e["parameter"] for e in ranks.get(metric, {}).get("parameters", []) if e["driver"]]
            words = [spoken_name(parameter) for parameter in dict.fromkeys(found)][:_NAMED]
            if not words and metric in ranks:
                words = ["no single parameter"]
        if words:
            parts.append(f"{_SHORT[metric]}: {joined(words)}")
    if not parts:
        return ""
    how = ""
    if sobol:
        how = f" (share of the variance that involves them, within {percent(round(max(widths), 2), 2)} or closer)"
    return f"What moves {controller_label(name)}'s errors most{how}: {'; '.join(parts)}."


def _first_drivers_sentence(numbers: Mapping[str, Any]) -> str:
    """In which errors the parameter with the largest total index is the same for all controllers, and where not."""
    found = {n: part["metrics"] for n, part in numbers["sobol"].get("controllers", {}).items() if part["metrics"]}
    same, apart = [], []
    for metric in (*HOLDING, *FOLLOWING) if len(found) > 1 else ():
        if any(metric not in part for part in found.values()):
            continue
        first = {name: spoken_name(part[metric][0]["parameter"]) for name, part in found.items()}
        if len(set(first.values())) == 1:
            same.append(f"{_SHORT[metric]} ({next(iter(first.values()))})")
        else:
            each = [f"{word} for {controller_label(name)}" for name, word in first.items()]
            apart.append(f"{_SHORT[metric]} ({', '.join(each)})")
    parts = [f"the same in {joined(same)}"] if same else []
    parts += [f"it differs in {joined(apart)}"] if apart else []
    who = joined([controller_label(name) for name in found])
    return f"What spreads an error most is for {who} {'; '.join(parts)}." if parts else ""


def _share(index: Sequence[float]) -> str:
    """A Sobol index in percent; noise may take the estimate past the ends."""
    return percent(min(max(round(index[0], 2), 0.0), 1.0), 2)


def answer_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """What a reader with two minutes should know, most important first: the answer against the strongest rival, what
    endangers flights, the other rivals and requirements, then why.

    A Saltelli campaign was flown to learn what moves the errors, and says that before who wins.
    """
    wins = _pair_sentences(numbers)
    if numbers["requirements"]:
        wins.append(_requirements_sentence(numbers))
    drivers = [_first_drivers_sentence(numbers)]
    drivers += [_driver_sentence(numbers, name) for name in numbers["campaign"]["controllers"][:_MOVED]]
    for name, part in numbers["sobol"].get("controllers", {}).items():
        if part["refused"]:
            drivers.append(f"{controller_label(name)} has no Sobol indices: {part['refused']}.")
    known = _early_sentences(numbers) + _noteworthy_sentences(numbers)
    sentences = drivers + wins + known if numbers["sobol"] else wins[:1] + known + wins[1:] + drivers
    return [sentence for sentence in sentences if sentence]


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
        text += f" {rule[0].upper()}{rule[1:]}."
        count = sum(len(entry["controllers"]) for entry in numbers["requirements"])
        if numbers.get("any_false_pass") is not None and count > 1:
            bound = percent(numbers["any_false_pass"], 2)
            held = (
                "held by the campaign's family of verdicts" if numbers.get("family_risk") else "each has its own risk"
            )
            text += f" Among all {count} verdicts the chance of any false PASS is at most {bound} ({held})."
    if campaign["looks"] and len(flown) == 1:
        text += " " + _stopping_sentence(campaign, flown.pop())
    for warning in numbers["warnings"]:
        text += f" Note: {warning}."
    if numbers["state"] != "complete":
        text += " The campaign is not complete; all numbers are preliminary."
    return text
