"""Stability margins of flights, which depend on the flight alone; invalid requests."""

import json
import random
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import interrupted_after, run

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.failure_map import map_failures
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.shipped import shipped_configs
from abhv_mc.topics.topic import Models
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.stability import fly_with_margins
from abhv_mc_vehicle.vehicle_simulator import corner_margins

CAMPAIGN = """\
name: margins
vehicle: {configs}/vehicle/ghame_x.yaml
mission: {configs}/mission/s_manoeuvre.yaml
controllers: {{tlc: {configs}/control/tlc.yaml, lqr: {configs}/control/lqr.yaml}}
runs: 40
seed: 5
sampling: random
dispersions:
  control.rudder_effectiveness: {{distribution: uniform, half_width: 20 %}}
requirements: {requirements}
margins: {margins}
execution: {{batch: {batch}, isolation: threads}}
"""
REQUIRED = "[{metric: gain_margin_min_db, above: 0.1, probability: 0.5, consumer_risk: 0.10}]"


def _write(path, margins, requirements="[]", batch="auto"):
    text = CAMPAIGN.format(
        configs=shipped_configs(), margins=margins, requirements=requirements, batch=batch
    )
    path.write_text(text, "utf-8")
    return path


def _table(folder, controller):
    files = sorted((folder / "flights").glob(f"{controller}-*.parquet"))
    return {
        name: np.concatenate([pq.read_table(file)[name].to_numpy() for file in files])
        for name in (*MARGIN_NAMES, "margin_points_unstable", "control.rudder_effectiveness")
    }


def test_the_first_flights_have_margins_in_any_blocks(flights_only, tmp_path):
    """TLC is unstable above 1.10 times the rudder, LQR always; bits do not depend on blocks."""
    margins = "{at: [trim, 30 s], flights: 12}"
    first = run(_write(tmp_path / "a.yaml", margins), tmp_path / "a", flights_only, workers=2)
    other = _write(tmp_path / "b.yaml", margins, batch="7")
    cut = run(other, tmp_path / "b", interrupted_after(4, flights_only), workers=1)
    assert not cut.complete
    second = run(other, tmp_path / "b", flights_only, workers=1)
    assert second.manifest.digest == first.manifest.digest
    tlc, lqr = _table(first.folder, "tlc"), _table(first.folder, "lqr")
    assert (
        np.isnan(tlc["gain_margin_min_db"][12:]).all()
        and np.isfinite(tlc["disk_margin_min"][:12]).all()
    )
    rudder = tlc["control.rudder_effectiveness"][:12]
    unstable = tlc["margin_points_unstable"][:12] > 0
    assert (unstable == (rudder > 1.098)).all() and 0 < unstable.sum() < 12
    assert (tlc["gain_margin_min_db"][:12][unstable] == 0.0).all()
    weak = (rudder > 1.0) & ~unstable
    assert np.allclose(
        tlc["gain_margin_min_db"][:12][weak], 20 * np.log10(1.0984 / rudder[weak]), atol=0.1
    )
    assert (lqr["margin_points_unstable"][:12] == 2).all() and (
        lqr["phase_margin_min_deg"][:12] == 0.0
    ).all()
    replay = replay_flight(first.folder, "tlc", 3, flights_only.fly)
    assert replay.differences == ()


FACTORS = (
    "mass.inertia_xx", "mass.inertia_zz", "aero.lift", "aero.pitching_moment",
    "aero.yawing_moment.sideslip", "control.elevator_effectiveness", "atmosphere.density",
    "propulsion.thrust", "actuator.bandwidth",
)  # fmt: skip
LAWS = (
    "lognormal, sigma: 80 %", "normal, sigma: 30 %", "uniform, half_width: 95 %",
    "scipy, law: expon, scale: 0.5", "scipy, law: weibull_min, shapes: {c: 0.5}",
    "discrete, values: [1e-9, 1, 3]", "lognormal, sigma: 5 %",
)  # fmt: skip


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.thorough) for k in range(1, 4))]
)
def test_invalid_corners_do_not_end_a_campaign(engine, tmp_path, seed):
    """A lognormal mass with a corner of 0 kg must not end the campaign after its flights."""
    chance = random.Random(seed)
    laws = {"mass.total": LAWS[seed]} | {
        name: chance.choice(LAWS) for name in chance.sample(FACTORS, 3)
    }
    path = _write(tmp_path / "c.yaml", "{at: [trim, 1 s], flights: all}")
    head, _, tail = path.read_text("utf-8").partition("  control.rudder")
    entries = "".join(f"  {name}: {{distribution: {law}}}\n" for name, law in laws.items())
    text = f"{head}{entries}requirements{tail.partition('requirements')[2]}"
    path.write_text(text.replace(f", lqr: {shipped_configs()}/control/lqr.yaml", ""), "utf-8")
    manifest = run(path, tmp_path / "c", engine, runs=6, workers=1).manifest
    assert manifest.state == "complete" and manifest.runs_failed == 0
    stability = json.loads((tmp_path / "c/margins.json").read_text("utf-8"))["controllers"]
    assert not any("not computed" in entry.get("fault", "") for entry in stability.values())


