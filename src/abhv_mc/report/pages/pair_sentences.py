"""Sentences that compare two campaigns, until their pages print records."""

from collections.abc import Mapping

from abhv_mc.io.phrases import joined
from abhv_mc.topics.comparison.model import ComparedMetric, ControllerPair
from abhv_mc.topics.formatting import percent, significant
from abhv_mc.topics.names import Names


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
        return "worse" if pair.losing == pair.a else "better"
    standings = standing(pair, names)
    if standings["mixed"] or (standings["better"] and standings["worse"]):
        return "mixed"
    return next((side for side in ("better", "worse") if standings[side]), "open")


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


def shorten_list(items: list[str], separator: str = ", ") -> str:
    """Return 'a, b and c', or 'a, b and 2 more' for longer lists.

    A separator such as '; ' suits items that contain commas, as in 'a; b; and 2 more'.
    """
    more = [f"{len(items) - 2} more"] if len(items) > 4 else []
    listed = items[:2] if more else items
    if separator == ", ":
        return joined([*listed, *more])
    return separator.join([*listed, *(f"and {text}" for text in more)])
