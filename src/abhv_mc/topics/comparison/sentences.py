"""Sentences that compare controllers by early terminations and by metrics."""

from collections.abc import Mapping, Sequence
from math import inf

from abhv_mc.io.phrases import counted, joined
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.topics.comparison.model import ComparedMetric, Comparison, ControllerPair
from abhv_mc.topics.formatting import fixed, p_equation, percent, significant
from abhv_mc.topics.names import Names

# maximum number of sentences on rivals whose early terminations do not differ significantly
_OPEN = 2


def comparison_sentences(comparison: Comparison, names: Names) -> Sequence[str]:
    """Return sentences on early terminations, then on each rival of the first controller."""
    return [*survival_sentences(comparison, names), *_pair_sentences(comparison, names)]


def standing(pair: ControllerPair, names: Names, full: bool = False) -> Mapping[str, list[str]]:
    """Group the metrics by the result for `pair.a`: better, worse, mixed or undecided.

    If ``full``, each metric is followed by shares of flights, or by the reason for mixed results.
    """
    standings: dict[str, list[str]] = {"better": [], "worse": [], "mixed": [], "open": []}
    for metric, entry in asked_of(pair, names).items():
        won = "open" if entry.winner is None else "better" if entry.winner == pair.a else "worse"
        phrase = names.metrics[metric].phrase
        if entry.mixed:
            won = "mixed"
            phrase += f" ({_contradiction(pair, entry, names)})" if full else ""
        elif full and won != "open":
            phrase += _counts(pair, metric, names)
        standings[won].append(phrase)
    return standings


def asked_of(pair: ControllerPair, names: Names) -> Mapping[str, ComparedMetric]:
    """Return the comparisons of two controllers in the leading metrics."""
    return {metric: pair.metrics[metric] for metric in names.asked if metric in pair.metrics}


def closer_in(pair: ControllerPair, names: Names) -> Mapping[tuple[bool, bool], list[str]]:
    """Group tracked quantities by whether `a` has the smaller rms error on more flights.

    Each key contains two flags: one for the rms error over the whole flight, and one for the rms
    error outside the transients. Quantities without both metrics are omitted.
    """
    rms = {
        (metric.of, metric.settled): name
        for name, metric in names.metrics.items()
        if metric.statistic == Statistic.RMS
        and metric.start == 0.0
        and metric.end == inf
        and name in pair.metrics
    }
    quantities: dict[tuple[bool, bool], list[str]] = {}
    for quantity, settled in rms:
        if settled and (quantity, False) in rms:
            overall, outside_transients = (
                entry.a_better > entry.b_better
                for entry in (pair.metrics[rms[quantity, s]] for s in (False, True))
            )
            word = (
                names.metrics[rms[quantity, False]]
                .phrase.removeprefix("rms ")
                .removesuffix(" error")
            )
            quantities.setdefault((overall, outside_transients), []).append(word)
    return quantities


def _counts(pair: ControllerPair, metric: str, names: Names) -> str:
    """Return text like ' (better on 83 %, worse on 17 %; worst flight 0.2 against 0.9 deg)'."""
    entry = pair.metrics[metric]
    shares = [("better", entry.a_better), ("worse", entry.b_better)]
    phrases = [f"{word} on {percent(count / pair.pairs, 2)}" for word, count in shares]
    phrases += [f"equal on {percent(entry.ties / pair.pairs, 2)}"] if entry.ties else []
    unit = names.metrics[metric].unit.removeprefix("-")
    return (
        f" ({', '.join(phrases)}; worst flight {' against '.join(map(significant, entry.worst))} "
        f"{unit})".replace(" )", ")")
    )


def _contradiction(pair: ControllerPair, entry: ComparedMetric, names: Names) -> str:
    """Explain why the controller with the smaller value on more flights is not the winner."""
    *wins, values = entry.better_at
    if values > 1 and any(wins):
        sides = zip((pair.a, pair.b), wins, strict=True)
        win_counts = [f"{names.subject(side)} at {count}" for side, count in sides if count]
        return (
            "better on more flights at different values of the unknowns: "
            f"{joined(win_counts)} of the {values} values"
        )
    better = names.subject(entry.closer) if entry.closer else "one"
    reasons = [f"a worse {100.0 * level:.4g} % quantile" for level in entry.worse_tails[:1]]
    reasons += ["more early terminations"] if entry.loses_more else []
    return f"{better} is better on more flights but has {joined(reasons)}"


def verdict_of(pair: ControllerPair, names: Names) -> str:
    """Return 'better', 'worse', 'mixed' or 'open' for the first controller of a pair.

    A significant difference in early terminations takes precedence over the metrics.
    """
    if pair.losing:
        return "worse" if pair.losing == "a" else "better"
    standings = standing(pair, names)
    if standings["mixed"] or (standings["better"] and standings["worse"]):
        return "mixed"
    return next((side for side in ("better", "worse") if standings[side]), "open")


