"""The tables of docs/explanation/paper.md on the ensemble, printed as Markdown.

    python studies/paper_vehicle_tables.py [MEMBER]

Reads studies/paper_vehicle.json and studies/paper_vehicle_claim.json. The figures are shown for one member, by default
the best; the claim for all.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiment import ROOT
from paper_vehicle_flights import AXES, LAWS, READING

WORDS = {"angle_of_attack": "angle of attack", "sideslip": "sideslip", "bank": "bank"}


def figures(judged: dict[str, Any]) -> Iterator[str]:
    """A row for each axis: the paper's, ours, in or out by how much, and all dispersed flights."""
    yield "| figure | the paper's data end in | ours | | dispersed, TLC | dispersed, LQR |"
    yield "|" + "---|" * 6
    for axis, end in zip(AXES, judged["ends"], strict=True):
        asked = " and ".join(f"{low:g} to {high:g}" for low, high in (axis.lowest, axis.highest))
        out = [f"{100.0 * miss:.1f} % out" for miss in end["misses"] if miss > READING]
        flown = ["{:.3g} to {:.3g}".format(*end["dispersed"][law]) if law in end["dispersed"] else "" for law in LAWS]
        words = f"{axis.figure} {axis.words}" + (", mirrored" if end["mirrored"] else "")
        yield (
            f"| {words} | {asked} | {end['low']:.5g} to {end['high']:.5g} | {', '.join(out) or 'in'} | "
            + " | ".join(flown)
            + " |"
        )


def claim(members: list[dict[str, Any]], judged: dict[str, Any]) -> Iterator[str]:
    """A row a member: in how many flights TLC is closer, whole flight / without the ramps, and the use of surfaces."""
    surfaces = ("aileron", "rudder", "elevator")
    heads = [f"{words}, TLC closer in %" for words in WORDS.values()] + [f"{s}, rms deg, TLC / LQR" for s in surfaces]
    yield "| member | ends in | worst | disk margin, TLC / LQR | lost | " + " | ".join(heads) + " |"
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
            cells.append(" / ".join(f"{one['claim'][w][name]['closer_percent']:.0f}" for w in ("whole", "settled")))
        for surface in surfaces:
            cells.append(" / ".join(f"{one['use'][surface][law]:.3f}" for law in LAWS))
        yield "| " + " | ".join(cells) + " |"


def predictions(result: dict[str, Any]) -> Iterator[str]:
    """A row for each figure left out: what vehicles fitted to the others show there."""
    yield "| member | figure left out | predicted | out of the intervals by |"
    yield "|---|---|---|---|"
    for each in result["without"]:
        for end in each["ends"]:
            misses = " and ".join(f"{100.0 * miss:.0f} %" for miss in end["misses"])
            shown = f"{end['low']:.4g} to {end['high']:.4g}"
            yield f"| {each['member']} | {each['figure']} {end['axis']} | {shown} | {misses} |"


def main() -> None:
    """Print them."""
    parser = argparse.ArgumentParser(description="Print the tables on the ensemble.")
    parser.add_argument("member", nargs="?", help="whose figures are shown; by default the best member's")
    parser.add_argument("--results", type=Path, default=ROOT / "studies/paper_vehicle.json")
    arguments = parser.parse_args()
    result = json.loads(arguments.results.read_text(encoding="utf-8"))
    judged = json.loads(arguments.results.with_name("paper_vehicle_claim.json").read_text(encoding="utf-8"))
    shown = arguments.member or result["ensemble"][0]["name"]
    parts = (figures(judged[shown]), claim(result["ensemble"], judged), predictions(result))
    print("\n\n".join("\n".join(part) for part in parts))


if __name__ == "__main__":
    main()
