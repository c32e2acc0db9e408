"""Who loses fewer flights, and who is better in what against whom."""

from collections.abc import Mapping, Sequence
from math import inf

from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.topics.comparison.model import ComparedMetric, Comparison, ControllerPair
from abhv_mc.topics.names import Names
from abhv_mc.topics.words import fixed, joined, p_value, percent, significant

_OPEN = 2  # rivals told one by one, of whom no difference in lost flights is shown


def comparison_sentences(found: Comparison, names: Names) -> Sequence[str]:
    """Lost flights, then each rival."""
    return [*survival_sentences(found, names), *_pair_sentences(found, names)]


def standing(pair: ControllerPair, names: Names, full: bool = False) -> Mapping[str, list[str]]:
    """What the first of a pair is better and worse in, mixed and open; in ``full`` with the shares of flights."""
    found: dict[str, list[str]] = {"better": [], "worse": [], "mixed": [], "open": []}
    for metric, entry in asked_of(pair, names).items():
        won = "open" if entry.winner is None else "better" if entry.winner == pair.a else "worse"
        words = names.metrics[metric].phrase
        if entry.mixed:
            won = "mixed"
            words += f" ({_contradiction(pair, entry, names)})" if full else ""
        elif full and won != "open":
            words += _counts(pair, metric, names)
        found[won].append(words)
    return found


def asked_of(pair: ControllerPair, names: Names) -> Mapping[str, ComparedMetric]:
    """The metrics of a pair that stand first."""
    return {metric: pair.metrics[metric] for metric in names.asked if metric in pair.metrics}


def closer_in(pair: ControllerPair, names: Names) -> Mapping[tuple[bool, bool], list[str]]:
    """What is tracked, by whether `a` has the smaller rms error on more flights over the whole flight, and in settled
    stretches: of errors that the campaign counts in both ways."""
    rms = {
        (metric.of, metric.settled): name
        for name, metric in names.metrics.items()
        if metric.statistic == Statistic.RMS
        and metric.start == 0.0
        and metric.end == inf
        and name in pair.metrics
    }
    found: dict[tuple[bool, bool], list[str]] = {}
    for of, settled in rms:
        if settled and (of, False) in rms:
            whole, rest = (
                each.a_better > each.b_better
                for each in (pair.metrics[rms[of, s]] for s in (False, True))
            )
            word = names.metrics[rms[of, False]].phrase.removeprefix("rms ").removesuffix(" error")
            found.setdefault((whole, rest), []).append(word)
    return found


def _counts(pair: ControllerPair, metric: str, names: Names) -> str:
    """' (closer on 83 %, further on 17 %; worst 0.2 and 0.9 deg)', what was tested first."""
    entry = pair.metrics[metric]
    shares = [("closer", entry.a_better), ("further", entry.b_better)]
    words = [f"{word} on {percent(count / pair.pairs, 2)}" for word, count in shares]
    words += [f"equal on {percent(entry.ties / pair.pairs, 2)}"] if entry.ties else []
    unit = names.metrics[metric].unit.removeprefix("-")
    return f" ({', '.join(words)}; worst {' and '.join(map(significant, entry.worst))} {unit})".replace(
        " )", ")"
    )


def _contradiction(pair: ControllerPair, entry: ComparedMetric, names: Names) -> str:
    """Why the controller that is closer on more flights is no winner."""
    *wins, values = entry.better_at
    if values > 1 and any(wins):
        sides = zip((pair.a, pair.b), wins, strict=True)
        held = [f"{names.label(side)} at {count}" for side, count in sides if count]
        return f"better on more flights: {joined(held)} of the {values} values of the unknowns"
    closer = names.label(entry.closer) if entry.closer else "one"
    reasons = [f"a worse {100.0 * level:.4g} % quantile" for level in entry.worse_tails[:1]]
    reasons += ["more flights lost"] if entry.loses_more else []
    return f"{closer} is closer on more flights but has {joined(reasons)}"


def verdict_of(pair: ControllerPair, names: Names) -> str:
    """How the first of a pair stands: 'better', 'worse', 'mixed' or 'open'; lost flights, where they tell, lead."""
    if pair.losing:
        return "worse" if pair.losing == "a" else "better"
    found = standing(pair, names)
    if found["mixed"] or (found["better"] and found["worse"]):
        return "mixed"
    return next((side for side in ("better", "worse") if found[side]), "open")


