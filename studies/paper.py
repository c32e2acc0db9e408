"""Comparison with the paper's figures and claim: docs/explanation/paper.md and its figures.

    OPENBLAS_NUM_THREADS=1 python studies/paper.py [--flights N]

Each vehicle of studies/paper_vehicle.json (made by paper_vehicle.py) is simulated with the paper's
dispersions. The paper (Zhu and Shen 2014) gives no data, but the ends of the axes of its Figures 3
to 11. All results are written to studies/paper_vehicle_claim.json. Sentences with numbers are
generated, and the script stops if a sentence would no longer be true.
"""

import argparse
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from experiment import ROOT, wrapped
from paper_figures import plot_axis, plot_track
from paper_vehicle_box import FREE, make_mission, make_vehicle
from paper_vehicle_claim import fly_law, judge
from paper_vehicle_export import ABHV
from paper_vehicle_flights import AXES, CONTROLLERS, LAWS, READING, TRAITS
from paper_vehicle_sides import find_trim, measure, table
from paper_vehicle_tables import claim, figures, largest_misses, left_by, predictions, vehicles

from abhv_mc.control.controller_file import TlcController
from abhv_mc.topics.figure_style import write_png
from abhv_mc.user_code.vehicle_functions import load_vehicle

# Table 1 of the paper: damping and bandwidth (rad/s).
TABLE_1 = {
    "altitude": (2.4, 0.03),
    "velocity.flight_path_angle": (2.4, 0.1),
    "velocity.heading": (2.4, 0.08),
    "velocity.speed": (2.4, 0.2),
    **{f"attitude.{name}": (3.4, 0.3) for name in ("angle_of_attack", "sideslip", "bank")},
    "rates.roll_rate": (3.4, 1.2),
    "rates.pitch_rate": (3.4, 1.2),
    "rates.yaw_rate": (3.4, 1.5),
}
SEARCHES = 60  # approximate number of searches behind studies/paper_vehicle_starts.json
NEAR = 0.1  # of an axis, largest error of a predicted figure
IMAGES = {
    "paper_fig02": "Figure 2, ground track",
    "paper_fig03_altitude": "Figure 3, altitude",
    "paper_fig03_speed": "Figure 3, speed",
    "paper_fig04_heading": "Figure 4, heading",
    "paper_fig05_angle_of_attack": "Figure 5, angle of attack",
    "paper_fig06_sideslip": "Figure 6, sideslip",
    "paper_fig07_bank": "Figure 7, bank",
    "paper_fig08_aileron": "Figure 8, aileron",
    "paper_fig09_rudder": "Figure 9, rudder",
    "paper_fig10_elevator": "Figure 10, elevator",
    "paper_fig11_equivalence_ratio": "Figure 11, equivalence ratio, commanded",
}


