"""The claim's part on robust designs: five controllers of ghame_x in two boxes of uncertainties and in wide.yaml."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from experiment import ALLOWED, ERRORS, FOLLOWING, ROOT, USAGE, Floats, columns
from robust_flights import RIPPLE, Duel, Flown, box_a, random_flights

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.control.controller_file import read_controller
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.analysis import analyse
from abhv_mc.stability.linearize import linearize
from abhv_mc.stability.rows import make_rows
from abhv_mc.stability.steady import make_steady_plan, trim_points
from abhv_mc.statistics.paired import median_ratio
from abhv_mc.statistics.winner import decide

NAMES = {
    "tlc": "TLC, Table 1",
    "lqr": "LQR, the paper's weights",
    "lqr_retuned": "LQR retuned",
    "tlc_robust": "TLC robust",
    "lqr_robust": "LQR robust",
}
PAIRS = (("tlc", "lqr_retuned"), ("tlc", "lqr_robust"), ("tlc_robust", "lqr_robust"))
SHOWN = ("altitude_error_rms_m", "speed_error_rms_mps", *FOLLOWING)
HEADS = ("altitude m", "speed m/s", "alpha deg", "sideslip deg", "bank deg")
TRAVEL = ("aileron_travel_deg", "rudder_travel_deg", "elevator_travel_deg")
DELAYS_MS = (0, 20, 40, 60, 80)
FACTORS = {"aileron": (0.6, 0.7, 0.8, 1.2, 1.4), "rudder": (0.6, 0.8, 1.1, 1.2, 1.4)}


def paper_box(flights: int) -> Floats:
    """Random flights of the paper's box, ``[flight, parameter]``."""
    rows = nominal_parameters(flights)
    box_a(rows, np.random.default_rng(2014).uniform(-1.0, 1.0, (flights, 3)))
    return rows


def wide_flights() -> Floats:
    """The flights of wide.yaml, ``[flight, parameter]``."""
    campaign = read_campaign(ROOT / "campaigns/wide.yaml")
    return full_rows(campaign.names, campaign.make_samples().draw(0, campaign.runs))


@dataclass(frozen=True)
class Entrant:
    """One controller: its plan, its margins in level flight, and its flights by name of the box."""

    rows: list[dict[str, Any]]  # of stability.rows, nominal
    least: Floats  # (dB, deg, ms) over the corners of the paper's box
    flown: dict[str, Flown]


def enter(duel: Duel, name: str, boxes: dict[str, Floats]) -> Entrant:
    """Margins and flights of a controller."""
    controller = read_controller(ROOT / f"configs/control/{name}.yaml")
    plan = make_plan(duel.vehicle, duel.mission, controller, name)
    steady = make_steady_plan(duel.vehicle, duel.mission, controller, name)
    nominal = nominal_parameters()
    rows = make_rows(name, None, analyse(linearize(steady, trim_points(steady, nominal).points)))
    least = duel.margins(plan, steady)[1:, :3].min(axis=0)
    return Entrant(rows, least, {box: duel.fly(plan, rows_) for box, rows_ in boxes.items()})


def ends(values: Floats) -> str:
    """'median / worst'."""
    return f"{np.median(values):.3g} / {values.max():.3g}"


def flight_table(entrants: dict[str, Entrant], box: str) -> Iterator[str]:
    """A row for each controller: how its flights went."""
    heads = ("controller", "ended early", f"cycle > {RIPPLE:g} deg", *HEADS, *(t.split("_")[0] for t in TRAVEL))
    yield f"| {' | '.join(heads)} |"
    yield "|" + "---|" * len(heads)
    for name, entrant in entrants.items():
        flown = entrant.flown[box]
        kept = ~np.isnan(flown.ripples)
        cells = [ends(flown.errors[kept, ERRORS.index(metric)]) for metric in SHOWN]
        cells += [ends(flown.usage[kept, USAGE.index(metric)]) for metric in TRAVEL]
        count = len(flown.ripples)
        yield f"| {NAMES[name]} | {flown.lost} of {count} | {flown.cycling} | {' | '.join(cells)} |"


def margin_table(entrants: dict[str, Entrant]) -> Iterator[str]:
    """Margins of each loop in level flight."""
    yield "| controller | aileron | rudder | elevator | throttle | least at the corners of box (a) |"
    yield "|---|---|---|---|---|---|"
    for name, entrant in entrants.items():
        *loops, together = entrant.rows
        if not together["stable"]:
            poles = ", ".join(f"{real:+.3f} ± {imaginary:.2f}j" for real, imaginary in together["poles"] if real > 0.0)
            yield f"| {NAMES[name]} | unstable: poles {poles} per second | | | | |"
            continue
        cells = [
            f"{side(row['gain_margin_low_db'])} / {side(row['gain_margin_high_db'])} dB, "
            + ("any phase" if row["phase_margin_deg"] is None else f"{row['phase_margin_deg']:.0f} deg")
            + ("" if row["delay_margin_ms"] is None else f", {row['delay_margin_ms']:.0f} ms")
            for row in loops
        ]
        least = f"{entrant.least[0]:.1f} dB, {entrant.least[1]:.0f} deg, {entrant.least[2]:.0f} ms"
        yield f"| {NAMES[name]} | {' | '.join(cells)} | {least} |"


def side(value: float | None) -> str:
    """A gain margin."""
    return "none" if value is None else f"{value:.1f}"


