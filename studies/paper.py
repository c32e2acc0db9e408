"""Comparison with the paper's figures and claim: docs/explanation/paper*.md and their figures.

    OPENBLAS_NUM_THREADS=1 python studies/paper.py [--flights N] [--all]

The vehicle abhv, and with `--all` each vehicle of studies/paper_vehicle.json (made by
paper_vehicle.py), is simulated with the paper's dispersions. The paper (Zhu and Shen 2014) gives no
data, but the ends of the axes of its Figures 3 to 11. All results are written to
studies/paper_vehicle_claim.json. Sentences with numbers are generated, and the script stops if a
sentence would no longer be true.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from experiment import ROOT, wrapped
from paper_figures import plot_axis, plot_track
from paper_vehicle import STRICT, broken_limits, select_members
from paper_vehicle_box import BASE, MACH
from paper_vehicle_claim import fly_law, judge
from paper_vehicle_envelope import ENVELOPE, measure_envelope
from paper_vehicle_flights import (
    AXES,
    CONTROLLERS,
    LAWS,
    TRAITS,
    in_insets,
    strict_ends,
)
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
from robust_flights import read_case

from abhv_mc.topics.figure_style import write_png
from abhv_mc_vehicle.control.controller_file import TlcController
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.table_file import nodes_of

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
ABHV = "abhv"
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

Zhu and Shen (2014) publish neither their vehicle's tables nor the formula of their S manoeuvre, and show flights only in figures. The default vehicle `abhv` was found by a search for vehicles that reproduce Figures 3 to 11 with the printed gains (Table 1) and LQR weights, within [limits](paper-vehicles.md) of their class and over a box of flight conditions. {earlier} earlier vehicles, from other searches with a tolerance of 2 % and without the limits of the box, show how far the results depend on the vehicle. Each vehicle has its own S manoeuvre and its own limits: compare TLC with LQR on one vehicle, not vehicles with each other.

- The printed gains and weights are in `configs/control/tlc.yaml` and `lqr.yaml`.
- An automatically scaled axis ends within one tick interval of the data, so each axis limit gives an interval for an extreme value of the data. The axes of Figures 4, 6, 8, 9, 10 and 11 (one for both controllers) and of Figures 5 and 7 (one for each) have 20 limits. They are printed numbers and are counted without tolerance. Figure 3 and the insets of Figure 7 give only bounds.
- The axis of LQR's inset in Figure 7 (40, 50, 60) is assumed to be automatic: the maximum is then between 50 and 60 deg, for TLC (40 to 55) between 50 and 55 deg.
- The paper does not state the signs of sideslip and deflections; "mirrored" marks an opposite sign convention.
- The time in the paper is the time in abhv-mc plus 180 s.

## Figure by figure

The vehicle is `configs/vehicle/abhv.yaml`, with `configs/mission/paper_s.yaml`. The last column is the largest distance by which {flights} flights under the
paper's dispersions exceed the axis, in percent of its width.

[FIGURES]

In Figure 2, the track ends {south} south of the initial parallel (paper: 5 km).

## The vehicles

{members} A member has at least {strict} of the 20 ends, is in both insets and breaks no limit. The last columns give the share of flights in which TLC has the smaller rms error in bank over the whole flight, and the ratio of the median errors.

[VEHICLES]

{insets}

The earlier vehicles are the largest set among the candidates of about {searches} searches (`studies/paper_vehicle.py`) in which any two differ by a factor of 1.5 or more, or in sign, in at least three of eight traits; at least 18 of their ends are within 2 % of their intervals. Those searches have no limits of the box: with GHAME's nodes and specific impulse, and without inclined thrust, three of these limits cannot be satisfied. {spread}

## The claim, with the printed gains

The paper claims: "With nearly the same amount of control surface usage, TLC has a better performance in
tracking angle of attack, sideslip angle and bank angle commands." The following numbers compare the rms errors, relative to each controller's own command, of
{flights} dispersed flights of `abhv`, and in brackets the range of all {number} vehicles, over the whole flight and outside the transients (the ramps of the bank angle and the 5 s after each ramp).

[CLAIM]

The median control effort (rms) of TLC relative to that of LQR is {efforts}. By travel, TLC uses 0.93 (aileron), 1.10 (rudder) and 1.12 (elevator) times that of LQR on `abhv`; its elevator loop crosses over at 8.3 rad/s, that of LQR at 2.9.

TLC and LQR are stable in level flight on every vehicle (smallest disk margins {disk_tlc} and {disk_lqr}),
and no flight terminates early.

In bank, the faster attitude loop has the smaller error during a ramp: the bandwidth is 2 x 3.4 x 0.3 = 2.0 rad/s with
Table 1 and 0.2605 / 0.0635 = 4.1 rad/s with the printed weights (gains by bank and roll rate). Outside the transients,
the static error decides: TLC's loops have integrals, LQR has none. Its throttle loop crosses over at 0.03 rad/s (TLC:
0.89), hence the speed errors in Figure 3. By the largest error instead of the rms, LQR is closer in bank in all flights
of the default campaign.

The page on [the claim](claim.md) compares controllers tuned within the same limits, and thrust lines.

## Prediction of one figure from the others

For each figure, three vehicles were fitted from random starts to all other figures. {predicted}

## The figures

Grey: range of the paper's axis. Solid: nominal flights of `abhv`. Dotted: their commands. Shaded: all {flights} dispersed flights.

[IMAGES]
"""

