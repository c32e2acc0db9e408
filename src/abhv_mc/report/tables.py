"""The page's tables as rows of text: numbers to the digits that their Monte Carlo error allows."""

from collections.abc import Iterator, Mapping
from typing import Any

from abhv_mc.report.metrics import FOLLOWING, HOLDING, METRIC_WORDS, USAGE, MetricWords, controller_label, words_of
from abhv_mc.report.parameters import parameter_doc, shown_value, spoken_name
from abhv_mc.report.words import bounds, count_of, estimate, p_value, percent, significant

GROUPS = {
    "tracking": "Tracking errors",
    "usage": "Control usage",
    "loads": "Loads and validity",
}
_LEVELS = ("q50", "q95", "q99.73")
Row = dict[str, Any]


def words(metric: str) -> MetricWords:
    """The words of a metric, known or not."""
    return METRIC_WORDS.get(metric) or words_of(metric)


def _cell(interval: Mapping[str, Any] | None) -> dict[str, str]:
    if interval is None or interval["value"] is None:
        return {"value": "not reached" if interval else "", "bounds": ""}
    return {"value": estimate(interval), "bounds": bounds(interval)}


def _duel_of(numbers: Mapping[str, Any], first: str, other: str) -> Mapping[str, Any] | None:
    found: Mapping[str, Any] | None = numbers["duels"].get(f"{first} - {other}")
    return found


def verdict_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """One row a requirement: its words and every controller's verdict."""
    rows = []
    for entry in numbers["requirements"]:
        cells = []
        for name, verdict in entry["controllers"].items():
            cells.append(
                {
                    "controller": controller_label(name),
                    "binds": name in entry["binds"],
                    "status": verdict["status"],
                    "failures": count_of(verdict["failures"], verdict["runs"]),
                    "lower_bound": percent(verdict["lower_bound"]),
                    "consumer_risk": percent(verdict["consumer_risk"]),
                    "producer_risk": percent(verdict["producer_risk"]),
                    "needed": _needed(verdict),
                    "ended_early": verdict["ended_early"],
                }
            )
        rows.append(
            {
                "words": entry["words"],
                "share": percent(entry["probability"]),
                "risk": percent(entry["consumer_risk"]),
                "cells": cells,
            }
        )
    return rows


