"""The tables of docs/explanation/paper.md on the ensemble, as Markdown."""

from collections.abc import Iterator
from typing import Any

from paper_vehicle_flights import AXES, LAWS, READING, TRAITS, Axis

WORDS = {"angle_of_attack": "angle of attack", "sideslip": "sideslip", "bank": "bank"}


def figures(judged: dict[str, Any]) -> Iterator[str]:
    """A row for each axis: the paper's, ours, in or out by how much, and how far dispersed flights leave it."""
    yield "| figure | ends of the data | abhv | | dispersed beyond the axis, TLC / LQR |"
    yield "|" + "---|" * 5
    for axis, end in zip(AXES, judged["ends"], strict=True):
        asked = " and ".join(f"{low:g} to {high:g}" for low, high in (axis.lowest, axis.highest))
        out = [f"{100.0 * miss:.1f} % out" for miss in end["misses"] if miss > READING]
        beyond = " / ".join(
            f"{left_by(axis, end, law):.0f} %" for law in LAWS if law in end["dispersed"]
        )
        words = f"{axis.figure} {axis.words}" + (", mirrored" if end["mirrored"] else "")
        shown = f"{end['low']:.5g} to {end['high']:.5g}"
        yield f"| {words} | {asked} | {shown} | {', '.join(out) or 'inside'} | {beyond} |"


def left_by(axis: Axis, end: dict[str, Any], law: str) -> float:
    """How far the furthest dispersed flight goes beyond the axis, percent of its width."""
    low, high = end["dispersed"][law]
    if axis.figure == 4:
        low, high = 180.0 - high, 180.0 - low
    elif end["mirrored"]:
        low, high = -high, -low
    return float(100.0 * max(axis.lowest[0] - low, high - axis.highest[1], 0.0) / axis.width)


def vehicles(members: list[dict[str, Any]]) -> Iterator[str]:
    """A row a member: what it is, and the S on which it shows the figures."""
    yield "| member | " + " | ".join(TRAITS.values()) + " | length, s | bank_time, s | sharpness |"
    yield "|" + "---|" * (4 + len(TRAITS))
    for member in members:
        numbers = [f"{x:.3g}" for x in member["traits"].values()]
        numbers += [
            f"{member['values'][name]:.2f}" for name in ("length", "bank_time", "sharpness")
        ]
        yield f"| {member['name']} | {' | '.join(numbers)} |"


def claim(members: list[dict[str, Any]], judged: dict[str, Any]) -> Iterator[str]:
    """A row a member: in how many flights TLC is closer, whole flight / without the ramps, and the use of surfaces."""
    surfaces = ("aileron", "rudder", "elevator")
    heads = [f"{words}, TLC better in %" for words in WORDS.values()] + [
        f"{s}, rms deg, TLC / LQR" for s in surfaces
    ]
    yield (
        "| member | ends inside | worst end | disk margin, TLC / LQR | early terminations | "
        + " | ".join(heads)
        + " |"
    )
    yield "|" + "---|" * (5 + len(heads))
    for member in members:
        one = judged[member["name"]]
        cells = [
            member["name"],
            str(member["ends_in"]),
            f"{100.0 * member['worst']:.0f} %",
            " / ".join(f"{one['margins'][law]['disk']:.2f}" for law in LAWS),
            " / ".join(str(one["lost"][law]) for law in LAWS),
        ]
        for name in WORDS:
            cells.append(
                " / ".join(
                    f"{one['claim'][w][name]['closer_percent']:.0f}" for w in ("whole", "settled")
                )
            )
        for surface in surfaces:
            cells.append(" / ".join(f"{one['use'][surface][law]:.3f}" for law in LAWS))
        yield "| " + " | ".join(cells) + " |"


def largest_misses(result: dict[str, Any]) -> dict[str, float]:
    """The largest miss in each figure left out, over its axes and the starts."""
    worst: dict[str, float] = {}
    for each in result["without"]:
        words = f"Figure {each['figure']}, {each['ends'][0]['axis'].split(' (')[0].split(',')[0]}"
        misses = [miss for end in each["ends"] for miss in end["misses"]]
        worst[words] = max(worst.get(words, 0.0), *misses)
    return worst


def predictions(result: dict[str, Any]) -> Iterator[str]:
    """A row for each axis left out: what vehicles fitted to the other figures show there."""
    starts = sorted({each["start"] for each in result["without"]})
    yield "| figure left out | " + " | ".join(f"start {start}" for start in starts) + " |"
    yield "|---|" + "---|" * len(starts)
    rows: dict[str, dict[int, str]] = {}
    for each in result["without"]:
        for end in each["ends"]:
            misses = " and ".join(f"{100.0 * miss:.0f}" for miss in end["misses"])
            shown = f"{end['low']:.4g} to {end['high']:.4g} ({misses} %)"
            rows.setdefault(f"{each['figure']} {end['axis']}", {})[each["start"]] = shown
    for words, cells in rows.items():
        yield f"| {words} | {' | '.join(cells.get(start, 'none') for start in starts)} |"
