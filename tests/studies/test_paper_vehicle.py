"""The search for the paper's vehicle: what it scales, what it counts as in, and that it goes on where it stopped."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))

import paper_vehicle as study
import paper_vehicle_box as box
import paper_vehicle_flights as flights
import paper_vehicle_search as searches

from abhv_mc.control.design.lqr_design import attitude_slopes, make_lqr_gains, make_nominal
from abhv_mc.control.design.reference import make_mission_trim_tables, solve_reference
from abhv_mc.vehicle.evaluate import evaluate_coefficients, evaluate_fixed, make_variables

VALUES = box.first_mean(np.random.default_rng(5))
GHAMES = dict.fromkeys(box.FREE, 1.0) | {
    **dict.fromkeys(("lift_offset", "pitch_offset", "pitch_slope", "drag_offset", "drag_rise"), 0.0),
    "roll_rudder": 0.4843949,
    "yaw_rudder": 0.0354146,
}


def coefficients(values: dict[str, float], **at: float) -> Any:
    vehicle = box.make_vehicle(values)
    variables = make_variables(vehicle, mach=4.744, mass=1300.0, **at)
    return evaluate_coefficients(vehicle, variables)[:, 0], evaluate_fixed(vehicle, variables)


def test_factors_of_one_are_ghame() -> None:
    np.testing.assert_allclose(box.make_vehicle(GHAMES).tables.data, box.BASE.tables.data, rtol=1e-6, atol=1e-12)


def test_each_factor_changes_its_own_coefficient() -> None:
    at = {"angle_of_attack": np.deg2rad(5.0), "sideslip": 0.01}
    plain, _ = coefficients(GHAMES, **at)
    changed, fixed = coefficients(GHAMES | {"yaw_sideslip": 0.5, "drag_rise": 0.002, "inertia_xx": 1.5}, **at)
    assert changed[5] == pytest.approx(0.5 * plain[5])
    # Between the nodes at 3 and 6 deg: two thirds of 0.002 (6 - 3)^2.
    assert changed[1] == pytest.approx(plain[1] + 0.012)
    np.testing.assert_allclose(changed[[0, 2, 3, 4]], plain[[0, 2, 3, 4]])
    assert fixed["inertia_xx"][0] == pytest.approx(1.5 * coefficients(GHAMES)[1]["inertia_xx"][0])


def test_ratios_and_the_rigid_body() -> None:
    alpha = np.deg2rad(3.5)
    by = {
        name: coefficients(VALUES, angle_of_attack=alpha, **{name: 1.0})[0]
        - coefficients(VALUES, angle_of_attack=alpha)[0]
        for name in ("aileron", "rudder", "sideslip")
    }
    assert by["rudder"][3] / by["aileron"][3] == pytest.approx(VALUES["roll_rudder"], rel=1e-4)
    assert abs(by["rudder"][5] / by["sideslip"][5]) == pytest.approx(VALUES["yaw_rudder"], rel=1e-4)
    flat = box.changed_tables(GHAMES | {"inertia_xx": 0.5, "inertia_yy": 1.4, "inertia_zz": 1.12})
    assert np.all(flat["inertia_xx"] + flat["inertia_yy"] > flat["inertia_zz"])


def test_numbers_of_a_search_are_its_values() -> None:
    assert box.to_values(box.to_numbers(VALUES)) == pytest.approx(VALUES)
    low, high = box.limits()
    held = box.to_values(high + 1e3)
    assert all(held[name] == pytest.approx(free.high) for name, free in box.FREE.items())
    assert (low < box.to_numbers(VALUES)).all()
    assert (box.to_numbers(VALUES) < high).all()


def test_ends_of_an_axis() -> None:
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


def test_quick_gains_are_the_product_s() -> None:
    vehicle, mission = box.make_vehicle(VALUES), box.make_mission(VALUES)
    trim_tables = make_mission_trim_tables(mission, vehicle)
    exact, _ = solve_reference(mission, vehicle, trim_tables, flights.TICK, flights.TICKS)
    quick, trimmed = flights.make_quick_reference(vehicle, mission, trim_tables)
    assert trimmed
    kept = [i for i, name in enumerate(flights.REFERENCE) if name != "settled"]
    np.testing.assert_allclose(quick[:, kept], exact[:, kept], rtol=1e-4, atol=2e-4)
    gains = flights.make_quick_lqr_gains(mission, quick, vehicle, trim_tables)
    controller = flights.CONTROLLERS["lqr"]
    theirs = make_lqr_gains(controller, mission, exact, vehicle, trim_tables)  # type: ignore[arg-type]
    for tick in (0, 1000, 6000):
        np.testing.assert_allclose(gains[tick], theirs[tick], rtol=1e-3, atol=1e-4 * np.abs(theirs).max())
    slopes = attitude_slopes(vehicle, make_nominal(mission, exact[0]))
    traits = dict(zip(flights.TRAITS, flights.find_traits(vehicle, trim_tables, quick), strict=True))
    wanted = slopes[3, 6], slopes[5, 7], slopes[4, 8], slopes[5, 1], slopes[4, 0], slopes[4, 4]
    assert list(traits.values())[:6] == pytest.approx(wanted, rel=1e-3)


def test_how_far_vehicles_are_apart() -> None:
    one = (1.0,) * 8
    assert flights.third_trait(one, (1.7, 1 / 1.5, -0.9, *one[3:])) == pytest.approx(np.log(1.5))
    near = (1.7, 1.6, 1.4, *one[3:])
    assert flights.third_trait(one, near) == pytest.approx(np.log(1.4))
    assert searches.Search(1, others=(one,)).pulls(near)[-1] == pytest.approx(0.25 * np.log(1.55 / 1.4))


def test_places_are_apart() -> None:
    """Any two of the nine places differ by a level or more in three traits; a vehicle on its levels is not pulled."""
    places = [searches.Search(seed).place for seed in range(1, 10)]
    for i, one in enumerate(places):
        assert all(sum(a != b for a, b in zip(one, other, strict=True)) >= 3 for other in places[:i])
    at_five = tuple(-searches.LEVELS.get(name, 1.0) for name in flights.TRAITS)
    off = searches.Search(5).aside(at_five)
    np.testing.assert_allclose(off[:5], 0.0, atol=1e-12)
    assert off[5] == pytest.approx(np.log(1.7))


def make_up_a_vehicle(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, float]]:
    """A made-up vehicle whose 28 ends are linear in its numbers; what is flown of it."""
    matrix = np.random.default_rng(8).standard_normal((28, len(box.FREE)))
    goal = box.to_numbers(VALUES)
    flown = []

    def fly(values: dict[str, float]) -> flights.Candidate:
        flown.append(values)
        off = (0.02 * matrix @ (box.to_numbers(values) - goal)).reshape(-1, 2)
        seen = (
            flights.Seen(axis, 0.0, 0.0, False, (abs(a), abs(b)), (a, b))
            for axis, (a, b) in zip(flights.AXES, off.tolist(), strict=True)
        )
        return flights.Candidate(tuple(seen), traits=tuple(values.values())[:8], off_node=1.0)

    monkeypatch.setattr(searches, "fly_candidate", fly)
    monkeypatch.setattr(searches, "_PULL", 0.0)
    monkeypatch.setattr(study, "fly_candidate", fly)
    return flown


def test_a_search_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search finds the made-up vehicle, in one go or in two."""
    flown = make_up_a_vehicle(monkeypatch)
    whole = searches.run(searches.Search(3), tmp_path, lambda: True)
    assert whole.done
    assert whole.rank <= flights.READING
    count = len(flown)
    answers = iter([True] * 40 + [False])
    (tmp_path / "later").mkdir()
    assert not searches.run(searches.Search(3), tmp_path / "later", lambda: next(answers)).done
    assert searches.run(searches.Search(3), tmp_path / "later", lambda: True) == whole
    assert len(flown) == 2 * count
    assert (tmp_path / "seed-3.jsonl").read_text() == (tmp_path / "later/seed-3.jsonl").read_text()