TEXT = """
# The paper, side by side

Zhu and Shen (2014) print neither their tables nor the formula of their S, and of their flights only the figures. So we
asked which vehicles of the class, with Table 1 and the LQR weights as printed, show what Figures 3 to 11 show:
`studies/paper_vehicle.py` found {number}. What holds for all of them is what the paper allows one to conclude. This
page is made by `studies/paper.py`.

- `configs/control/tlc.yaml` is Table 1 to the digit, the differentiators are the paper's 0.3 and 1.5 rad/s (the script
  checks it), and `configs/control/lqr.yaml` has the printed weights.
- An axis that a plotting program chose ends within one tick of the data, so each end of an axis is an interval for the
  data's end; 2 % of the axis beyond it is in, for reading it off. Both ends of Figures 4, 6, 8, 9, 10 and 11 (the laws
  together) and of 5 and 7 (each law) are 20. Figure 3 and the insets of Figure 7 are limits only.
- The S goes right first: Figure 7 is positive first, and Figure 2 has the original heading north of the final one. The
  paper does not say which sideslip and deflections are positive; 'mirrored' says where ours are turned.
- The S is no half cosine whose bank steps: the bank is established over a bank time, and the lateral acceleration goes
  as a power of the cosine, its sharpness. The paper's time is ours plus 180 s.

## Figure by figure

The vehicle `abhv`, which the default campaign flies, is member {abhv} (`configs/vehicle/abhv.yaml`, with the S of
`configs/mission/paper_s.yaml`). Last column: by how much the furthest of {flights} flights under the paper's 10, 10 and
15 % goes beyond the axis, in percent of it; the flight that the paper shows may be a dispersed one, too.

[FIGURES]

Dispersed, TLC leaves an axis furthest in {furthest_tlc}, LQR in {furthest_lqr}.

Figure 2: the track ends {south} south of the start's parallel, for the paper's 5 km. The paper does not print the
latitude of its start: its axis runs from 29.27 to 29.33 deg, ours starts at 29.3.

## The ensemble

{number} vehicles, of which any two differ by a factor of 1.5 or more, or in sign, in at least three of the eight traits
below. Searches left free end near each other. So each of some {searches} searches had an aim in these traits, and the
ensemble is the largest set among all their candidates that keep the rules: 18 of the 20 ends in, none out by more than
20 % of its axis, and every side of the next section. Each member is a rigid body at both mass points, trims at least
0.1 deg off the tables' nodes and does not saturate.

[VEHICLES]

{spread}

{ends}

## What a vehicle of the class has

The figures alone also admit vehicles that nobody could build, so each member keeps the sides of this table
(`studies/paper_vehicle_sides.py`). The free numbers are factors on GHAME's tables at the size of an X-51 and a wing
loading of 393 kg/m2, which scales out: mass, inertias, all coefficients and the cowl area times one factor change no
simulation. Drag is a polar, `CD = CD0 g(M) + k |CL tan(alpha - alpha_0)|`, with GHAME's growth over the Mach number.
The tables begin at Mach 2, because below it GHAME's values times these factors would mean nothing.

[CLASS]

GHAME itself keeps few of these sides: at this flight condition its trimmed L/D is {ghame_lift_to_drag} and its thrust
over weight {ghame_thrust_to_weight}; its best L/D at this Mach number is 2.45, at 18 deg. In Figure 11 the equivalence
ratio rises from about 0.84 in straight flight to about 1.2 at 50 deg of bank. With induced drag that asks for an L/D of
3 to 5, so the paper did not use GHAME's drag.

Published values of the class are few. The X-43A was 3.66 m long, spanned 1.52 m and weighed 1,275 kg; with a reference
area of 3.36 m2 its wing loading was 380 kg/m2 (Marshall et al., AIAA 2005-3332). Kuechemann's limit at Mach 4.74 is an
L/D of 6.5. Slender lifting bodies reach a hypersonic L/D of 3, which their builders call the top of the class
([NASA SP-4220](https://history.nasa.gov/SP-4220/ch8.htm)). We found no published trimmed L/D or static margin of the
X-43A or the X-51A.

{sides}

## The claim, with the printed gains

"With nearly the same amount of control surface usage, TLC has a better performance in tracking angle of attack,
sideslip angle and bank angle commands." Of {flights} dispersed flights of each member, the percentage in which TLC has
the smaller rms error: over the whole flight / without each ramp of the bank and 5 s after it. Beside it what was used
of each surface.

[CLAIM]

[CLAIM_WORDS]

Both laws are stable in level flight on every member (least disk margins {disk_tlc} for TLC, {disk_lqr} for LQR), and no
flight is lost.

Bank turns round between the two counts. In a ramp the faster attitude loop is closer: Table 1's has 2 x 3.4 x 0.3 = 2.0
rad/s, the printed weights sqrt(2.28e5 / 3.28e3) = 8.3 rad/s. Later the error is what a law leaves standing, and TLC,
which inverts the model and integrates, leaves less.

What laws do that are tuned alike is on [the claim's page](claim.md). `campaigns/harder_vehicle.yaml` flies a vehicle
that the figures do not fit, GHAME's own coefficients with a bank that steps: there the printed LQR weights are unstable
and Table 1 saturates, neither of which the paper shows.

## One figure left out

What vehicles show where nothing was asked: three random starts, each fitted to the other seven figures alone. In
brackets by how much of the axis it lies outside the intervals.

[PREDICTIONS]

{predicted}

## The figures

Grey: the range of the paper's axis. Lines: the nominal flights on `abhv`; dotted: their commands. Shaded: all {flights}
dispersed flights.

[IMAGES]
"""


def check_gains() -> None:
    """Raise SystemExit if the shipped controller differs from Table 1."""
    tlc = CONTROLLERS["tlc"]
    if not isinstance(tlc, TlcController):
        raise SystemExit("tlc.yaml is not a TLC controller")
    for name, expected in TABLE_1.items():
        channel: Any = tlc
        for key in name.split("."):
            channel = getattr(channel, key)
        if (channel.damping, channel.bandwidth) != expected:
            raise SystemExit(
                f"{name}: {channel.damping}, {channel.bandwidth} in the file, {expected} in Table 1"
            )
    if (tlc.differentiators.attitude, tlc.differentiators.rates) != (0.3, 1.5):
        raise SystemExit("the differentiators' bandwidths are not the paper's")


def between(numbers: list[float], digits: int = 0) -> str:
    """Return a range of numbers as text: 'a to b', or one number."""
    low, high = f"{min(numbers):.{digits}f}", f"{max(numbers):.{digits}f}"
    return low if low == high else f"{low} to {high}"


