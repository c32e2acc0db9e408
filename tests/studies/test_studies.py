"""Tests of the search for the paper's vehicle, and of counts and decisions of other studies."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))

import fronts
import paper_vehicle as ensemble
import paper_vehicle_box as box
import paper_vehicle_envelope as envelope
import paper_vehicle_flights as flights
import paper_vehicle_search as search
import paper_vehicle_sides as sides
import tuning_flights
from experiment import CORNERS, ROOT, corner_parameters, random_parameters

import paper
from abhv_mc_vehicle.control.design.lqr_design import attitude_slopes, make_lqr_gains, make_nominal
from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables, solve_reference
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

VALUES = box.first_mean(np.random.default_rng(5))
GHAMES = dict.fromkeys(box.FREE, 1.0) | {
    **dict.fromkeys(("lift_offset", "pitch_offset", "pitch_slope"), 0.0),
    **dict.fromkeys(box.FIXED, 1.0),
    "roll_rudder": 0.4843949,
    "yaw_rudder": 0.0354146,
}


def test_factors_of_one_are_ghame():
    """Drag is excepted because it is a polar."""
    ours = box.make_vehicle(GHAMES).tables.data.copy()
    drag = box.cells_of("drag_basic")
    ours[drag] = box.BASE.tables.data[drag]
    np.testing.assert_allclose(ours, box.BASE.tables.data, rtol=1e-6, atol=1e-12)


def test_drag_is_a_polar():
    """The induced drag at a node of the Mach number is k |CL tan(alpha - alpha_0)|."""
    values = VALUES | {"drag_tilt": 1.5}
    alphas = np.deg2rad([-3.0, 0.0, 3.0, 6.0, 9.0])
    lift, drag = sides.polar(box.make_vehicle(values), 6.0, alphas)[:2]
    slope, offset = np.polyfit(alphas, lift, 1)
    induced = 1.5 * np.abs(lift * np.tan(alphas + offset / slope))
    np.testing.assert_allclose(drag - drag[0], induced - induced[0], rtol=1e-3)
    twice = box.make_vehicle(values | {"drag_zero_lift": 2.0 * values["drag_zero_lift"]})
    difference = (
        sides.polar(twice, box.MACH, alphas)[1]
        - sides.polar(box.make_vehicle(values), box.MACH, alphas)[1]
    )
    np.testing.assert_allclose(difference, values["drag_zero_lift"], rtol=1e-9)


def test_ends_of_an_axis():
    rudder = next(axis for axis in flights.AXES if axis.figure == 9)
    assert flights.look(rudder, {"rudder_deg": np.array([-0.35, 0.25])}).misses == (0.0, 0.0)
    mirrored = flights.look(rudder, {"rudder_deg": np.array([-0.25, 0.47])})
    assert mirrored.mirrored
    assert mirrored.misses == pytest.approx((0.1, 0.0))
    # Of the interval -0.4 .. -0.3 an eighth at each end is left for the rounding.
    assert mirrored.aside == pytest.approx(((-0.47 + 0.388) / 0.7, 0.0))
    heading = next(axis for axis in flights.AXES if axis.figure == 4)
    seen = flights.look(heading, {"heading_deg": np.array([89.9, 95.3])})
    assert (seen.low, seen.high) == pytest.approx((84.7, 90.1))
    assert sum(2 for axis in flights.AXES if axis.counts) == 20


def test_quick_gains_equal_those_of_the_package():
    vehicle, mission = box.make_vehicle(VALUES), box.make_mission(VALUES)
    trim_tables = make_mission_trim_tables(mission, vehicle)
    exact, _ = solve_reference(mission, vehicle, trim_tables, flights.TICK, flights.TICKS)
    quick, trimmed = flights.make_quick_reference(vehicle, mission, trim_tables)
    assert trimmed
    compared = [i for i, name in enumerate(flights.REFERENCE) if name != "settled"]
    np.testing.assert_allclose(quick[:, compared], exact[:, compared], rtol=1e-4, atol=2e-4)
    gains = flights.make_quick_lqr_gains(mission, quick, vehicle, trim_tables)
    controller = flights.CONTROLLERS["lqr"]
    theirs = make_lqr_gains(controller, mission, exact, vehicle, trim_tables)
    for tick in (0, 1000, 6000):
        np.testing.assert_allclose(
            # The package's trim tables have no node at the steady Mach number: secants differ.
            gains[tick],
            theirs[tick],
            rtol=1e-2,
            atol=1e-4 * np.abs(theirs).max(),
        )
    slopes = attitude_slopes(vehicle, make_nominal(mission, exact[0]))
    traits = dict(
        zip(flights.TRAITS, flights.find_traits(vehicle, trim_tables, quick), strict=True)
    )
    expected = slopes[3, 6], slopes[5, 7], slopes[4, 8], slopes[5, 1], slopes[4, 0], slopes[4, 4]
    assert list(traits.values())[:6] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("amplitude", "cycles", "swings"), [(1.0, 4, 8), (0.2, 9, 0), (0.26, 3, 6)]
)
def test_only_large_swings_are_counted(amplitude, cycles, swings):
    """Chatter and drift do not count."""
    times = np.linspace(0.0, 1.0, 2001)
    wave = amplitude * np.sin(2.0 * np.pi * cycles * times)
    assert abs(tuning_flights.count_swings(wave.astype(np.float32)) - swings) <= 1
    chatter = 0.01 * np.sin(2.0 * np.pi * 300.0 * times)
    assert tuning_flights.count_swings((wave + chatter).astype(np.float32)) <= swings + 1
    assert tuning_flights.count_swings(0.4 * times.astype(np.float32)) == 0


def test_corners_and_draws_are_those_of_the_paper():
    columns = [PARAMETER_INDEX[name] for name in ("atmosphere.density", "aero.lift", "aero.drag")]
    corners = corner_parameters()[:, columns]
    assert corners[0].tolist() == [1.0, 1.0, 1.0]
    np.testing.assert_allclose(corners[1:], 1.0 + np.array(CORNERS) * (0.10, 0.10, 0.15))
    drawn = random_parameters(2000)[:, columns]
    np.testing.assert_allclose(np.abs(drawn - 1.0).max(axis=0), (0.10, 0.10, 0.15), rtol=0.01)


def test_a_front_has_the_pareto_optimal_designs_within_limits():
    usage = np.tile(np.array([[0.5], [0.6], [0.7], [0.8], [0.4]]), 6)
    limits = np.full((5, fronts.LIMITS), -0.1)
    limits[4, 1] = 0.1  # violated
    tried = fronts.Tried(
        np.zeros((5, 14)), np.tile(np.array([[1.0], [1.1], [0.9], [0.8], [0.5]]), 6), usage, limits
    )
    np.testing.assert_allclose(tried.front.mean_usage, [0.5, 0.7, 0.8])
    assert [int(np.argmin(tried.feasible.within(budget).rank())) for budget in (0.75, 0.3)] == [
        2,
        0,
    ]  # the nearest if none is within the budget


ENSEMBLE = json.loads((ROOT / "studies/paper_vehicle.json").read_text(encoding="utf-8"))["ensemble"]


@pytest.mark.parametrize("name", [member["name"] for member in ENSEMBLE])
def test_members_of_the_ensemble_reproduce_the_figures_and_keep_their_sides(name):
    member = next(entry for entry in ENSEMBLE if entry["name"] == name)
    candidate = flights.fly_candidate(member["values"])
    assert candidate.ends_in == member["ends_in"] >= search.ENDS
    assert candidate.worst == pytest.approx(member["worst"], abs=2e-3)
    assert candidate.keeps_sides
    for other in ENSEMBLE:
        if other is not member:
            distance = flights.third_trait(candidate.traits, tuple(other["traits"].values()))
            assert distance >= np.log(search.DIFFERENT) - 1e-3


@pytest.mark.thorough
def test_the_stored_searches_give_the_stored_members():
    members = ensemble.choose_members(ensemble.read_starts())
    described = [ensemble.describe(name.split()[0], x.values) for name, x in members.items()]
    for member, stored in zip(described, ENSEMBLE, strict=True):
        for traits in ("traits", "class_traits"):  # another machine may differ in the last digits
            assert member.pop(traits) == pytest.approx(stored[traits], rel=1e-3)
        assert member.pop("worst") == pytest.approx(stored["worst"], abs=2e-4)
        assert member.items() <= stored.items()


JUDGED = json.loads((ROOT / "studies/paper_vehicle_claim.json").read_text(encoding="utf-8"))


def test_the_shipped_vehicle_keeps_the_limits_of_its_class_and_of_its_box():
    """The stored traits, from which members are selected, are those of the files."""
    vehicle = load_vehicle(ROOT / "configs/vehicle/abhv.yaml")
    traits = sides.measure(vehicle, *sides.find_trim(vehicle)), envelope.measure_envelope(vehicle)
    for measured, kind, limits in zip(
        traits, ("class", "box"), (sides.SIDES, envelope.ENVELOPE), strict=True
    ):
        assert measured == pytest.approx(JUDGED["abhv"]["traits"][kind], rel=1e-3)
        assert not any(side.excess(measured[name], 0.0) for name, side in limits.items())


def test_members_are_selected_by_strict_counts_insets_and_limits():
    assert ensemble.select_members(JUDGED) == ["abhv"]
    ends = [dict(end) for end in JUDGED["abhv"]["ends"]]
    assert flights.strict_ends(ends) >= ensemble.STRICT and flights.in_insets(ends)
    (i,) = (i for i, axis in enumerate(flights.AXES) if axis.figure == 11)
    ends[i]["low"] = 0.7999  # of 0.8 to 0.85
    assert flights.strict_ends(ends) == ensemble.STRICT - 1
    (i,) = (i for i, axis in enumerate(flights.AXES) if axis.label == "inset (deg), LQR")
    ends[i]["high"] = 49.9
    assert not flights.in_insets(ends)
    traits = JUDGED["abhv"]["traits"]
    unstable = {"traits": traits | {"box": traits["box"] | {"lcdp": -0.01}}}
    assert ensemble.broken_limits(unstable) == ([], ["lcdp"])


def test_the_pages_on_the_paper_are_those_of_the_stored_results():
    stored = json.loads(ensemble.STORED.read_text(encoding="utf-8"))
    pages = ROOT / "docs/explanation"
    south = {"tlc": 5.011, "lqr": 5.045}  # km, of the nominal flights
    text = (pages / "paper.md").read_text(encoding="utf-8")
    assert paper.page(stored, JUDGED, 200, south) == text
    text = (pages / "paper-vehicles.md").read_text(encoding="utf-8")
    assert paper.plausibility(ENSEMBLE) == text


@pytest.mark.parametrize("script", ["paper_vehicle.py --smoke", "paper_vehicle_sides.py --smoke"])
def test_a_script_runs(script):
    name, *options = script.split()
    subprocess.run([sys.executable, str(ROOT / "studies" / name), *options], check=True)
