"""Why errors vary, in sentences: what moves each controller's errors most, by ranks."""

from collections.abc import Mapping
from typing import Any

from abhv_mc.report.numbers.drivers import otherwise_words
from abhv_mc.topics.parameter_words import spoken_name
from abhv_mc.topics.words import joined

_NAMED = 2  # drivers of an error
_MOVED = 2  # controllers whose drivers are told


def driver_sentences(numbers: Mapping[str, Any]) -> list[str]:
    """What moves the errors of the first controllers most."""
    return [*filter(None, (_driver_sentence(numbers, name) for name in numbers["campaign"]["controllers"][:_MOVED]))]


def _driver_sentence(numbers: Mapping[str, Any], name: str) -> str:
    """What moves each headline error of a controller most, by rank correlation."""
    phrases = {metric: entry["phrase"] for metric, entry in numbers["metrics"].items()}
    ranks = numbers["drivers"].get("controllers", {}).get(name, {}).get("metrics", {})
    parts, none = [], []
    for metric in numbers["asked"]:
        found = [e["parameter"] for e in ranks.get(metric, {}).get("parameters", []) if e["driver"]]
        words = [spoken_name(parameter) for parameter in dict.fromkeys(found)][:_NAMED]
        words = words or otherwise_words(ranks.get(metric, {}).get("otherwise", []))[:_NAMED]
        if words:
            parts.append(f"{phrases[metric]}: {joined(words)}")
        elif metric in ranks:
            none.append(phrases[metric])
    parts += [f"no single parameter moves {joined(none)}"] if none else []
    return f"What moves the errors of {numbers['campaign']['labels'][name]} most: {'; '.join(parts)}." if parts else ""