def closer(judged: dict[str, Any], window: str, angle: str) -> list[float]:
    """Return the percentage of flights of each member in which TLC has the smaller error."""
    return [member["claim"][window][angle]["closer_percent"] for member in judged.values()]


def ratios(judged: dict[str, Any], window: str, angle: str) -> list[float]:
    """Return TLC's median error over LQR's for each member."""
    claims = [member["claim"][window][angle] for member in judged.values()]
    return [errors["tlc"] / errors["lqr"] for errors in claims]


def claim_words(judged: dict[str, Any]) -> Iterator[str]:
    """Yield sentences on the claim that hold for all members."""
    for window, label in (
        ("whole", "Over the whole flight"),
        ("settled", "Without each ramp and 5 s after it"),
    ):
        phrases = [
            f"{name.replace('_', ' ')} in {between(closer(judged, window, name))} % of the flights (its median error "
            f"is {between(ratios(judged, window, name), 2)} of LQR's)"
            for name in ("angle_of_attack", "sideslip", "bank")
        ]
        yield f"- {label} TLC is closer in {phrases[0]}, in {phrases[1]} and in {phrases[2]}."
    uses = {
        surface: [
            member["use"][surface]["tlc"] / member["use"][surface]["lqr"]
            for member in judged.values()
        ]
        for surface in ("aileron", "rudder", "elevator")
    }
    of_lqr = ", ".join(f"{surface} {between(use, 2)}" for surface, use in uses.items())
    yield f"- TLC's use of a surface (rms from its start, median) over LQR's: {of_lqr}."


def ends_words(judged: dict[str, Any]) -> str:
    """Return a sentence on the ends outside their intervals, and on how many members."""
    resist: dict[str, list[float]] = {}
    for member in judged.values():
        for end in member["ends"]:
            for side, miss in zip(("lowest", "highest"), end["misses"], strict=True):
                if miss > READING:
                    label = f"Figure {end['figure']}, {end['axis']}, {side} end"
                    resist.setdefault(label, []).append(100.0 * miss)
    if not resist:
        return "No end is out on any member."
    listed = "; ".join(
        f"{label} on {len(misses)} (up to {max(misses):.0f} %)" for label, misses in resist.items()
    )
    full = [name for name, member in judged.items() if all_in(member)]
    return (
        f"Ends that are out, on how many members, and by how much of the axis: {listed}. All 20 are in on "
        f"{join(full) or 'none'}, within the same sides: what is out on the others is the price of being different."
    )


def all_in(member: dict[str, Any]) -> bool:
    """Return whether every end of a member is in its interval."""
    return all(miss <= READING for end in member["ends"] for miss in end["misses"])


def predicted_words(result: dict[str, Any]) -> str:
    """Return sentences on the figures that the others predict, and on those that they do not."""
    misses = largest_misses(result)
    near, far = (
        [label for label, miss in misses.items() if (miss <= NEAR) == is_near]
        for is_near in (True, False)
    )
    return (
        f"Within {100.0 * NEAR:.0f} % of their axes the other figures predict {join(near)}. They leave open "
        f"{join([f'{label} (out by up to {100.0 * misses[label]:.0f} %)' for label in far])}: that a member shows "
        "these was asked of it, and is no test."
    )


def join(items: list[str]) -> str:
    """Return a list as text: 'a, b and c'."""
    return ", ".join(items[:-1]) + f" and {items[-1]}" if len(items) > 1 else "".join(items)


def spread_words(members: list[dict[str, Any]]) -> str:
    """Return a sentence on the traits that the figures determine, and those that they do not."""
    shares = {}
    for name in TRAITS:
        sizes = [abs(member["traits"][name]) for member in members]
        shares[name.replace("_", " ")] = max(sizes) / min(sizes)
    listed = ", ".join(
        f"{name} {share:.1f}" for name, share in sorted(shares.items(), key=lambda item: item[1])
    )
    return f"A trait's largest size among the members over its smallest: {listed}. What is near 1 the figures fix."


def sides_words(members: list[dict[str, Any]]) -> str:
    """Return a sentence on the sides of the box on which members lie."""
    counts: dict[str, int] = {}
    for member in members:
        for name, free in FREE.items():
            for side, label in ((free.low, "least"), (free.high, "most")):
                if abs(member["values"][name] - side) < 1e-3 * (free.high - free.low):
                    counts[f"{name} ({label})"] = counts.get(f"{name} ({label})", 0) + 1
    listed = ", ".join(
        f"{label}: {count}" for label, count in sorted(counts.items(), key=lambda item: -item[1])
    )
    return f"Sides of the box on which members lie, and how many: {listed or 'none'}."


