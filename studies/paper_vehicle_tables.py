"""Tables of docs/explanation/paper.md on the ensemble, as Markdown."""

from collections.abc import Iterator
from typing import Any

from paper_vehicle_flights import AXES, LAWS, READING, Axis

WORDS = {"angle_of_attack": "angle of attack", "sideslip": "sideslip", "bank": "bank"}


def figures(judged: dict[str, Any]) -> Iterator[str]:
    """Yield a row for each axis: the paper's interval, ranges of flights, and misses."""
    yield "| figure | ends of the data | abhv | | dispersed beyond the axis, TLC / LQR |"
    yield "|" + "---|" * 5
    for axis, end in zip(AXES, judged["ends"], strict=True):
        intervals = " and ".join(
            f"{low:g} to {high:g}" for low, high in (axis.lowest, axis.highest)
        )
        out = [f"{100.0 * miss:.1f} % out" for miss in end["misses"] if miss > READING]
        beyond = " / ".join(
            f"{left_by(axis, end, law):.0f} %" for law in LAWS if law in end["dispersed"]
        )
        label = f"{axis.figure} {axis.label}" + (", mirrored" if end["mirrored"] else "")
        range_text = f"{end['low']:.5g} to {end['high']:.5g}"
        yield f"| {label} | {intervals} | {range_text} | {', '.join(out) or 'inside'} | {beyond} |"


def left_by(axis: Axis, end: dict[str, Any], law: str) -> float:
    """Return the excess of the furthest dispersed flight over the axis, percent of its width."""
    low, high = end["dispersed"][law]
    if axis.figure == 4:
        low, high = 180.0 - high, 180.0 - low
    elif end["mirrored"]:
        low, high = -high, -low
    return float(100.0 * max(axis.lowest[0] - low, high - axis.highest[1], 0.0) / axis.width)


def powers(traits: dict[str, dict[str, float]]) -> Iterator[str]:
    """Yield a row for each control power of each vehicle."""
    yield "| control power | " + " | ".join(traits) + " |"
    yield "|" + "---|" * (1 + len(traits))
    for name in next(iter(traits.values())):
        yield f"| {name} | " + " | ".join(f"{x[name]:.3g}" for x in traits.values()) + " |"


def claim(members: list[dict[str, Any]], judged: dict[str, Any]) -> Iterator[str]:
    """Yield a row for each member: percentage of flights with smaller error of TLC, and usage.

    The percentages are for the whole flight, and without the ramps.
    """
    surfaces = ("aileron", "rudder", "elevator")
    heads = [f"{label}, TLC better in %" for label in WORDS.values()] + [
        f"{s}, rms deg, TLC / LQR" for s in surfaces
    ]
    yield (
        "| member | ends inside | worst end | disk margin, TLC / LQR | early terminations | "
        + " | ".join(heads)
        + " |"
    )
    yield "|" + "---|" * (5 + len(heads))
    for member in members:
        member_claim = judged[member["name"]]
        cells = [
            member["name"],
            str(member["ends_in"]),
            f"{100.0 * member['worst']:.0f} %",
            " / ".join(f"{member_claim['margins'][law]['disk']:.2f}" for law in LAWS),
            " / ".join(str(member_claim["lost"][law]) for law in LAWS),
        ]
        for name in WORDS:
            cells.append(
                " / ".join(
                    f"{member_claim['claim'][w][name]['closer_percent']:.0f}"
                    for w in ("whole", "settled")
                )
            )
        for surface in surfaces:
            cells.append(" / ".join(f"{member_claim['use'][surface][law]:.3f}" for law in LAWS))
        yield "| " + " | ".join(cells) + " |"


def largest_misses(result: dict[str, Any]) -> dict[str, float]:
    """Return the largest miss in each figure left out, over its axes and the starts."""
    worst: dict[str, float] = {}
    for prediction in result["without"]:
        axis = prediction["ends"][0]["axis"].split(" (")[0].split(",")[0]
        label = f"Figure {prediction['figure']}, {axis}"
        misses = [miss for end in prediction["ends"] for miss in end["misses"]]
        worst[label] = max(worst.get(label, 0.0), *misses)
    return worst
