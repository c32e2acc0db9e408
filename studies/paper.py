"""Comparison with the paper's figures and claim: docs/explanation/paper*.md and their figures.

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
from paper_vehicle import LEVELS
from paper_vehicle_box import BASE, MACH, make_mission, make_vehicle
from paper_vehicle_claim import fly_law, judge
from paper_vehicle_export import ABHV
from paper_vehicle_flights import AXES, CONTROLLERS, LAWS, READING, TRAITS
from paper_vehicle_sides import (
    SIDES,
    SPEED,
    control_powers,
    excesses,
    find_trim,
    measure,
    polar,
    shown,
    table,
)
from paper_vehicle_tables import (
    figures,
    largest_misses,
    powers,
    with_ranges,
)

from abhv_mc.control.controller_file import TlcController
from abhv_mc.topics.figure_style import write_png
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.pack import nodes_of

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
REDUCED = 7  # number of members whose pitch damping the rules of paper_vehicle.py reduced
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
# Comparison with the figures of Zhu and Shen (2014)

Zhu and Shen (2014) publish neither their vehicle's tables nor the formula of their S manoeuvre, and show flights only in figures. Therefore `studies/paper_vehicle.py` searched for vehicles that reproduce Figures 3 to 11 with the printed gains (Table 1) and LQR weights, and found {number}. A conclusion is supported if it holds for all
{number} vehicles. `studies/paper.py` writes this page.

- `configs/control/tlc.yaml` contains the gains of Table 1, with the paper's differentiator bandwidths of 0.3
  and 1.5 rad/s, and `configs/control/lqr.yaml` contains the printed weights.
- An automatically scaled axis ends within one tick interval of the data, so each axis limit gives an interval for an extreme value of the data, with a reading error of 2 % of the axis. The axes of Figures 4, 6, 8, 9, 10
  and 11 (one for both controllers) and of Figures 5 and 7 (one for each controller) have 20 limits. Figure 3 and the insets of Figure 7 give only bounds.
- The S manoeuvre starts to the right. The paper does not state the signs of sideslip and deflections; in the table, "mirrored" marks an opposite sign convention.
- The time in the paper is the time in abhv-mc plus 180 s.

## Figure by figure

The default vehicle `abhv` is member {abhv} of the ensemble (`configs/vehicle/abhv.yaml`, with
`configs/mission/paper_s.yaml`). The last column is the largest distance by which {flights} flights under the
paper's dispersions (10, 10 and 15 % in density, lift and drag) exceed the axis, in percent of the axis width. The flight in the paper may be dispersed.

[FIGURES]

In Figure 2, the track ends {south} south of the initial parallel (paper: 5 km).

## The ensemble

The {number} vehicles are the largest set among the candidates of about {searches} searches in which any two vehicles differ by a factor of 1.5 or more, or in sign, in at least three of the eight traits. For each candidate, at least 18 of the 20 extremes are inside their intervals, no extreme is outside by more than 20 % of the axis, and the properties are [plausible](paper-vehicles.md). The trim angle of attack is at least 0.1 deg from the nodes of the tables, and the surfaces do not saturate.
`studies/paper_vehicle.json` contains the traits of each member.
`python studies/paper_vehicle.py` selects the members from stored search results, with
[rules](paper-vehicles.md#pitch-and-yaw-damping) for pitch and yaw damping.

{spread}

{ends}

## The claim, with the printed gains

The paper claims: "With nearly the same amount of control surface usage, TLC has a better performance in
tracking angle of attack, sideslip angle and bank angle commands." The following numbers compare the rms errors of
{flights} dispersed flights of each member, over the whole flight and outside the transients (the ramps of the bank angle and the 5 s after each ramp).

[CLAIM_WORDS]

TLC and LQR are stable in level flight on every member (smallest disk margins {disk_tlc} for TLC, {disk_lqr} for LQR),
and no flight terminates early. `studies/paper_vehicle_claim.json` contains the results of each member.

For the bank angle, the result depends on the time window. During a ramp, the faster attitude loop has the smaller error:
the bandwidth is 2 x 3.4 x 0.3 = 2.0 rad/s with Table 1 and sqrt(2.28e5 / 3.28e3) = 8.3 rad/s with the
printed weights. Outside the transients, the static error is decisive; it is smaller for TLC, because TLC inverts the model and integrates errors.

The page on [the claim](claim.md) compares controllers that were tuned within the same limits. On a vehicle
that does not reproduce the figures (`campaigns/harder_vehicle.yaml`, with GHAME's coefficients and bank
steps), LQR with the printed weights is unstable, and TLC with the gains of Table 1 saturates the surfaces.

## Prediction of one figure from the others

For each figure, three vehicles were fitted from random starts to all other figures. {predicted}

## The figures

The grey area is the range of the paper's axis. Solid lines are nominal flights of `abhv`; dotted
lines are their commands. The shaded area contains all {flights} dispersed flights.

[IMAGES]
"""