def page(
    result: dict[str, Any], judged: dict[str, Any], flights: int, south: dict[str, float]
) -> str:
    """Return the page."""
    members, shipped = result["ensemble"], judged[ABHV]
    for member in judged.values():
        if any(
            member["margins"][law]["fault"] or member["lost"][law] or member["saturated"][law]
            for law in LAWS
        ):
            raise SystemExit("a member is unstable, loses a flight or saturates")
    class_traits = {member["name"]: member["class_traits"] for member in members}
    for name, label in (("ghame", "GHAME"), ("winged_cone", "winged cone")):
        vehicle = load_vehicle(ROOT / f"configs/vehicle/{name}.yaml")
        class_traits[label] = measure(vehicle, *find_trim(vehicle))
    disk = {
        law: between([member["margins"][law]["disk"] for member in judged.values()], 2)
        for law in LAWS
    }
    furthest = {}
    for law in LAWS:
        axes = [
            (axis, end)
            for axis, end in zip(AXES, shipped["ends"], strict=True)
            if law in end["dispersed"]
        ]
        share, label = max(
            (left_by(axis, end, law), f"Figure {axis.figure}, {axis.label}") for axis, end in axes
        )
        furthest[law] = f"{label} ({share:.0f} % of its width)"
    tables = {
        "FIGURES": figures(shipped),
        "VEHICLES": vehicles(members),
        "CLASS": table(class_traits),
        "CLAIM": claim(members, judged),
        "CLAIM_WORDS": claim_words(judged),
        "PREDICTIONS": predictions(result),
        "IMAGES": (f"![{title}](../images/{name}.png)\n" for name, title in IMAGES.items()),
    }
    facts = {
        "number": len(members),
        "searches": SEARCHES,
        **{
            f"ghame_{name}": f"{class_traits['GHAME'][name]:.2f}"
            for name in ("lift_to_drag", "thrust_to_weight")
        },
        "abhv": ABHV,
        "flights": flights,
        "south": f"{south['tlc']:.3f} km (TLC) and {south['lqr']:.3f} km (LQR)",
        "furthest_tlc": furthest["tlc"],
        "furthest_lqr": furthest["lqr"],
        "ends": ends_words(judged),
        "spread": spread_words(members),
        "sides": sides_words(members),
        "predicted": predicted_words(result),
        "disk_tlc": disk["tlc"],
        "disk_lqr": disk["lqr"],
    }
    paragraphs = []
    for paragraph in TEXT.strip().split("\n\n"):
        name = paragraph.strip("[]")
        paragraphs.append(
            "\n".join(map(wrapped, tables[name]))
            if name in tables
            else _paragraph(paragraph.format(**facts))
        )
    return "\n\n".join(paragraph.rstrip() for paragraph in paragraphs) + "\n"


def _paragraph(text: str) -> str:
    """Return a paragraph or a list wrapped for the page."""
    entries = text.replace("\n  ", " ").split("\n- ")
    if len(entries) == 1:
        return wrapped(text.replace("\n", " "))
    return "\n".join(
        wrapped("- " + entry.removeprefix("- ").replace("\n", " ")) for entry in entries
    )


def main() -> None:
    """Run the flights, and write the page and its figures."""
    parser = argparse.ArgumentParser(description="Set the ensemble beside the paper.")
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    check_gains()
    result = json.loads((ROOT / "studies/paper_vehicle.json").read_text(encoding="utf-8"))
    if arguments.smoke:
        print(judge(result["ensemble"][0]["values"], 2))
        return
    judged = {
        member["name"]: judge(member["values"], arguments.flights) for member in result["ensemble"]
    }
    target = ROOT / "studies/paper_vehicle_claim.json"
    target.write_text(json.dumps(judged, indent=1) + "\n", encoding="utf-8")
    values = next(member["values"] for member in result["ensemble"] if member["name"] == ABHV)
    flown = {
        law: fly_law(make_vehicle(values), make_mission(values), law, arguments.flights)[0]
        for law in LAWS
    }
    radius = 6378.0  # km, of the Earth
    latitude = {law: flown[law]["latitude_deg"][0] for law in LAWS}
    south = {
        law: radius * float(np.deg2rad(angles[0] - angles[-1])) for law, angles in latitude.items()
    }
    text = page(result, judged, arguments.flights, south)
    mirrored = {end["figure"]: end["mirrored"] for end in judged[ABHV]["ends"]}
    for name in IMAGES:
        if name == "paper_fig02":
            write_png(plot_track(flown), ROOT / f"docs/images/{name}.png")
            continue
        stem = name.partition("_")[2].partition("_")[2]
        channel = next(axis.channels[0] for axis in AXES if axis.channels[0].startswith(stem))
        write_png(plot_axis(channel, flown, mirrored), ROOT / f"docs/images/{name}.png")
    (ROOT / "docs/explanation/paper.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