def by_strength(comparison: Comparison, names: Names) -> list[ControllerPair]:
    """Return the pairs of controllers, sorted so that the strongest rival is first.

    Equally strong rivals are sorted by their number of failures, smallest first.
    """
    order = ("worse", "mixed", "open", "better")

    def strength(pair: ControllerPair) -> tuple[int, int, int]:
        standings = standing(pair, names)
        failed = sum(failures.both + failures.only_b for failures in pair.requirements)
        return (
            order.index(verdict_of(pair, names)),
            len(standings["better"]) - len(standings["worse"]),
            failed,
        )

    return sorted(comparison.pairs.values(), key=strength)


def _pair_sentences(comparison: Comparison, names: Names) -> list[str]:
    """Return a sentence per rival, strongest first; the first sentence is the main result."""
    pairs = [pair for pair in by_strength(comparison, names) if any(standing(pair, names).values())]
    if not pairs:
        return []
    if not names.campaign.judged:
        return [f"No winner is named: {names.campaign.dependence}."]
    verdicts = {verdict_of(pair, names) for pair in pairs}
    name = names.subject(pairs[0].a)
    overall = {
        "better": f"{name} is better: ",
        "worse": f"{name} is worse: ",
        "open": "No difference is shown: ",
    }
    sentences = [
        f"against {names.subject(pair.b)}, on the same {counted(pair.pairs, 'flight')}, "
        f"{pair_words(pair, names)}."
        for pair in pairs
    ]
    head = overall.get(verdicts.pop(), "Mixed: ") if len(verdicts) == 1 else "Mixed: "
    return [f"{head}{sentences[0]}", *(f"{text[0].upper()}{text[1:]}" for text in sentences[1:])]


def pair_words(pair: ControllerPair, names: Names) -> str:
    """Describe the comparison of two controllers in a few clauses.

    An example is 'TLC is better on more flights in speed error; TLC uses as much rudder'.
    """
    standings, first = standing(pair, names, full=True), names.subject(pair.a)
    openings = {
        "better": "it is better on more flights in",
        "worse": "it is worse on more flights in",
        "mixed": "the result is undecided in",
        "open": "no difference is shown in",
    }
    parts = [f"{openings[side]} {joined(standings[side])}" for side in openings if standings[side]]
    text = "; ".join(parts).replace("it is", f"{first} is", 1)
    return f"{text}{_tails_words(pair, names)}{_usage_words(pair, first)}"


def _tails_words(pair: ControllerPair, names: Names) -> str:
    """Return a clause that names the quantiles with too few flights to compare, or ''."""
    won = [entry for entry in asked_of(pair, names).values() if entry.winner]
    levels = sorted({level for entry in won for level in entry.uncompared_tails})
    level_list = joined([f"{100.0 * level:.4g} %" for level in levels])
    return f"; the {level_list} quantiles are not compared (too few flights)" if levels else ""


def _usage_words(pair: ControllerPair, first: str) -> str:
    """Describe the median ratios of control effort in a clause.

    An example is '; TLC uses 1.2 times the aileron and as much rudder'.
    """
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
    return f"; {first} uses {joined(parts)} (median ratio of the rms deflections)" if parts else ""


def survival_sentences(comparison: Comparison, names: Names) -> list[str]:
    """Return sentences on differences in the number of early terminations."""
    sentences: list[str] = []
    open_: dict[str, str] = {}  # rival -> sentence for a difference that is not significant
    for pair in comparison.pairs.values():
        failures, a, b = pair.ended_early, names.subject(pair.a), names.subject(pair.b)
        alone = failures.only_a, failures.only_b
        if not any(alone):
            continue
        lost = [fixed(failures.both + count, 0) for count in alone]
        counts_text = (
            f"{lost[0]} of {counted(pair.pairs, 'flight')}, compared with {lost[1]} "
            f"({fixed(alone[0], 0)} with {a} only, {fixed(alone[1], 0)} with {b} only; McNemar's "
            f"test, {p_equation(failures.p_value)})."
        )
        if pair.losing:
            sentences.append(
                f"{a} has {'more' if pair.losing == 'a' else 'fewer'} early terminations than {b}: "
                f"{counts_text}"
            )
        else:
            open_[b] = (
                f"No difference in early terminations is shown between {a} and {b}: {counts_text}"
            )
    if len(open_) > _OPEN:
        first = names.subject(next(iter(names.controllers)))
        return [
            *sentences,
            f"No difference in early terminations is shown between {first} and "
            f"{joined(list(open_))}.",
        ]
    return [*sentences, *open_.values()]