def test_each_seed_is_written_when_it_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted in the second of two seeds the file has the first; the same command then gives what one go gives."""
    flown = make_up_a_vehicle(monkeypatch)
    monkeypatch.setattr(study, "SEEDS", (3, 4))
    monkeypatch.setattr(study, "FIGURES", (9,))
    monkeypatch.setattr(study, "ROOT", tmp_path)
    file = tmp_path / "studies/paper_vehicle.json"
    for name in ("studies", "whole", "later"):
        (tmp_path / name).mkdir()
    study.find(tmp_path / "whole", lambda: True)
    whole = json.loads(file.read_text())
    assert whole["seeds_done"] == [3, 4]
    assert [each["figure"] for each in whole["without"]] == [9] * len(whole["ensemble"])
    enough = len(flown) + len((tmp_path / "whole/seed-3.jsonl").read_text().splitlines()) + 20

    def go_on() -> bool:
        if len(flown) > enough:
            raise KeyboardInterrupt
        return True

    with pytest.raises(KeyboardInterrupt):
        study.find(tmp_path / "later", go_on)
    so_far = json.loads(file.read_text())
    assert so_far["seeds_done"] == [3]
    assert [member["name"] for member in so_far["ensemble"]] == ["seed-3"]
    assert so_far["without"] == []
    study.find(tmp_path / "later", lambda: True)
    assert json.loads(file.read_text()) == whole
