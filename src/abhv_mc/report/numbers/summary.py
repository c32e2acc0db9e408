"""The campaign's answer in sentences: flights lost, who wins and by how much, verdicts, why."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from abhv_mc.report.numbers.findings import finding_sentences
from abhv_mc.topics.drivers import DRIVERS
from abhv_mc.topics.failure_cases import FAILURE_CASES
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import fixed, joined, p_value, percent, significant

_OPEN = 2  # rivals told one by one, of whom no difference in lost flights is shown
_LOST_RISK = 0.05  # of saying that one controller loses more flights where both are as good


def _label(numbers: Mapping[str, Any], name: str) -> str:
    return str(numbers["campaign"]["labels"][name])


def _phrase(numbers: Mapping[str, Any], metric: str) -> str:
    return str(numbers["metrics"][metric]["phrase"])


def _standing(pair: Mapping[str, Any], numbers: Mapping[str, Any], full: bool = False) -> dict[str, list[str]]:
    """What of what is asked the first controller of a pair is better in, worse in, mixed, and what is open.

    In ``full``, the shares of flights that were tested stand beside what one is better in.
    """
    found: dict[str, list[str]] = {"better": [], "worse": [], "mixed": [], "open": []}
    for metric in numbers["asked"]:
        if metric in pair["metrics"]:
            entry = pair["metrics"][metric]
            won = {pair["a"]: "better", pair["b"]: "worse"}.get(entry["winner"], "open")
            words = _phrase(numbers, metric)
            if entry["mixed"]:
                won = "mixed"
                words += f" ({_contradiction(entry, numbers)})" if full else ""
            elif full and won != "open":
                words += _counts(pair, metric, numbers)
            found[won].append(words)
    return found


def _counts(pair: Mapping[str, Any], metric: str, numbers: Mapping[str, Any]) -> str:
    """' (closer on 83 %, further on 17 %; worst 0.2 and 0.9 deg)', what was tested first."""
    entry, of = pair["metrics"][metric], pair["pairs"]
    shares = [("closer", entry["a_better"]), ("further", entry["b_better"])]
    words = [f"{word} on {percent(count / of, 2)}" for word, count in shares]
    words += [f"equal on {percent(entry['ties'] / of, 2)}"] if entry["ties"] else []
    unit = numbers["metrics"][metric]["unit"].removeprefix("-")
    return f" ({', '.join(words)}; worst {' and '.join(map(significant, entry['worst']))} {unit})".replace(" )", ")")


def _contradiction(entry: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    """Why the controller that is closer on more flights is no winner."""
    closer = _label(numbers, entry["closer"]) if entry.get("closer") else "one"
    reasons = [f"a worse {100.0 * level:.4g} % quantile" for level in entry.get("worse_tails", [])[:1]]
    reasons += ["more flights lost"] if entry.get("loses_more") else []
    return f"{closer} is closer on more flights but has {joined(reasons)}"


def _verdict_of(pair: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    """'better', 'worse', 'mixed' or 'open' over all errors of a pair, lost flights among them."""
    found, lost = _standing(pair, numbers), pair["ended_early"]
    sides = {side for side in ("better", "worse") if found[side]}
    if found["mixed"] or len(sides) == 2:
        return "mixed"
    if lost["p_value"] <= _LOST_RISK and lost["only_a"] != lost["only_b"]:
        sides.add("worse" if lost["only_a"] > lost["only_b"] else "better")
    return "mixed" if len(sides) == 2 else next(iter(sides), "open")


def _by_strength(models: Models, numbers: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The pairs, the rival first against which the first controller stands worst; of equals the one that fails less."""
    order = {"worse": 0, "mixed": 1, "open": 2, "better": 3}

    def strength(pair: Mapping[str, Any]) -> tuple[int, int, int]:
        found = _standing(pair, numbers)
        failed = models[VERDICTS].statuses(pair["b"]).count("FAIL")
        return order[_verdict_of(pair, numbers)], len(found["better"]) - len(found["worse"]), failed

    return sorted(numbers["paired"].values(), key=strength)


