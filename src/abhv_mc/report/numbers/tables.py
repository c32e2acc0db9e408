"""The page's tables as rows of text: numbers to the digits that their Monte Carlo error allows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from abhv_mc.topics.labels import controller_label
from abhv_mc.topics.parameter_words import parameter_doc, shown_value, spoken_name
from abhv_mc.topics.words import bounds, count_of, estimate, fixed, p_value, percent, significant

GROUPS = {
    "asked": "What is asked",
    "tracking": "Tracking errors",
    "usage": "Control usage",
    "loads": "Loads and validity",
    "stability": "Stability margins",
    "user": "Metrics of this campaign",
}
_BOUGHT = ("less_error_less", "less_error_more", "more_error_less", "more_error_more")
_LEVELS = ("q50", "q95", "q99.73")
_PARAMETER_WORDS: dict[str, Callable[[str], str]] = {"parameter": str, "spoken": spoken_name, "doc": parameter_doc}
Row = dict[str, Any]

WORST_COLUMNS = 5  # metrics beside each of the worst flights


def _cell(interval: Mapping[str, Any] | None) -> dict[str, str]:
    if interval is None or interval["value"] is None:
        return {"value": "not reached" if interval else "", "bounds": ""}
    return {"value": estimate(interval), "bounds": bounds(interval)}


def _interval(ends: Sequence[float]) -> dict[str, float]:
    return dict(zip(("value", "low", "high"), ends, strict=True))


def _pair_of(numbers: Mapping[str, Any], first: str, other: str) -> Mapping[str, Any] | None:
    found: Mapping[str, Any] | None = numbers["paired"].get(f"{first} - {other}")
    return found


def headline_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """Medians and paired differences of what the first screen compares: errors first, then usage."""
    rows = []
    controllers = numbers["campaign"]["controllers"]
    for metric in numbers["compared"]:
        words = numbers["metrics"][metric]
        table = words["controllers"]
        differences = []
        for other in controllers[1:]:
            pair = _pair_of(numbers, controllers[0], other)
            if pair is None:
                continue
            found = pair["metrics"][metric]
            differences.append(
                {
                    **_cell(found["median_difference"]),
                    "winner": _winner(found),
                    "better": count_of(found["a_better"], pair["pairs"]),
                }
            )
        rows.append(
            {
                "label": words["label_with_unit"],
                "group": "" if metric in numbers["asked"] else words["group"],
                "medians": [_cell(table[name]["q50"]) for name in controllers],
                "differences": differences,
            }
        )
    return rows


def _winner(found: Mapping[str, Any]) -> str:
    if found["mixed"]:
        return "mixed"
    return controller_label(found["winner"]) if found["winner"] else "neither"


def metric_groups(numbers: Mapping[str, Any]) -> Iterator[Row]:
    """Every metric of every controller: what is asked, then by group; settled ones where they say something else."""
    controllers = numbers["campaign"]["controllers"]
    for group, title in GROUPS.items():
        entries = []
        for metric, table in numbers["metrics"].items():
            own = "asked" if metric in numbers["asked"] else table["group"]
            if own != group or (group != "asked" and table["same_as"]):
                continue
            lines = []
            for name in controllers:
                cell = table["controllers"][name]
                pair = _pair_of(numbers, controllers[0], name)
                found = pair["metrics"][metric] if pair else None
                lines.append(
                    {
                        "controller": controller_label(name),
                        "levels": [_cell(cell[level]) for level in _LEVELS],
                        "worst": significant(cell["worst"], 4),
                        "flight": cell["worst_flight"],
                        "difference": _cell(found["median_difference"]) if found else None,
                        "better": count_of(found["a_better"], pair["pairs"]) if found and pair else "",
                    }
                )
            low = table["bad"] == "low"
            entries.append({"label": table["label_with_unit"], "doc": table["doc"], "low": low, "lines": lines})
        if entries:
            yield {"title": title, "name": group, "entries": entries}


def pair_tables(numbers: Mapping[str, Any], requirements: Sequence[str]) -> list[Row]:
    """Quantile differences, failures of only one, error against usage, and what pairing saved."""
    tables = []
    for pair in numbers["paired"].values():
        a, b = controller_label(pair["a"]), controller_label(pair["b"])
        quantiles = []
        for metric in numbers["compared"]:
            if metric in pair["metrics"]:
                found = pair["metrics"][metric]
                gain = found["pairing_gain"]
                quantiles.append(
                    {
                        "label": numbers["metrics"][metric]["label_with_unit"],
                        "levels": [_cell(found[level]) for level in _LEVELS],
                        "saved": f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none",
                    }
                )
        failures = [_failure_row(words, found) for words, found in zip(requirements, pair["requirements"], strict=True)]
        failures.append(_failure_row("Reached the end of the mission", pair["ended_early"]))
        usage = [
            {
                "label": numbers["metrics"][metric]["label"],
                "error": _cell(found["error_ratio"]),
                "usage": _cell(found["usage_ratio"]),
                "shares": [percent(found[f"{kind}_usage"] / found["pairs"], 2) for kind in _BOUGHT],
            }
            for metric, found in pair["usage"].items()
            if found
        ]
        tables.append(
            {"a": a, "b": b, "pairs": pair["pairs"], "quantiles": quantiles, "failures": failures, "usage": usage}
        )  # fmt: skip
    return tables


def _failure_row(label: str, found: Mapping[str, Any]) -> Row:
    def flights(key: str) -> str:
        listed = found[f"flights_only_{key}"]
        more = "" if found[f"only_{key}"] == len(listed) else ", \N{HORIZONTAL ELLIPSIS}"
        return ", ".join(map(str, listed)) + more if listed else "\N{EM DASH}"

    return {
        "label": label,
        **{key: found[key] for key in ("both", "only_a", "only_b", "neither")},
        "p": p_value(found["p_value"]),
        "flights_a": flights("a"),
        "flights_b": flights("b"),
    }


def _dispersion_words(entry: Mapping[str, Any]) -> str:
    """'lift +8.1 % (1.6 sigma)'."""
    sigma = "" if entry["sigma"] is None else f" ({fixed(entry['sigma'], 1)} sigma)"
    return f"{spoken_name(entry['parameter'])} {shown_value(entry['parameter'], entry['value'])}{sigma}"


def worst_tables(numbers: Mapping[str, Any], folder: str) -> list[Row]:
    """The worst flights of each controller, each with the command that replays it."""
    tables = []
    for name, flights in numbers["worst"].items():
        rows = [
            {
                "flight": entry["flight"],
                "outcome": entry["outcome"].replace("_", " "),
                "by": numbers["metrics"][entry["by"]]["label"] if entry["by"] else "",
                "beyond": significant(entry["beyond"], 3),
                "values": [significant(entry["metrics"].get(m), 6) for m in numbers["asked"][:WORST_COLUMNS]],
                "samples": ", ".join(_dispersion_words(dispersion) for dispersion in entry["largest"]),
            }
            for entry in flights
        ]
        command = f"abhv-mc replay {folder} --controller {name} --flight NUMBER"
        tables.append({"name": name, "controller": controller_label(name), "rows": rows, "command": command})
    return tables
