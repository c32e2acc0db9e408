"""Tables of docs/explanation/paper.md on the ensemble, as Markdown."""

from collections.abc import Iterator, Sequence
from typing import Any

from paper_vehicle_flights import AXES, LAWS, Axis
from paper_vehicle_sides import shown


def figures(judged: dict[str, Any]) -> Iterator[str]:
    """Yield a row for each axis: the paper's interval, and ranges of flights."""
    yield "| figure | extremes of the data | `abhv` | dispersed beyond the axis, TLC / LQR |"
    yield "|" + "---|" * 4
    for axis, end in zip(AXES, judged["ends"], strict=True):
        intervals = " and ".join(
            f"{low:g} to {high:g}" for low, high in (axis.lowest, axis.highest)
        )
        beyond = " / ".join(
            f"{left_by(axis, end, law):.0f} %" for law in LAWS if law in end["dispersed"]
        )
        label = f"{axis.figure} {axis.label}" + (", mirrored" if end["mirrored"] else "")
        range_text = f"{end['low']:.5g} to {end['high']:.5g}"
        yield f"| {label} | {intervals} | {range_text} | {beyond} |"


def left_by(axis: Axis, end: dict[str, Any], law: str) -> float:
    """Return the excess of the furthest dispersed flight over the axis, percent of its width."""
    low, high = end["dispersed"][law]
    if axis.figure == 4:
        low, high = 180.0 - high, 180.0 - low
    elif end["mirrored"]:
        low, high = -high, -low
    return float(100.0 * max(axis.lowest[0] - low, high - axis.highest[1], 0.0) / axis.width)


def with_ranges(
    traits: dict[str, dict[str, float]], members: Sequence[str], default: str
) -> dict[str, dict[str, str]]:
    """Return the traits as text: of the default vehicle, of the members, of other vehicles."""
    ranges = {}
    for name in traits[default]:
        values = [traits[member][name] for member in members]
        low, high = f"{min(values):.3g}", f"{max(values):.3g}"
        ranges[name] = low if low == high else f"{low} to {high}"
    others = {name: shown(x) for name, x in traits.items() if name not in (default, *members)}
    return {"`abhv`": shown(traits[default]), "earlier vehicles": ranges, **others}


def powers(traits: dict[str, dict[str, str]]) -> Iterator[str]:
    """Yield a row for each control power of each vehicle; arms are in the table of limits."""
    yield "| control power | " + " | ".join(traits) + " |"
    yield "|" + "---|" * (1 + len(traits))
    for name in next(iter(traits.values())):
        if " over the " not in name:
            yield f"| {name} | " + " | ".join(x[name] for x in traits.values()) + " |"


def largest_misses(result: dict[str, Any]) -> dict[str, list[float]]:
    """Return the largest miss in each figure left out, over its axes, for each start."""
    largest: dict[str, list[float]] = {}
    for prediction in result["without"]:
        axis = prediction["ends"][0]["axis"].split(" (")[0].split(",")[0]
        label = f"{axis} in Figure {prediction['figure']}"
        misses = [miss for end in prediction["ends"] for miss in end["misses"]]
        largest.setdefault(label, []).append(max(misses))
    return largest
