"""Export of a member of the ensemble to configs: the vehicle abhv, its tables and mission paper_s.

    python studies/paper_vehicle_export.py [MEMBER]

The default member is that of `abhv`. Numbers are rounded to the digits of the files.
"""

import argparse
import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Floats, wrapped
from paper_vehicle_box import BASE, FUEL, TABLES, cells_of, changed_tables, grids_of
from paper_vehicle_sides import LEAST_MACH

ABHV = "seed-2"  # the member that configs/vehicle/abhv.yaml is
_PER_DEGREE = ("sideslip", "aileron", "rudder", "elevator")
_DIGITS = 6
_MASS = """mass:
  start: {start} kg # half of the fuel: full tanks hold {fuel:g} kg, about 2 m3 of hydrogen
  empty: {empty} kg
  points: # linear in between; empty and full
{points}
"""


def write_table(file: Path, machs: Floats, alphas: Floats, values: Floats) -> None:
    """Write the nodes from LEAST_MACH upwards."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["mach", "alpha_deg", "value"])
        for mach, row in zip(machs, values, strict=True):
            if mach >= LEAST_MACH:
                writer.writerows(
                    [f"{mach:g}", f"{np.rad2deg(alpha):g}", f"{value:.{_DIGITS}g}"]
                    for alpha, value in zip(alphas, row, strict=True)
                )


def write_tables(values: dict[str, float], folder: Path) -> dict[str, Floats]:
    """Write every table of a member, and return the nodes of tables and inertias."""
    nodes = changed_tables(values)
    folder.mkdir(parents=True, exist_ok=True)
    for name, (_, variable) in TABLES.items():
        table = nodes[name] * (np.pi / 180.0 if variable in _PER_DEGREE else 1.0)
        write_table(folder / f"{name}.csv", *grids_of(name), table)
    engine = grids_of("capture_area_ratio")
    write_table(
        folder / "capture_area_ratio.csv", *engine, BASE.tables.data[cells_of("capture_area_ratio")]
    )
    return nodes


def mass_text(nodes: dict[str, Floats]) -> str:
    """Return the section on mass."""
    line = [rounded(mass, 7) for mass in grids_of("inertia_xx")[0]]
    inertias = {
        name: [rounded(value, _DIGITS) for value in nodes[name].ravel()]
        for name in nodes
        if name.startswith("inertia")
    }
    start, empty = (rounded(m, 7) for m in (BASE.constants.mass_start, BASE.constants.mass_empty))
    points = []
    for mass in (empty, rounded(empty + FUEL, 7)):
        points.append(f"    - mass: {mass:.7g} kg")
        # The inertias differ little between empty and full: their slope takes more digits.
        points += [
            f"      {name}: {np.interp(mass, line, values):.{_DIGITS + 4}g} kg m2"
            for name, values in inertias.items()
        ]
    return _MASS.format(
        start=f"{start:.7g}", empty=f"{empty:.7g}", fuel=FUEL, points="\n".join(points)
    )


def rounded(value: float, digits: int) -> float:
    """Return a value with the significant digits of the files."""
    return float(f"{value:.{digits}g}")


def vehicle_text(member: dict[str, Any], nodes: dict[str, Floats]) -> str:
    """Return `ghame_x.yaml` with the numbers of a member."""
    text = (ROOT / "configs/vehicle/ghame_x.yaml").read_text(encoding="utf-8")
    body = text[text.index("reference:") :]
    body = re.sub(r" # (557.42|24.38|22.86) k[^\n]*", "", body)
    values = member["values"]
    body = body[: body.index("mass:")] + mass_text(nodes) + "\n" + body[body.index("surfaces:") :]
    c = BASE.constants
    cowl, arm = 0.2448 * values["cowl_area"], c.thrust_offset_z * values["thrust_arm"]
    body = re.sub(r"cowl_area: [^\n]*", f"cowl_area: {cowl:.{_DIGITS}g} m2", body)
    body = re.sub(
        r"offset: [^\n]*", f"offset: {arm:.{_DIGITS}g} m # below the centre of gravity", body
    )
    limits = [np.rad2deg(x) for x in (c.angle_of_attack_min, c.angle_of_attack_max)]
    body = re.sub(
        r"angle_of_attack: \[[^\n]*",
        f"angle_of_attack: [{limits[0]:g} deg, {limits[1]:g} deg]",
        body,
    )
    body = re.sub(r" # node totals:[^\n]*", "", body)
    for name in (*TABLES, "capture_area_ratio"):
        body = re.sub(rf"(  {name}: {{file: )[^,}}]*", rf"\g<1>abhv/{name}.csv", body)
    head = (
        "Vehicle with which the S manoeuvre matches the figures of the paper: "
        f"{member['ends_in']} of the 20 ends of Figures 4 to 11 are within 2 % of their axes. The "
        "paper's tables are not published, and the figures do not determine one vehicle; this "
        "vehicle is one of an ensemble (docs/explanation/paper.md)."
    )
    origin = (
        f"Found by studies/paper_vehicle.py (member {member['name']}) and written by "
        "studies/paper_vehicle_export.py. The vehicle has GHAME's tables from Mach 2 up, each with "
        "a factor or an offset, and a drag polar. It is a little longer than an X-51 with its "
        "booster and has the wing loading of an X-43A. docs/explanation/paper-vehicles.md gives "
        "its limits. Deflections cause no drag, which is negligible in the S (0.4 deg of rudder), "
        "but not with saturated surfaces. The free numbers of the search are factors on GHAME's "
        "tables unless they are offsets; length, bank_time and sharpness belong to the manoeuvre: "
        + ", ".join(f"{name} {value:.4g}" for name, value in values.items())
        + ". yaw_rudder is the ratio to the yaw by sideslip, and roll_rudder the ratio to the roll "
        "by the aileron."
    )
    source = (
        "Tables and numbers: CADAC++ GHAME6 (P. H. Zipfel), after NASA's Generic "
        "Hypersonic Aerodynamic Model Example."
    )
    lines = [
        f"# {line}"
        for paragraph in (head, origin, source)
        for line in wrapped(paragraph).splitlines()
    ]
    size = f"8.6 m and {BASE.constants.mass_start:.0f} kg"
    lines += [
        "name: abhv",
        f"description: a vehicle that flies the paper's S as its figures show it, {size}",
    ]
    return "\n".join(lines) + "\n\n" + body


def mission_text(values: dict[str, float]) -> str:
    """Return `s_manoeuvre.yaml` with the member's S."""
    text = (ROOT / "configs/mission/s_manoeuvre.yaml").read_text(encoding="utf-8")
    start, end = text.index("manoeuvre:\n"), text.index("limits:")
    s = (
        "manoeuvre:\n"
        "  kind: s_manoeuvre\n"
        "  offset: -5 km         # to the right of the initial heading, here to the south\n"
        f"  length: {values['length']:.2f} s\n"
        f"  bank_time: {values['bank_time']:.2f} s     # time in which the bank is established, "
        "and removed at the end\n"
        f"  sharpness: {values['sharpness']:.2f}       # exponent of the lateral acceleration\n"
        "\n"
    )
    head = """# The S manoeuvre of the paper's figures (Zhu and Shen 2014, section 7): the vehicle \
flies east at 20 km and 1400 m/s,
# moves its track 5 km sideways, first to the right as in Figure 7, and returns to the original \
heading, height and
# speed. The paper prints no formula; length, bank_time and sharpness were identified with the \
vehicle abhv.
name: paper_s
"""
    return head + "\n" + text[text.index("start:") : start] + s + text[end:]


def write_files(name: str, results: Path, configs: Path) -> None:
    """Write the vehicle and the mission of a member below a folder of configurations."""
    ensemble = json.loads(results.read_text(encoding="utf-8"))["ensemble"]
    member = next(m for m in ensemble if m["name"] == name)
    nodes = write_tables(member["values"], configs / "vehicle/abhv")
    vehicle, mission = configs / "vehicle/abhv.yaml", configs / "mission/paper_s.yaml"
    vehicle.write_text(vehicle_text(member, nodes), encoding="utf-8")
    mission.parent.mkdir(exist_ok=True)
    mission.write_text(mission_text(member["values"]), encoding="utf-8")


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(
        description="Write a member of the ensemble as a vehicle and a mission."
    )
    parser.add_argument("member", nargs="?", default=ABHV, help="its name")
    parser.add_argument("--results", type=Path, default=ROOT / "studies/paper_vehicle.json")
    parser.add_argument("--configs", type=Path, default=ROOT / "configs")
    arguments = parser.parse_args()
    write_files(arguments.member, arguments.results, arguments.configs)


if __name__ == "__main__":
    main()