def _pair_sentences(models: Models, numbers: Mapping[str, Any]) -> list[str]:
    """Against each rival, the strongest first; the first sentence begins with the answer over all rivals."""
    pairs = [pair for pair in _by_strength(models, numbers) if any(_standing(pair, numbers).values())]
    if not pairs:
        return []
    if not numbers["campaign"]["independent_flights"]:
        design = numbers["campaign"]["sampling"]
        return [f"No winner is named: the flights of a {design} design are not independent draws."]
    verdicts = {_verdict_of(pair, numbers) for pair in pairs}
    name = _label(numbers, pairs[0]["a"])
    overall = {"better": f"{name} is better: ", "worse": f"{name} is worse: ", "open": "No difference is shown: "}
    head = overall.get(next(iter(verdicts)), "Mixed: ") if len(verdicts) == 1 else "Mixed: "
    sentences = [_pair_sentence(pair, numbers) for pair in pairs]
    return [f"{head}{sentences[0]}", *(f"{text[0].upper()}{text[1:]}" for text in sentences[1:])]


def _pair_sentence(pair: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    found, first = _standing(pair, numbers, full=True), _label(numbers, pair["a"])
    words = {
        "better": "it is better on more flights in",
        "worse": "it is worse on more flights in",
        "mixed": "undecided in",
        "open": "no difference is shown in",
    }
    parts = [f"{words[side]} {joined(found[side])}" for side in words if found[side]]
    text = "; ".join(parts).replace("it is", f"{first} is", 1) + _tails_words(pair, numbers)
    flights = f"on the same {fixed(pair['pairs'], 0)} flights"
    return f"against {_label(numbers, pair['b'])}, {flights}, {text}{_usage_words(pair, first)}."


def _tails_words(pair: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    """'; tails not compared ...' where the flights are too few to compare the tails of an error with a winner."""
    metrics = [m for m in numbers["asked"] if m in pair["metrics"]]
    entries = [pair["metrics"][m] for m in metrics if pair["metrics"][m]["winner"]]
    levels = sorted({level for entry in entries for level in entry.get("uncompared_tails", [])})
    if not levels:
        return ""
    shown = joined([f"{100.0 * level:.4g} %" for level in levels])
    return f"; tails not compared at {shown} (too few flights)"


def _usage_words(pair: Mapping[str, Any], first: str) -> str:
    """'; TLC uses 1.2 times the aileron, as much rudder and 0.3 times the elevator', from the medians of the ratios."""
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
    return f"; {first} uses {joined(parts)} (rms, median of the flights' ratios)" if parts else ""


def _survival_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """Which controller of each pair loses fewer flights, as far as the flights show it."""
    sentences: list[str] = []
    open_: dict[str, str] = {}  # rival -> the sentence that no difference is shown
    for pair in numbers["paired"].values():
        found, (a, b) = pair["ended_early"], (_label(numbers, pair[side]) for side in ("a", "b"))
        alone = found["only_a"], found["only_b"]
        if not any(alone):
            continue
        lost = [fixed(found["both"] + count, 0) for count in alone]
        rest = (
            f"{lost[0]} of {fixed(pair['pairs'], 0)} ended early against {lost[1]} ({fixed(alone[0], 0)} under "
            f"{a} alone, {fixed(alone[1], 0)} under {b} alone; the chance of such a split were both as good: "
            f"{p_value(found['p_value'])})."
        )
        if found["p_value"] <= _LOST_RISK and alone[0] != alone[1]:
            sentences.append(f"{a} loses {'fewer' if alone[0] < alone[1] else 'more'} flights than {b}: {rest}")
        else:
            open_[b] = f"No difference is shown between {a} and {b} in lost flights: {rest}"
    if len(open_) > _OPEN:
        first = _label(numbers, numbers["campaign"]["controllers"][0])
        return [*sentences, f"No difference in lost flights is shown between {first} and {joined(list(open_))}."]
    return [*sentences, *open_.values()]


class SummaryParts(NamedTuple):
    """Sentences by the question that they answer."""

    lost: list[str]  # who loses fewer flights
    wins: list[str]  # who is better, against the strongest rival first
    known: list[str]  # verdicts, and what endangers each controller's flights
    drivers: list[str]  # why


def summary_parts(models: Models, numbers: Mapping[str, Any]) -> SummaryParts:
    """The sentences of :func:`summary_sentences`, for a page to put below its headings."""
    lost = [*models.sentences(FAILURE_CASES), *_survival_sentences(numbers)]
    known = [*models.sentences(VERDICTS), *finding_sentences(models, numbers)]
    return SummaryParts(lost, _pair_sentences(models, numbers), known, [*models.sentences(DRIVERS)])


def summary_sentences(models: Models, numbers: Mapping[str, Any]) -> list[str]:
    """What a reader with two minutes should know, most important first: lost flights, the answer against the
    strongest rival, the requirements, what endangers each controller's flights, the other rivals, then why.
    """
    lost, wins, known, drivers = summary_parts(models, numbers)
    return lost + wins[:1] + known + wins[1:] + drivers