def by_strength(found: Comparison, names: Names) -> list[ControllerPair]:
    """The pairs, the rival first against which the first controller stands worst; of equals the one that fails less."""
    order = ("worse", "mixed", "open", "better")

    def strength(pair: ControllerPair) -> tuple[int, int, int]:
        held = standing(pair, names)
        failed = sum(each.both + each.only_b for each in pair.requirements)
        return (
            order.index(verdict_of(pair, names)),
            len(held["better"]) - len(held["worse"]),
            failed,
        )

    return sorted(found.pairs.values(), key=strength)


def _pair_sentences(found: Comparison, names: Names) -> list[str]:
    """Against each rival, the strongest first; the first sentence begins with the answer over all rivals."""
    pairs = [pair for pair in by_strength(found, names) if any(standing(pair, names).values())]
    if not pairs:
        return []
    if not names.campaign.judged:
        return [f"No winner is named: {names.campaign.dependence}."]
    verdicts = {verdict_of(pair, names) for pair in pairs}
    name = names.label(pairs[0].a)
    overall = {
        "better": f"{name} is better: ",
        "worse": f"{name} is worse: ",
        "open": "No difference is shown: ",
    }
    sentences = [
        f"against {names.label(pair.b)}, on the same {fixed(pair.pairs, 0)} flights, {pair_words(pair, names)}."
        for pair in pairs
    ]
    head = overall.get(verdicts.pop(), "Mixed: ") if len(verdicts) == 1 else "Mixed: "
    return [f"{head}{sentences[0]}", *(f"{text[0].upper()}{text[1:]}" for text in sentences[1:])]


def pair_words(pair: ControllerPair, names: Names) -> str:
    """'TLC is better on more flights in ...; it is worse ... in ...; undecided in ...; TLC uses ...'."""
    found, first = standing(pair, names, full=True), names.label(pair.a)
    words = {
        "better": "it is better on more flights in",
        "worse": "it is worse on more flights in",
        "mixed": "undecided in",
        "open": "no difference is shown in",
    }
    parts = [f"{words[side]} {joined(found[side])}" for side in words if found[side]]
    text = "; ".join(parts).replace("it is", f"{first} is", 1)
    return f"{text}{_tails_words(pair, names)}{_usage_words(pair, first)}"


def _tails_words(pair: ControllerPair, names: Names) -> str:
    """'; tails not compared ...' where the flights are too few to compare the tails of an error with a winner."""
    won = [entry for entry in asked_of(pair, names).values() if entry.winner]
    levels = sorted({level for entry in won for level in entry.uncompared_tails})
    shown = joined([f"{100.0 * level:.4g} %" for level in levels])
    return f"; tails not compared at {shown} (too few flights)" if levels else ""


def _usage_words(pair: ControllerPair, first: str) -> str:
    """'; TLC uses 1.2 times the aileron, as much rudder and 0.3 times the elevator', from the medians of the ratios."""
    parts = []
    for metric, ratio in pair.surfaces.items():
        if ratio is None:
            continue
        surface = metric.split("_", 1)[0]
        value = ratio.value
        if abs(value - 1.0) < 0.01:
            parts.append(f"as much {surface}")
        elif abs(value - 1.0) < 0.2:
            parts.append(
                f"{percent(abs(value - 1.0), 2)} {'more' if value > 1.0 else 'less'} {surface}"
            )
        else:
            parts.append(f"{significant(value, 2)} times the {surface}")
    return f"; {first} uses {joined(parts)} (rms, median of the flights' ratios)" if parts else ""


def survival_sentences(comparison: Comparison, names: Names) -> list[str]:
    """Which controller of each pair loses fewer flights, as far as the flights show it."""
    sentences: list[str] = []
    open_: dict[str, str] = {}  # rival -> the sentence that no difference is shown
    for pair in comparison.pairs.values():
        found, a, b = pair.ended_early, names.label(pair.a), names.label(pair.b)
        alone = found.only_a, found.only_b
        if not any(alone):
            continue
        lost = [fixed(found.both + count, 0) for count in alone]
        rest = (
            f"{lost[0]} of {fixed(pair.pairs, 0)} ended early against {lost[1]} ({fixed(alone[0], 0)} under "
            f"{a} alone, {fixed(alone[1], 0)} under {b} alone; the chance of such a split were both as good: "
            f"{p_value(found.p_value)})."
        )
        if pair.losing:
            sentences.append(
                f"{a} loses {'more' if pair.losing == 'a' else 'fewer'} flights than {b}: {rest}"
            )
        else:
            open_[b] = f"No difference is shown between {a} and {b} in lost flights: {rest}"
    if len(open_) > _OPEN:
        first = names.label(next(iter(names.controllers)))
        return [
            *sentences,
            f"No difference in lost flights is shown between {first} and {joined(list(open_))}.",
        ]
    return [*sentences, *open_.values()]