PLAUSIBILITY = """
# Plausibility of the paper's vehicles

Vehicles that could not be built may also reproduce the figures, so each member of the [ensemble](paper.md#the-ensemble) satisfies the limits below (checked by `python studies/paper_vehicle_sides.py`);
`abhv` is `seed-2`. The limits on lift, drag and L/D cover all Mach numbers of the tables; all other limits
apply at the Mach number of the S manoeuvre, 4.74, and no member was designed for flight far from this Mach number.
The search scales GHAME's tables to a vehicle length of 8.6 m, slightly more than that of an X-51 with booster. The wing loading was chosen freely, because a common factor on mass, inertias, coefficients and cowl area changes no flight. The drag is `CD = CD0 g(M) + k |CL tan(alpha - alpha_0)|`, with GHAME's dependence on the Mach
number, and deflections cause no drag. The tables of all members begin at Mach 2.

[CLASS]

- The limit on L/D is Kuechemann's 4 (M + 3)/M, which is 6.5 at Mach 4.74, and the limits on the wing loading include
  the 380 kg/m2 of the X-43A (Marshall et al., AIAA 2005-3332).
- In quasi-steady flow, the rudder alone cannot damp yaw more than the whole vehicle does.
- The radius of pitch damping is the distance from the centre of gravity at which quasi-steady lift would give the vehicle's Cm_q = -2 CL_alpha (radius/chord)^2. The radius and the arms of rudder and elevator are at most half of the vehicle's length.
- The other limits are engineering judgement.

The limits, not only the figures, determine some traits. On at least half of the members, the following traits are near a limit (number of members in brackets): {near}.

GHAME itself violates {ghame_outside} of these {sides_number} limits: its trimmed L/D is {ghame_lift_to_drag} (the maximum is {ghame_best:.2f}, at {ghame_best_alpha:.0f} deg), and its thrust-to-weight ratio is {ghame_thrust_to_weight}. In
Figure 11, the equivalence ratio rises from about 0.84 in straight flight to about 1.2 at 50 deg of bank. With induced
drag, such an increase requires an L/D of 3 to 5, so the paper did not use GHAME's drag. The conclusion depends on
GHAME's [specific impulse](theory.md#limits-of-the-model), which the members share and which rises with the
equivalence ratio, whereas that of a real hydrogen ramjet usually decreases. Slender lifting bodies reach an L/D of 3
([NASA SP-4220](https://history.nasa.gov/SP-4220/ch8.htm)); the L/D of the members is higher, like that of waveriders.

## Pitch and yaw damping

The figures do not determine the damping. The eight searches that led to the members (stored results:
`studies/paper_vehicle_starts.json`) had
no limit on the radius of pitch damping or on the yaw damping of the rudder. The command `OPENBLAS_NUM_THREADS=1 python
studies/paper_vehicle.py` applies these limits by three rules, simulates each vehicle again and selects the largest set
of sufficiently different vehicles:

- A radius of pitch damping of more than 4.3 m is reduced to 4.2 m.
- Variants of each vehicle have less pitch damping, at levels that decrease from that of `abhv` by factors of {level:.2f}. A variant is selected only if the original vehicle is too similar to other members.
- If the rudder alone damps yaw more than the vehicle, the magnitude of Cn_r is increased by whole percents until the
  rudder's share is at most 0.99.

The rules reduced the magnitude of Cm_q on {reduced} members (`abhv`: from -3.46 to {abhv_damping:.2f}) and increased the magnitude of
Cn_r by 4 % on `seed-16` and by 13 % on `seed-23`. The changes in damping moved no extreme of the curves by more than 5 % of the axis range, or out of its interval. The limit on the radius would be reached only if all lift acted at
nose and tail: the radius is 2.5 m for lift distributed uniformly along the body, and 3.1 m for GHAME. The pitch damping of
`abhv` is thus large, but a smaller value would change no figure.

With the options `--fresh --searches 19`, the command starts from `abhv` alone and applies all limits in the searches. The 2567 simulated vehicles include 5 members, among them `abhv`. All satisfy the limits above, at least 18 extremes are inside their intervals, and the largest deviation is 15 % of an axis (16 % for the stored members). This search thus finds similar vehicles, but fewer than eight.

## Control powers

The derivatives are per radian and apply at the trim point.

[POWERS]

The deflections in the paper's figures determine the control powers; no layout of the surfaces was assumed. The
aileron of `abhv` is {aileron_ratio:.1f} times as powerful as GHAME's, and the rudder {rudder_ratio:.0f} times as powerful, but the
elevator produces only {elevator_ratio:.1f} times the lift of GHAME's elevator. No elevons could provide these powers, but
separate all-moving surfaces with the lift slope of a thin plate, 4/sqrt(M^2 - 1), could, with at least
{aileron_area:.0f} % of the reference area at the wing tips for the aileron, and {rudder_area:.0f} % for the
rudder. The flights use about 1 deg of aileron and 0.4 deg of rudder; at 20 deg of aileron, the roll rate would be
{roll_rate:.0f} rad/s, which no structure would withstand. The figures do not show whether the paper's vehicle had such powerful surfaces, whether its tables were not
those of an aircraft, or whether its size, wing loading and inertias differ from those chosen here.
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
        ("settled", "Outside the transients"),
    ):
        phrases = [
            f"{name.replace('_', ' ')} in {between(closer(judged, window, name))} % of the flights "
            f"(median error {between(ratios(judged, window, name), 2)} times that of LQR)"
            for name in ("angle_of_attack", "sideslip", "bank")
        ]
        yield (
            f"- {label}, TLC has the smaller error in {phrases[0]}, in {phrases[1]}, and in "
            f"{phrases[2]}."
        )
    uses = {
        surface: [
            member["use"][surface]["tlc"] / member["use"][surface]["lqr"]
            for member in judged.values()
        ]
        for surface in ("aileron", "rudder", "elevator")
    }
    of_lqr = join([f"{between(use, 2)} ({surface})" for surface, use in uses.items()])
    yield f"- The median control effort (rms) of TLC relative to that of LQR is {of_lqr}."


def ends_words(judged: dict[str, Any]) -> str:
    """Return sentences on the ends inside and outside their intervals."""
    outside = [
        (end["figure"], miss)
        for member in judged.values()
        for end in member["ends"]
        for miss in end["misses"]
        if miss > READING
    ]
    full = [name for name, member in judged.items() if all_in(member)]
    inside = f"All 20 extremes are inside their intervals for {join(full) or 'no member'}."
    if not outside:
        return inside
    numbers = join([str(figure) for figure in sorted({figure for figure, _ in outside})])
    return (
        f"{inside} The other members have {len(outside)} extremes in all outside their intervals, by up to "
        f"{100.0 * max(miss for _, miss in outside):.0f} % of the axis, in Figures {numbers}."
    )


def all_in(member: dict[str, Any]) -> bool:
    """Return whether every end of a member is in its interval."""
    return all(miss <= READING for end in member["ends"] for miss in end["misses"])


def predicted_words(result: dict[str, Any]) -> str:
    """Return a sentence on the figures that the fitted vehicles predict, or do not predict."""
    near, far = [], []
    for label, misses in largest_misses(result).items():
        if max(misses) <= NEAR:
            near.append(label)
        else:
            percents = between([100.0 * miss for miss in misses])
            far.append(f"{label} ({percents} %)")
    return (
        f"The fitted vehicles predict {join(near)} with errors of at most {100.0 * NEAR:.0f} % of the "
        f"paper's axis. The errors of at least one vehicle are larger for {join(far)}. Agreement with "
        "these figures is therefore not an independent test of a vehicle."
    )


def join(items: list[str]) -> str:
    """Return a list as text: 'a, b and c'."""
    return ", ".join(items[:-1]) + f" and {items[-1]}" if len(items) > 1 else "".join(items)


def spread_words(members: list[dict[str, Any]]) -> str:
    """Return a sentence on the spread of each trait over the members."""
    shares = {}
    for name in TRAITS:
        sizes = [abs(member["traits"][name]) for member in members]
        shares[name.replace("_", " ")] = max(sizes) / min(sizes)
    listed = ", ".join(
        f"{share:.1f} ({name})" for name, share in sorted(shares.items(), key=lambda item: item[1])
    )
    return (
        f"The ratio of the largest to the smallest magnitude of each trait is {listed}. The figures "
        "determine only the traits whose ratio is near 1."
    )


def near_words(members: list[dict[str, Any]]) -> str:
    """Return the traits near a limit on at least half of the members, with their number."""
    counts = {}
    for name, side in SIDES.items():
        traits = [member["class_traits"][name] for member in members]
        ends = (side.low, side.high)
        near = sum(min(abs(trait - end) for end in ends) <= 0.1 * side.unit for trait in traits)
        if 2 * near >= len(members):
            counts[side.label] = near
    return "; ".join(f"{label} ({count})" for label, count in counts.items())


def plausibility(members: list[dict[str, Any]]) -> str:
    """Return the page on the plausibility of the vehicles."""
    class_traits = {member["name"]: member["class_traits"] for member in members}
    surfaces = {}
    for member in members:
        vehicle = make_vehicle(member["values"])
        surfaces[member["name"]] = control_powers(vehicle, *find_trim(vehicle)[:2])
    for name, label in (("ghame", "GHAME"), ("winged_cone", "winged cone")):
        vehicle = load_vehicle(ROOT / f"configs/vehicle/{name}.yaml")
        point = find_trim(vehicle)
        class_traits[label] = measure(vehicle, *point)
        surfaces[label] = control_powers(vehicle, *point[:2])
    ratio = {name: x / surfaces["GHAME"][name] for name, x in surfaces[ABHV].items()}
    ghame = load_vehicle(ROOT / "configs/vehicle/ghame.yaml")
    plate_slope = 4.0 / np.sqrt(MACH**2 - 1.0)
    alphas = nodes_of(ghame.tables, "angle_of_attack")
    lift, drag = polar(ghame, MACH, alphas)[:2]
    lift_to_drag = lift / drag
    facts = {
        "near": near_words(members),
        "sides_number": len(SIDES),
        "ghame_outside": np.count_nonzero(excesses(class_traits["GHAME"])),
        **{
            f"ghame_{name}": f"{class_traits['GHAME'][name]:.2f}"
            for name in ("lift_to_drag", "thrust_to_weight")
        },
        "aileron_ratio": ratio["Cl_da"],
        "rudder_ratio": ratio["Cn_dr"],
        "elevator_ratio": ratio["CL_de"],
        "aileron_area": 200.0 * surfaces[ABHV]["Cl_da"] / plate_slope,
        "rudder_area": 100.0 * surfaces[ABHV]["CY_dr"] / plate_slope,
        "ghame_best": lift_to_drag.max(),
        "ghame_best_alpha": np.rad2deg(alphas[lift_to_drag.argmax()]),
        "roll_rate": surfaces[ABHV]["steady roll p b/2V at 20 deg of aileron"]
        * 2.0
        * SPEED
        / BASE.constants.span,
        "reduced": REDUCED,
        "level": LEVELS[0],
        "abhv_damping": class_traits[ABHV]["pitch_damping"],
    }
    names = [member["name"] for member in members]
    tables = {
        "CLASS": table({name: shown(traits) for name, traits in class_traits.items()}),
        "POWERS": powers(with_ranges(surfaces, names, ABHV)),
    }
    return _fill(PLAUSIBILITY, tables, facts)


def page(
    result: dict[str, Any], judged: dict[str, Any], flights: int, south: dict[str, float]
) -> str:
    """Return the page of the comparison."""
    members, shipped = result["ensemble"], judged[ABHV]
    for member in judged.values():
        if any(
            member["margins"][law]["fault"] or member["lost"][law] or member["saturated"][law]
            for law in LAWS
        ):
            raise SystemExit("a member is unstable, loses a flight or saturates")
    disk = {
        law: between([member["margins"][law]["disk"] for member in judged.values()], 2)
        for law in LAWS
    }
    tables = {
        "FIGURES": figures(shipped),
        "CLAIM_WORDS": claim_words(judged),
        "IMAGES": (f"![{title}](../images/{name}.png)\n" for name, title in IMAGES.items()),
    }
    facts = {
        "number": len(members),
        "searches": SEARCHES,
        "abhv": ABHV,
        "flights": flights,
        "south": f"{south['tlc']:.3f} km (TLC) and {south['lqr']:.3f} km (LQR)",
        "disk_tlc": disk["tlc"],
        "disk_lqr": disk["lqr"],
        "ends": ends_words(judged),
        "spread": spread_words(members),
        "predicted": predicted_words(result),
    }
    return _fill(TEXT, tables, facts)


def _fill(text: str, tables: dict[str, Iterator[str]], facts: dict[str, Any]) -> str:
    """Return the text of a page with its tables and numbers."""
    paragraphs = []
    for paragraph in text.strip().split("\n\n"):
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
    (ROOT / "docs/explanation/paper-vehicles.md").write_text(
        plausibility(result["ensemble"]), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
