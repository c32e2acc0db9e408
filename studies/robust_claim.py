"""The claim's part on what the shipped designs bear on ghame_x, one number at a time."""

from collections.abc import Iterator

import numpy as np
from experiment import ROOT, columns
from robust_flights import Duel

from abhv_mc.control.controller_file import read_controller
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.prepare import make_plan
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.linearize import linearize
from abhv_mc.stability.steady import make_steady_plan, trim_points

NAMES = {
    "tlc": "TLC, Table 1",
    "lqr": "LQR, the paper's weights",
    "lqr_retuned": "LQR retuned",
    "tlc_robust": "TLC robust",
    "lqr_robust": "LQR robust",
}
DELAYS_MS = (0, 20, 40, 60, 80)
FACTORS = {"aileron": (0.6, 1.4), "rudder": (0.6, 1.4)}


def tolerance_table(plans: dict[str, FlightPlan]) -> Iterator[str]:
    """Flights of the nominal vehicle but for one delay or one effectiveness: the largest settled bank error."""
    settings = [("sensor.delay", d * 1e-3, f"{d} ms") for d in DELAYS_MS]
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
    for name, plan in plans.items():
        block = fly(plan, rows)
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


def robust_section() -> Iterator[str]:
    """The page's part on what the shipped designs bear."""
    duel = Duel("ghame_x", "tlc")
    plans = {
        name: make_plan(duel.vehicle, duel.mission, read_controller(ROOT / f"configs/control/{name}.yaml"), name)
        for name in NAMES
    }
    yield "## What the shipped designs bear, `ghame_x`"
    yield ""
    yield (
        "*Retuned*: an LQR searched for errors alone, without margins (`studies/retune_lqr.py`). *Robust*: either law "
        "within the limits above, at no more than 1.05 times Table 1's usage (`studies/robust.py`). A table by loop "
        "is in [margins](margins.md). The largest settled bank error (deg) of the nominal vehicle but for one number, "
        "the delay of the measurement or the effectiveness of a surface:"
    )
    yield ""
    yield from tolerance_table(plans)
    yield ""
    yield (
        "Table 1 bears little because TLC inverts the effectiveness of aileron and rudder in roll and yaw, a matrix of "
        f"condition {effectiveness_condition(duel):.0f}: an error of some percent in one surface's effectiveness leaks "
        "many times as large into the other axis."
    )
    yield ""
