"""The map of failures, which `abhv-mc explain DIR --all` makes, as numbers and as rows of words."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

from abhv_mc.analysis.failure_map import FailureMap, read_map
from abhv_mc.folder.results import Results
from abhv_mc.numerics.bounds import Bounds
from abhv_mc.topics.labels import controller_label
from abhv_mc.topics.parameter_words import shown_value, spoken_name
from abhv_mc.topics.plain import plain
from abhv_mc.topics.words import count_of, joined, percent

_SIDES = {True: "high", False: "low"}


def failure_map_numbers(results: Results) -> dict[str, Any] | None:
    """The map that the folder keeps of these flights; None where there is none."""
    found = read_map(results.folder, results.manifest.get("digest"))
    return None if found is None else map_numbers(found)


def map_numbers(found: FailureMap) -> dict[str, Any]:
    """What JSON holds of each controller."""
    return {
        name: plain({**dataclasses.asdict(part), "looked_at": part.looked_at})
        for name, part in found.controllers.items()
    }


def failure_map_tables(
    found: Mapping[str, Any] | None, folder: str, requirements: Iterable[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """For each controller with failed flights a row a group, and what is in none."""
    spoken = {
        f"missed {entry['metric']} {Bounds.of(entry)}":
            f"missed {entry['words'][:1].lower()}{entry['words'][1:]}" for entry in requirements
    }  # fmt: skip
    return [
        {
            "name": name,
            "controller": controller_label(name),
            "command": f"abhv-mc replay {folder} --controller {name} --flight NUMBER",
            "rows": [_row(group, part["looked_at"], spoken) for group in part["groups"]],
            "rest": _rest(part),
        }
        for name, part in (found or {}).items()
        if part["failed"]
    ]


def _row(group: Mapping[str, Any], total: int, spoken: Mapping[str, str]) -> dict[str, Any]:
    flights = group["flights"]
    return {
        "failure": spoken.get(group["failure"], group["failure"]),
        "names": joined([f"{spoken_name(d['parameter'])} {_SIDES[d['high']]}" for d in group["dispersions"]]),
        "typical": "; ".join(map(_typical, group["dispersions"])),
        "flights": count_of(len(flights), total),
        "flight": str(flights[0]),
        "share": percent(len(flights) / total, 2),
    }


def _typical(found: Mapping[str, Any]) -> str:
    """'-35 % (-40 % to -31 %)'; of one flight its value."""
    low, middle, high = (shown_value(found["parameter"], found[key]) for key in ("least", "median", "largest"))
    return f"{middle} ({low} to {high})" if low != high else middle


def _rest(part: Mapping[str, Any]) -> str:
    """'3 of 50 not explained: ...'."""
    total = part["looked_at"]
    missing = f"{len(part['unexplained'])} of {total} not explained by a set that was tried"
    words = [missing if part["unexplained"] else f"0 of {total} not explained"]
    if part["nominal"]:
        words.append(f"{len(part['nominal'])} fail with nothing dispersed")
    if part["failed"] > total:
        words.append(f"the {total} worst of {part['failed']} failed flights were looked at")
    return "; ".join(words)