PLAUSIBILITY = """
# Plausibility of the paper's vehicles

Vehicles that could not be built may also reproduce the figures. The default vehicle `abhv` satisfies the limits of its class and of its box below (`studies/paper_vehicle_sides.py`, `studies/paper_vehicle_envelope.py`); the [earlier vehicles](paper.md#the-vehicles) satisfy those of the class only. The limits on lift, drag and L/D cover all Mach numbers of each vehicle's tables and its own range of angle of attack, the other limits of the class apply at Mach 4.74, at each vehicle's own trim: a row shows whether limits are satisfied, and does not rank vehicles.
GHAME's tables are scaled to a length of 8.6 m, slightly more than that of an X-51 with booster. The wing loading was chosen freely, because a common factor on mass, inertias, coefficients and cowl area changes no flight. Deflections cause no drag.

[CLASS]

- The limit on L/D is Kuechemann's 4 (M + 3)/M, which is 6.5 at Mach 4.74, and the limits on the wing loading include
  the 380 kg/m2 of the X-43A (Marshall et al., AIAA 2005-3332).
- In quasi-steady flow, the rudder alone cannot damp yaw more than the whole vehicle does.
- The radius of pitch damping is the distance from the centre of gravity at which quasi-steady lift would give the vehicle's Cm_q = -2 CL_alpha (radius/chord)^2. The radius and the arms of rudder and elevator are at most half of the vehicle's length.
- The other limits are engineering judgement.
- The figures do not determine pitch and yaw damping; `studies/paper_vehicle.py` limits those of the earlier vehicles by rules.

GHAME itself violates {ghame_outside} of these {sides_number} limits: its trimmed L/D is {ghame_lift_to_drag} (at most {ghame_best:.2f}, at {ghame_best_alpha:.0f} deg). In
Figure 11, the equivalence ratio rises from about 0.84 in straight flight to about 1.2 at 50 deg of bank. With induced
drag, such an increase requires an L/D of 3 to 5, so the paper did not use GHAME's drag. Slender lifting bodies reach an L/D of 3
([NASA SP-4220](https://history.nasa.gov/SP-4220/ch8.htm)), waveriders a higher one.

## The box

The tables of `abhv` have nodes at every degree and half Mach number of the box: Mach 4 to 5.5, angle of attack -1 to 12 deg, sideslip within 5 deg, altitude 18 to 24 km. A flight that leaves the box ends, and `abhv-mc trim` warns. The table gives the least favourable values at given Mach number, angle of attack and altitude, trimmed or not.

[BOX]

The thrust of `abhv` is inclined, so that it adds to the lift and, with its offset, to the pitching moment. The captured air increases up to 11 deg of angle of attack; beyond this angle, the inlet spills. The specific impulse decreases with the equivalence ratio, unlike [GHAME's](theory.md#limits-of-the-model). The rudder's limit of 6 deg and the nose radius of 5 mm (X-43A: 0.8 mm at less than half the length) were chosen.

## Control powers

The derivatives are per radian and apply at the trim point.

[POWERS]

The deflections in the paper's figures determine the control powers. The
aileron of `abhv` is {aileron_ratio:.1f} times as powerful as GHAME's, and the rudder {rudder_ratio:.0f} times as powerful, but the
elevator produces only {elevator_ratio:.1f} times the lift of GHAME's elevator. All-moving surfaces with the lift slope of a thin plate, 4/sqrt(M^2 - 1), need at least
{aileron_area:.0f} % of the reference area at the wing tips for the aileron, and {rudder_area:.0f} % for the
rudder. The flights use about 1 deg of aileron and 0.4 deg of rudder; at full aileron (20 deg), the steady roll rate would be
p b/2V = {roll:.2f}, or {roll_rate:.0f} rad/s, which no structure would withstand. All vehicles with the deflections of Figure 8 have such rates.
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


def of_abhv(judged: dict[str, Any], value: Callable[[Any], float], digits: int = 0) -> str:
    """Return the number of abhv, and in brackets the range of all vehicles."""
    values = between([value(result) for result in judged.values()], digits)
    return f"{value(judged[ABHV]):.{digits}f} ({values})"


def claim_table(judged: dict[str, Any]) -> Iterator[str]:
    """Yield the table on the claim: numbers of abhv, and ranges of all vehicles."""
    angles = ("angle_of_attack", "sideslip", "bank")
    yield f"| | {' | '.join(name.replace('_', ' ') for name in angles)} |"
    yield "|---|---|---|---|"
    for window, label in (("whole", "whole flight"), ("settled", "outside the transients")):
        closer = [
            of_abhv(judged, lambda x, n=name, w=window: x["claim"][w][n]["closer_percent"])
            for name in angles
        ]
        ratios = [of_abhv(judged, lambda x, n=n, w=window: error_ratio(x, w, n), 2) for n in angles]
        yield f"| {label}: flights with TLC closer, % | {' | '.join(closer)} |"
        yield f"| median error, TLC / LQR | {' | '.join(ratios)} |"


def effort_words(judged: dict[str, Any]) -> str:
    """Return the control effort of TLC relative to that of LQR, by surface."""
    uses = [
        f"{of_abhv(judged, lambda x, n=name: x['use'][n]['tlc'] / x['use'][n]['lqr'], 2)} {name}"
        for name in ("aileron", "rudder", "elevator")
    ]
    return join(uses)


def error_ratio(result: dict[str, Any], window: str, angle: str) -> float:
    """Return TLC's median error over LQR's."""
    errors = result["claim"][window][angle]
    return float(errors["tlc"] / errors["lqr"])


def vehicle_rows(judged: dict[str, Any]) -> Iterator[str]:
    """Yield a row for each vehicle: strict counts, insets, broken limits and bank."""
    yield (
        f"| vehicle | strict ends of 20 | in both insets | class limits broken, of {len(SIDES)} | box "
        f"limits broken, of {len(ENVELOPE)} | bank, TLC closer | bank, TLC / LQR |"
    )
    yield "|" + "---|" * 7
    for name, result in judged.items():
        counts = [f"{len(broken)}" for broken in broken_limits(result)]
        bank = result["claim"]["whole"]["bank"]["closer_percent"]
        yield (
            f"| `{name}` | {strict_ends(result['ends'])} | "
            f"{'yes' if in_insets(result['ends']) else 'no'} | {' | '.join(counts)} | {bank:.0f} % | "
            f"{error_ratio(result, 'whole', 'bank'):.2f} |"
        )


def inset_words(judged: dict[str, Any]) -> str:
    """Return a sentence on the bank of the vehicles inside the insets."""
    inside = [name for name, result in judged.items() if in_insets(result["ends"])]
    percents = [judged[name]["claim"]["whole"]["bank"]["closer_percent"] for name in inside]
    ratios = [error_ratio(judged[name], "whole", "bank") for name in inside]
    return (
        f"On the vehicles inside both insets ({join([f'`{name}`' for name in inside])}), TLC is closer in bank "
        f"in {between(percents)} % of the flights (median error {join([f'{x:.2f}' for x in ratios])} times "
        "that of LQR)."
    )


def member_words(judged: dict[str, Any]) -> str:
    """Return a sentence on the members and the strict counts of the other vehicles."""
    members = select_members(judged)
    if members != [ABHV]:
        raise SystemExit("abhv is not the only member")
    counts = {name: strict_ends(result["ends"]) for name, result in judged.items()}
    missed = [
        f"{end['axis']} in Figure {end['figure']} ({end['low']:.2f} to {end['high']:.2f})"
        for axis, end in zip(AXES, judged[ABHV]["ends"], strict=True)
        if axis.counts and max(end["misses"]) > 0.0
    ]
    others = between([count for name, count in counts.items() if name != ABHV])
    return (
        f"Without tolerance, {counts[ABHV]} of the 20 ends are in their intervals for `{ABHV}`, which is "
        f"the only member, and {others} for the earlier vehicles. An end outside is that of {join(missed)}."
    )


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
        f"paper's axis. The errors of at least one vehicle are larger for {join(far)}."
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
    low, *_, high = (
        f"{share:.1f} ({name})" for name, share in sorted(shares.items(), key=lambda item: item[1])
    )
    return (
        f"The ratio of the largest to the smallest magnitude of a trait is {low} to {high}: the figures "
        "hardly determine most traits."
    )


def plausibility(members: list[dict[str, Any]]) -> str:
    """Return the page on the plausibility of the vehicles."""
    vehicles = {
        name: read_case(name)[0] for name in (ABHV, *(member["name"] for member in members))
    }
    ghame = load_vehicle(ROOT / "configs/vehicle/ghame.yaml")
    vehicles |= {"GHAME": ghame}
    points = {name: find_trim(vehicle) for name, vehicle in vehicles.items()}
    class_traits = {name: measure(x, *points[name]) for name, x in vehicles.items()}
    surfaces = {name: control_powers(x, *points[name][:2]) for name, x in vehicles.items()}
    ratio = {name: x / surfaces["GHAME"][name] for name, x in surfaces[ABHV].items()}
    plate_slope = 4.0 / np.sqrt(MACH**2 - 1.0)
    alphas = nodes_of(ghame.tables, "angle_of_attack")
    lift, drag = polar(ghame, MACH, alphas)[:2]
    lift_to_drag = lift / drag
    roll = surfaces[ABHV]["steady roll p b/2V at 20 deg of aileron"]
    facts = {
        "sides_number": len(SIDES),
        "ghame_outside": np.count_nonzero(excesses(class_traits["GHAME"])),
        "ghame_lift_to_drag": f"{class_traits['GHAME']['lift_to_drag']:.2f}",
        "aileron_ratio": ratio["Cl_da"],
        "rudder_ratio": ratio["Cn_dr"],
        "elevator_ratio": ratio["CL_de"],
        "aileron_area": 200.0 * surfaces[ABHV]["Cl_da"] / plate_slope,
        "rudder_area": 100.0 * surfaces[ABHV]["CY_dr"] / plate_slope,
        "ghame_best": lift_to_drag.max(),
        "ghame_best_alpha": np.rad2deg(alphas[lift_to_drag.argmax()]),
        "roll": roll,
        "roll_rate": roll * 2.0 * SPEED / BASE.constants.span,
    }
    earlier = [member["name"] for member in members]
    tables = {
        "CLASS": table(with_ranges(class_traits, earlier, ABHV)),
        "BOX": table({"`abhv`": shown(measure_envelope(vehicles[ABHV]))}, ENVELOPE),
        "POWERS": powers(with_ranges(surfaces, earlier, ABHV)),
    }
    return _fill(PLAUSIBILITY, tables, facts)


def page(
    result: dict[str, Any], judged: dict[str, Any], flights: int, south: dict[str, float]
) -> str:
    """Return the page of the comparison."""
    members, shipped = result["ensemble"], judged[ABHV]
    for vehicle in judged.values():
        if any(
            vehicle["margins"][law]["fault"] or vehicle["lost"][law] or vehicle["saturated"][law]
            for law in LAWS
        ):
            raise SystemExit("a vehicle is unstable, loses a flight or saturates")
    disk = {
        law: between([vehicle["margins"][law]["disk"] for vehicle in judged.values()], 2)
        for law in LAWS
    }
    tables = {
        "FIGURES": figures(shipped),
        "VEHICLES": vehicle_rows(judged),
        "CLAIM": claim_table(judged),
        "IMAGES": (f"![{title}](../images/{name}.png)\n" for name, title in IMAGES.items()),
    }
    facts = {
        "number": len(judged),
        "earlier": len(members),
        "strict": STRICT,
        "searches": SEARCHES,
        "flights": flights,
        "south": f"{south['tlc']:.3f} km (TLC) and {south['lqr']:.3f} km (LQR)",
        "disk_tlc": disk["tlc"],
        "disk_lqr": disk["lqr"],
        "efforts": effort_words(judged),
        "members": member_words(judged),
        "insets": inset_words(judged),
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
    parser = argparse.ArgumentParser(description="Compare the vehicles with the paper.")
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--all", action="store_true", help="simulate the earlier vehicles, too")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    check_gains()
    result = json.loads((ROOT / "studies/paper_vehicle.json").read_text(encoding="utf-8"))
    if arguments.smoke:
        print(judge(*read_case(ABHV), 2))
        return
    target = ROOT / "studies/paper_vehicle_claim.json"
    judged = json.loads(target.read_text(encoding="utf-8"))
    names = (ABHV, *(member["name"] for member in result["ensemble"]))
    for name in names if arguments.all else (ABHV,):
        judged[name] = judge(*read_case(name), arguments.flights)
    target.write_text(json.dumps(judged, indent=1) + "\n", encoding="utf-8")
    flown = {law: fly_law(*read_case(ABHV), law, arguments.flights)[0] for law in LAWS}
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
