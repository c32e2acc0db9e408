"""A member of the ensemble as files below configs: the vehicle abhv with its tables, and the mission paper_s.

    python studies/paper_vehicle_export.py [MEMBER]

By default `abhv` itself. Numbers are rounded to what the files show.
"""

import argparse
import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Floats, wrapped
from paper_vehicle_box import BASE, TABLES, changed_tables, grids_of

ABHV = "seed-2"  # the member that configs/vehicle/abhv.yaml is
_PER_DEGREE = ("sideslip", "aileron", "rudder", "elevator")
_DIGITS = 6
_POINTS = ("783.8064 kg", "1959.5088 kg")


def write_tables(values: dict[str, float], folder: Path) -> dict[str, Floats]:
    """Every table that differs from GHAME's; gives the nodes of all that the vehicle changes."""
    nodes = changed_tables(values)
    folder.mkdir(exist_ok=True)
    for name, (_, variable) in TABLES.items():
        shown = nodes[name] * (np.pi / 180.0 if variable in _PER_DEGREE else 1.0)
        machs, alphas = grids_of(name)
        with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(["mach", "alpha_deg", "value"])
            for i, mach in enumerate(machs):
                for j, alpha in enumerate(alphas):
                    writer.writerow(
                        [f"{mach:g}", f"{np.rad2deg(alpha):g}", f"{shown[i, j]:.{_DIGITS}g}"]
                    )
    return nodes


def vehicle_text(member: dict[str, Any], nodes: dict[str, Floats]) -> str:
    """`ghame_x.yaml` with the member's numbers."""
    text = (ROOT / "configs/vehicle/ghame_x.yaml").read_text(encoding="utf-8")
    body = text[text.index("reference:") :]
    values = member["values"]
    for i, mass in enumerate(_POINTS):
        start = body.index(f"- mass: {mass}")
        part = body[start:]
        for name in (n for n in nodes if n.startswith("inertia")):
            part = re.sub(
                rf"({name}: )[^\n]*",
                rf"\g<1>{nodes[name].ravel()[i]:.{_DIGITS}g} kg m2",
                part,
                count=1,
            )
        body = body[:start] + part
    c = BASE.constants
    cowl, arm = 0.2448 * values["cowl_area"], c.thrust_offset_z * values["thrust_arm"]
    body = re.sub(r"cowl_area: [^\n]*", f"cowl_area: {cowl:.{_DIGITS}g} m2", body)
    body = re.sub(
        r"offset: [^\n]*", f"offset: {arm:.{_DIGITS}g} m # below the centre of gravity", body
    )
    body = re.sub(r" # node totals:[^\n]*", "", body)
    for name in TABLES:
        body = re.sub(rf"(  {name}: {{file: )[^,}}]*", rf"\g<1>abhv/{name}.csv", body)
    head = (
        f"A vehicle on which the paper's S comes out as its figures show it: {member['ends_in']} of the 20 ends of "
        "Figures 4 to 11 within 2 % of their axes. The paper's tables are unpublished; the figures do not fix a "
        "vehicle, and this is one of an ensemble (docs/explanation/paper.md)."
    )
    made = (
        f"Identified by studies/paper_vehicle.py (member {member['name']}), written by "
        "studies/paper_vehicle_export.py: GHAME's tables at the size of an X-51, as ghame_x, each times a factor or "
        "with an offset, inside a box of what vehicles of the class have. The factors: "
        + ", ".join(f"{name} {value:.4g}" for name, value in values.items())
        + ". Those of yaw_rudder and roll_rudder are ratios to sideslip's yaw and to the aileron's roll."
    )
    source = (
        "Tables and numbers: CADAC++ GHAME6 (P. H. Zipfel), after NASA's Generic "
        "Hypersonic Aerodynamic Model Example."
    )
    lines = [f"# {line}" for part in (head, made, source) for line in wrapped(part).splitlines()]
    lines += [
        "name: abhv",
        "description: a vehicle that flies the paper's S as its figures show it, 8.6 m and 1372 kg",
    ]
    return "\n".join(lines) + "\n\n" + body


def mission_text(values: dict[str, float]) -> str:
    """`s_manoeuvre.yaml` with the member's S."""
    text = (ROOT / "configs/mission/s_manoeuvre.yaml").read_text(encoding="utf-8")
    start, end = text.index("manoeuvre:\n"), text.index("limits:")
    s = (
        "manoeuvre:\n"
        "  kind: s_manoeuvre\n"
        "  offset: -5 km         # to the right of the start's heading: south, flying east\n"
        f"  length: {values['length']:.2f} s\n"
        f"  bank_time: {values['bank_time']:.2f} s     # in which the bank is established, and left at the end\n"
        f"  sharpness: {values['sharpness']:.2f}       # exponent of the lateral acceleration\n\n"
    )
    head = """# The S of the paper's figures (Zhu and Shen 2014, section 7): fly east at 20 km and 1400 m/s, move
# the track 5 km aside, to the right first as Figure 7 shows it, and come back to the original heading, height and
# speed. The paper prints no formula; length, bank_time and sharpness were identified with the vehicle abhv.
name: paper_s
"""
    return head + "\n" + text[text.index("start:") : start] + s + text[end:]


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(
        description="Write a member of the ensemble as a vehicle and a mission."
    )
    parser.add_argument("member", nargs="?", default=ABHV, help="its name")
    parser.add_argument("--results", type=Path, default=ROOT / "studies/paper_vehicle.json")
    parser.add_argument("--configs", type=Path, default=ROOT / "configs")
    arguments = parser.parse_args()
    ensemble = json.loads(arguments.results.read_text(encoding="utf-8"))["ensemble"]
    member = next(m for m in ensemble if m["name"] == arguments.member)
    nodes = write_tables(member["values"], arguments.configs / "vehicle/abhv")
    (arguments.configs / "vehicle/abhv.yaml").write_text(
        vehicle_text(member, nodes), encoding="utf-8"
    )
    (arguments.configs / "mission/paper_s.yaml").write_text(
        mission_text(member["values"]), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