def verdicts(entrants: dict[str, Entrant], box: str) -> Iterator[str]:
    """The claim for each pair: who follows which command closer, and at how much usage."""
    for a, b in PAIRS:
        one, other = entrants[a].flown[box], entrants[b].flown[box]
        lost_a, lost_b = np.isnan(one.ripples), np.isnan(other.ripples)
        won: dict[str, list[str]] = {"a": [], "b": [], "": []}
        for metric, words in zip(FOLLOWING, ("angle of attack", "sideslip", "bank"), strict=True):
            i = ERRORS.index(metric)
            ours, theirs = (
                np.where(lost, np.inf, flown.errors[:, i]) for lost, flown in ((lost_a, one), (lost_b, other))
            )
            ratio = median_ratio(ours, theirs)
            found = decide(ours, theirs, lost_a, lost_b, len(FOLLOWING)).winner
            won[found].append(f"{words} ({ratio.value:.2f})" if ratio else words)
        both = ~(lost_a | lost_b)
        used = np.median(other.usage[both] / one.usage[both], axis=0)
        parts = [
            f"{label}: {', '.join(won[key])}"
            for key, label in (("a", f"**{NAMES[a]}** closer in"), ("b", f"**{NAMES[b]}** closer in"), ("", "even"))
            if won[key]
        ]
        yield (
            f"- {NAMES[a]} against {NAMES[b]}: {'; '.join(parts)}. {NAMES[b]} uses {used.min():.2f} to "
            f"{used.max():.2f} times the surfaces (rms and travel, median over the flights)."
        )


def tolerance_table(duel: Duel, entrants: dict[str, Entrant]) -> Iterator[str]:
    """Flights of the nominal vehicle but for one delay or one effectiveness: the largest settled bank error."""
    from abhv_mc.plant.parameters import PARAMETER_INDEX

    settings = [("sensor.delay", d * 1e-3, f"delay {d} ms") for d in DELAYS_MS]
    settings += [
        (f"control.{surface}_effectiveness", factor, f"{surface} x {factor:g}")
        for surface, factors in FACTORS.items()
        for factor in factors
    ]
    rows = nominal_parameters(len(settings))
    for row, (parameter, value, _) in zip(rows, settings, strict=True):
        row[PARAMETER_INDEX[parameter]] = value
    yield f"| controller | {' | '.join(words for *_, words in settings)} |"
    yield "|" + "---|" * (len(settings) + 1)
    for name in entrants:
        controller = read_controller(ROOT / f"configs/control/{name}.yaml")
        block = fly(make_plan(duel.vehicle, duel.mission, controller, name), rows)
        settled = columns(block, ("bank_error_settled_max_deg",))[:, 0]
        lost = block.outcome != Outcome.OK
        cells = ["lost" if gone else f"{error:.1f}" for gone, error in zip(lost, settled, strict=True)]
        yield f"| {NAMES[name]} | {' | '.join(cells)} |"


def effectiveness_condition(duel: Duel) -> float:
    """Condition of the angular accelerations of roll and yaw by aileron and rudder at the trim."""
    plan = make_steady_plan(duel.vehicle, duel.mission, read_controller(ROOT / "configs/control/tlc.yaml"), "tlc")
    nominal = nominal_parameters()
    slopes = linearize(plan, trim_points(plan, nominal).points).plant_B[0]
    return float(np.linalg.cond(slopes[np.ix_([path.P, path.R], [0, 1])]))


def robust_section(flights: int) -> Iterator[str]:
    """The page's part on robust designs."""
    duel = Duel("ghame_x", "tlc")
    boxes = {"a": paper_box(flights), "b": random_flights(flights, 2016), "wide": wide_flights()}
    entrants = {name: enter(duel, name, boxes) for name in NAMES}
    yield "## Robust designs, `ghame_x`"
    yield ""
    yield (
        "Box (a) is the paper's: density and lift ±10 %, drag ±15 % (other draws than in the tables by vehicle, so "
        "that numbers differ in the last digit). Box (b) adds control effectiveness ±20 % of "
        "each surface and a delay of the measurement of 0 to 40 ms. TLC robust and LQR robust come from "
        "`studies/robust.py`, which gives both laws the same limits: margins of at least 6 dB, 35 deg and 40 ms in "
        "every loop (4.5 dB, 30 deg and 30 ms at the corners of box (a)), no flight of box (b) lost or cycling, and "
        f"Table 1's usage x {ALLOWED}; LQR's weights are free, and TLC's bandwidths and dampings of the two inner "
        "sub-loops, an outer bandwidth below the inner one. A flight cycles where the error of an angle swings by more "
        f"than {RIPPLE:g} deg to and fro in settled stretches."
    )
    yield ""
    yield "Margins in level flight (gain down / up, phase, delay; each loop broken at its actuator):"
    yield ""
    yield from margin_table(entrants)
    yield ""
    for box, words in (("a", "Box (a)"), ("b", "Box (b)")):
        yield f"### {words}, {flights} flights of each, rms errors and surface travel (deg), median / worst"
        yield ""
        yield from flight_table(entrants, box)
        yield ""
        yield from verdicts(entrants, box)
        yield ""
    yield "### What each tolerates: largest settled bank error (deg), the nominal vehicle but for one number"
    yield ""
    yield from tolerance_table(duel, entrants)
    yield ""
    yield f"### `wide.yaml`, {len(boxes['wide'])} flights of each, 24 parameters"
    yield ""
    yield from flight_table(entrants, "wide")
    yield ""
    yield (
        "Why Table 1 bears so little: TLC inverts the effectiveness of aileron and rudder in roll and yaw, a matrix of "
        f"condition {effectiveness_condition(duel):.0f}; an error of some percent in one surface's effectiveness leaks "
        "many times as large into the other axis."
    )
    yield ""