def test_failed_margins_are_reported_and_flights_are_kept(engine, tmp_path, monkeypatch):
    find = fly_with_margins._find

    def find_some(plan, rows):
        if (rows[:, PARAMETER_INDEX["control.rudder_effectiveness"]] > 1.15).any():
            raise np.linalg.LinAlgError("of this test")
        return find(plan, rows)

    monkeypatch.setattr(fly_with_margins, "_find", find_some)
    monkeypatch.setattr(corner_margins, "_describe", lambda *_: 1 // 0)
    path = _write(tmp_path / "c.yaml", "{at: [trim], flights: all}")
    folder = run(path, tmp_path / "c", engine, runs=12, workers=1, controllers=("tlc",)).folder
    table = _table(folder, "tlc")
    failed = table["control.rudder_effectiveness"] > 1.15
    assert 0 < failed.sum() < 12 and np.array_equal(np.isnan(table["gain_margin_min_db"]), failed)
    numbers = make_numbers(Models(read_flown(folder)))
    assert re.search(rf"\bTLC\b.* {failed.sum()} ", numbers["warnings"][0])
    assert "ZeroDivisionError" in numbers["margins"]["steady"]["controllers"]["tlc"]["fault"]


@pytest.fixture(scope="module")
def required(flights_only, tmp_path_factory):
    """Return a campaign that requires margins of all flights."""
    folder = tmp_path_factory.mktemp("required")
    path = _write(folder / "c.yaml", "{at: [trim], flights: all}", REQUIRED)
    return run(path, folder / "c", flights_only, runs=12, workers=1, controllers=("tlc",))


def test_margins_can_be_required_of_all_flights(required):
    (judged,) = required.manifest.requirements
    values = _table(required.folder, "tlc")["gain_margin_min_db"]
    assert judged.failures == int((values <= 0.1).sum()) and judged.flights == 12


@pytest.mark.parametrize(
    ("margins", "requirements", "fragments"),
    [
        ("{at: [trim, 61 s]}", "[]", ("61 s", "0 to 60 s")),
        ("{at: [trim], flights: 10}", REQUIRED, ("10 of 40 flights", "flights: all")),
        ("null", REQUIRED, ("stability margins", "flights: all")),
        (
            "{at: [trim], flights: all}",
            REQUIRED.replace("above: 0.1", "above: 6 deg"),
            ("6 deg", "plain number, in dB"),
        ),
    ],
)
def test_invalid_margins_are_rejected(margins, requirements, fragments, tmp_path):
    path = _write(tmp_path / "bad.yaml", margins, requirements)
    with pytest.raises(InputError) as refused:
        read_campaign(path)
    assert all(fragment in str(refused.value) for fragment in fragments), str(refused.value)


def test_a_missed_margin_is_explained(flights_only, required):
    missed = _table(required.folder, "tlc")["gain_margin_min_db"] <= 0.1
    assert missed.any() and not missed.all()
    explanation = explain_flight(
        required.folder,
        "tlc",
        int(np.flatnonzero(missed)[0]),
        flights_only.fly,
        "gain_margin_min_db",
    )
    assert (
        explanation.causes == ("control.rudder_effectiveness",)
        and "gain_margin_min_db" in explanation.failure.words
    )
    flights = np.flatnonzero(missed).tolist()
    mapped = map_failures(required.folder, {"tlc": flights}, flights_only).controllers["tlc"]
    groups = [group for group in mapped.groups if "gain_margin_min_db" in group.failure]
    assert [[dispersion.parameter for dispersion in group.dispersions] for group in groups] == [
        ["control.rudder_effectiveness"]
    ]
    assert sorted(groups[0].flights) == flights
    with pytest.raises(InputError, match="gain_margin_min_db"):
        explain_flight(
            required.folder,
            "tlc",
            int(np.flatnonzero(~missed)[0]),
            flights_only.fly,
            "gain_margin_min_db",
        )


@pytest.mark.parametrize(
    ("margins", "late", "pattern"),
    [
        (
            "null",
            "sensor.delay: {distribution: uniform, low: 0 ms, high: 300 ms}",
            r"300 ms.*0 to 250 ms",
        ),
        (
            "{at: [trim]}",
            "sensor.bank_interval: {distribution: discrete, values: [10 ms, 1.01 s]}",
            "101 ticks",
        ),
    ],
)
def test_late_delays_and_samples_are_rejected(flights_only, tmp_path, margins, late, pattern):
    path = _write(tmp_path / "e.yaml", margins)
    path.write_text(
        path.read_text("utf-8").replace("requirements:", f"  {late}\nrequirements:"),
        "utf-8",
    )
    with pytest.raises(InputError, match=pattern):
        run(path, tmp_path / "e", flights_only, workers=1)
    assert not (tmp_path / "e").exists()
