"""Why errors vary, in sentences: what moves each controller's errors most, by Sobol's indices or by ranks."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any

from abhv_mc.report.numbers.drivers import otherwise_words
from abhv_mc.topics.parameter_words import spoken_name
from abhv_mc.topics.words import joined, percent

_NAMED = 2  # drivers of an error
_MOVED = 2  # controllers whose drivers are told
_LEAST_SHARE = 0.05  # of the variance, by the lower end of the total index
_SURE = 0.5  # of a total index: half an interval up to which it is told


def driver_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """What moves the errors most, of all controllers and of the first ones; and who has no indices."""
    labels = numbers["campaign"]["labels"]
    sentences = [_first_sentence(numbers)]
    sentences += [_driver_sentence(numbers, name) for name in numbers["campaign"]["controllers"][:_MOVED]]
    for name, part in numbers["sobol"].get("controllers", {}).items():
        if part["refused"]:
            sentences.append(f"{labels[name]} has no Sobol indices: {part['refused']}.")
    return [*filter(None, sentences)]


def _driver_sentence(numbers: Mapping[str, Any], name: str) -> str:
    """What moves each headline error of a controller most, by Sobol's total index or by rank correlation."""
    labels = numbers["campaign"]["labels"]
    phrases = {metric: entry["phrase"] for metric, entry in numbers["metrics"].items()}
    sobol = numbers["sobol"].get("controllers", {}).get(name, {}).get("metrics", {})
    ranks = numbers["drivers"].get("controllers", {}).get(name, {}).get("metrics", {})
    parts, widths = [], [0.0]
    none: list[str] = []
    unsure: list[str] = []
    for metric in numbers["asked"]:
        if metric in sobol:
            top = [e for e in sobol[metric] if e["total"][1] > _LEAST_SHARE][:_NAMED]
            sure = [e for e in top if _half(e) <= max(_SURE * e["total"][0], _LEAST_SHARE)]
            unsure += [phrases[metric]] if top and not sure else []
            widths += [_half(e) for e in sure]
            words = [f"{spoken_name(e['parameter'])} ({_share(e, 'total')}, {_share(e, 'first')} alone)" for e in sure]
        else:
            found = [e["parameter"] for e in ranks.get(metric, {}).get("parameters", []) if e["driver"]]
            words = [spoken_name(parameter) for parameter in dict.fromkeys(found)][:_NAMED]
            words = words or otherwise_words(ranks.get(metric, {}).get("otherwise", []))[:_NAMED]
            if not words and metric in ranks:
                none.append(phrases[metric])
        if words:
            parts.append(f"{phrases[metric]}: {joined(words)}")
    told = bool(parts)
    parts += [f"no single parameter moves {joined(none)}"] if none else []
    parts += [f"too few flights to share out {joined(unsure)}"] if unsure else []
    if not parts:
        return ""
    how = ""
    if sobol and told:
        how = f" (share of the variance that involves them, within {percent(round(max(widths), 2), 2)} or closer)"
    return f"What moves the errors of {labels[name]} most{how}: {'; '.join(parts)}."


def _first_sentence(numbers: Mapping[str, Any]) -> str:
    """In which errors the parameter with the largest total index is the same for all controllers, and where not."""
    found = {n: part["metrics"] for n, part in numbers["sobol"].get("controllers", {}).items() if part["metrics"]}
    labels = numbers["campaign"]["labels"]
    phrases = {metric: entry["phrase"] for metric, entry in numbers["metrics"].items()}
    same, apart, untold = [], [], []
    for metric in numbers["asked"] if len(found) > 1 else ():
        if any(metric not in part for part in found.values()):
            continue
        first = {name: spoken_name(part[metric][0]["parameter"]) for name, part in found.items()}
        if not all(_leads(part[metric]) for part in found.values()):
            untold.append(phrases[metric])
        elif len(set(first.values())) == 1:
            same.append(f"{phrases[metric]} ({next(iter(first.values()))})")
        else:
            each = [f"{word} for {labels[name]}" for name, word in first.items()]
            apart.append(f"{phrases[metric]} ({', '.join(each)})")
    parts = [f"the same in {joined(same)}"] if same else []
    parts += [f"it differs in {joined(apart)}"] if apart else []
    if untold:
        parts.append(f"{'it is ' if parts else ''}open in {joined(untold)} (no parameter leads by more than the noise)")
    who = joined([labels[name] for name in found])
    return f"What spreads an error most is for {who} {'; '.join(parts)}." if parts else ""


def _leads(indices: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the first total index is larger than the second one by more than the noise of both."""
    return len(indices) < 2 or indices[0]["total"][0] - indices[1]["total"][0] > hypot(*map(_half, indices[:2]))


def _half(entry: Mapping[str, Any]) -> float:
    """Half the width of the wider interval of a parameter's two indices."""
    return max((entry[kind][2] - entry[kind][1]) / 2.0 for kind in ("first", "total"))


def _share(entry: Mapping[str, Any], kind: str) -> str:
    """A Sobol index in percent; noise may take the estimate past the ends, and what acts alone past the total."""
    return percent(min(max(round(min(entry[kind][0], entry["total"][0]), 2), 0.0), 1.0), 2)