def _needed(verdict: Mapping[str, Any]) -> str:
    if verdict["flights_needed"] is None:
        return "\N{EM DASH}"
    return (
        "none"
        if verdict["flights_needed"] == 0
        else f"{verdict['flights_needed']:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    )


def headline_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """Medians and paired differences of what the first screen compares: errors first, then usage."""
    rows = []
    controllers = numbers["campaign"]["controllers"]
    for metric in (*FOLLOWING, *HOLDING, *USAGE):
        if metric not in numbers["metrics"]:
            continue
        table = numbers["metrics"][metric]["controllers"]
        differences = []
        for other in controllers[1:]:
            duel = _duel_of(numbers, controllers[0], other)
            if duel is None:
                continue
            found = duel["metrics"][metric]
            differences.append(
                {
                    **_cell(found["median_difference"]),
                    "winner": _winner(found),
                    "better": count_of(found["a_better"], duel["pairs"]),
                }
            )
        rows.append(
            {
                "label": words(metric).label_with_unit,
                "group": words(metric).group,
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
    """Every metric of every controller, by group."""
    controllers = numbers["campaign"]["controllers"]
    for group, title in GROUPS.items():
        entries = []
        for metric, table in numbers["metrics"].items():
            if words(metric).group != group:
                continue
            lines = []
            for name in controllers:
                cell = table["controllers"][name]
                duel = _duel_of(numbers, controllers[0], name)
                found = duel["metrics"][metric] if duel else None
                lines.append(
                    {
                        "controller": controller_label(name),
                        "levels": [_cell(cell[level]) for level in _LEVELS],
                        "worst": significant(cell["worst"], 4),
                        "flight": cell["worst_flight"],
                        "difference": _cell(found["median_difference"]) if found else None,
                        "better": count_of(found["a_better"], duel["pairs"]) if found and duel else "",
                    }
                )
            low = table["sense"] == "low"
            entries.append(
                {"label": words(metric).label_with_unit, "doc": words(metric).doc, "low": low, "lines": lines}
            )
        if entries:
            yield {"title": title, "name": group, "entries": entries}


def duel_tables(numbers: Mapping[str, Any]) -> list[Row]:
    """Quantile differences, failures of only one, error against usage, and what pairing saved."""
    tables = []
    for duel in numbers["duels"].values():
        a, b = controller_label(duel["a"]), controller_label(duel["b"])
        quantiles = []
        for metric in (*FOLLOWING, *HOLDING, *USAGE):
            if metric in duel["metrics"]:
                found = duel["metrics"][metric]
                gain = found["pairing_gain"]
                quantiles.append(
                    {
                        "label": words(metric).label_with_unit,
                        "levels": [_cell(found[level]) for level in _LEVELS],
                        "saved": f"{significant(gain, 2)} times" if gain and gain >= 1.05 else "none",
                    }
                )
        failures = [
            _failure_row(entry["words"], found)
            for entry, found in zip(numbers["requirements"], duel["requirements"], strict=True)
        ]
        failures.append(_failure_row("Reached the end of the mission", duel["ended_early"]))
        usage = [
            {
                "label": words(metric).label,
                "error": _cell(found["error_ratio"]),
                "usage": _cell(found["usage_ratio"]),
                "both": percent(found["less_error_less_usage"] / found["pairs"], 2),
                "bought": percent(found["less_error_more_usage"] / found["pairs"], 2),
                "saved": percent(found["more_error_less_usage"] / found["pairs"], 2),
                "neither": percent(found["more_error_more_usage"] / found["pairs"], 2),
            }
            for metric, found in duel["usage"].items()
            if found
        ]
        tables.append(
            {"a": a, "b": b, "pairs": duel["pairs"], "quantiles": quantiles, "failures": failures, "usage": usage}
        )  # fmt: skip
    return tables


def _failure_row(label: str, found: Mapping[str, Any]) -> Row:
    def flights(key: str) -> str:
        listed = found[f"flights_only_{key}"]
        more = "" if found[f"only_{key}"] == len(listed) else ", \N{HORIZONTAL ELLIPSIS}"
        return ", ".join(map(str, listed)) + more if listed else "\N{EM DASH}"

    return {
        "label": label,
        "both": found["both"],
        "only_a": found["only_a"],
        "only_b": found["only_b"],
        "neither": found["neither"],
        "p": p_value(found["p_value"]),
        "flights_a": flights("a"),
        "flights_b": flights("b"),
    }


def driver_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """For each controller and headline metric, what drives it."""
    rows = []
    for name, part in numbers["drivers"].get("controllers", {}).items():
        for metric in (*FOLLOWING, *HOLDING):
            if metric not in part["metrics"]:
                continue
            table = part["metrics"][metric]
            found = [entry for entry in table["parameters"] if entry["driver"]]
            rows.append(
                {
                    "controller": controller_label(name),
                    "label": words(metric).label,
                    "explained": percent(table["explained"], 2),
                    "drivers": [
                        {
                            "parameter": entry["parameter"],
                            "either_way": entry["either_way"],
                            "doc": parameter_doc(entry["parameter"]),
                            "srrc": _cell(dict(zip(("value", "low", "high"), entry["srrc"], strict=True))),
                            "prcc": _cell(dict(zip(("value", "low", "high"), entry["prcc"], strict=True))),
                        }
                        for entry in found[:4]
                    ],
                }
            )
    return rows


def sobol_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """For each controller and headline metric, its indices, or why there are none."""
    rows = []
    for name, part in numbers["sobol"].get("controllers", {}).items():
        if part["refused"]:
            rows.append({"controller": controller_label(name), "refused": part["refused"], "label": "", "indices": []})
        for metric in (*FOLLOWING, *HOLDING):
            if metric in part["metrics"]:
                indices = [
                    {"parameter": entry["parameter"], "doc": parameter_doc(entry["parameter"])}
                    | {
                        kind: _cell(dict(zip(("value", "low", "high"), entry[kind], strict=True)))
                        for kind in ("first", "total")
                    }
                    for entry in part["metrics"][metric][:4]
                ]
                label = words(metric).label
                rows.append({"controller": controller_label(name), "refused": None, "label": label, "indices": indices})
    return rows


def worst_tables(numbers: Mapping[str, Any], folder: str) -> list[Row]:
    """The worst flights of each controller, each with the command that replays it."""
    tables = []
    for name, flights in numbers["worst"].items():
        rows = []
        for entry in flights:
            rows.append(
                {
                    "flight": entry["flight"],
                    "outcome": entry["outcome"].replace("_", " "),
                    "by": words(entry["by"]).label if entry["by"] else "",
                    "share": percent(entry["share"], 2) if entry["share"] is not None else "\N{EM DASH}",
                    "values": [significant(entry["metrics"].get(m)) for m in (*FOLLOWING, *HOLDING)],
                    "samples": ", ".join(
                        f"{spoken_name(key)} {shown_value(key, value)}" for key, value in entry["samples"].items()
                    ),
                    "command": f"abhv-mc replay {folder} --flight {entry['flight']} --controller {name}",
                }
            )
        tables.append({"controller": controller_label(name), "rows": rows})
    return tables
