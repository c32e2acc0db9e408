"""Margins of a campaign's flights: columns that depend on nothing but the flight, and what is refused."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import interrupted_after

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.metrics import MARGIN_NAMES
from abhv_mc.io.input_error import InputError
from abhv_mc.shipped import shipped_configs

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
    text = CAMPAIGN.format(configs=shipped_configs(), margins=margins, requirements=requirements, batch=batch)
    path.write_text(text, encoding="utf-8")
    return path


def _table(folder, controller):
    files = sorted((folder / "flights").glob(f"{controller}-*.parquet"))
    return {
        name: np.concatenate([pq.read_table(file)[name].to_numpy() for file in files])
        for name in (*MARGIN_NAMES, "margin_points_unstable", "control.rudder_effectiveness")
    }


def test_the_first_flights_have_them_whatever_flies_the_blocks(engine, tmp_path):
    """TLC is unstable above 1.10 times the rudder, LQR everywhere; no bit depends on blocks or on what was resumed."""
    margins = "{at: [trim, 30 s], flights: 12}"
    first = run_campaign(Request(_write(tmp_path / "a.yaml", margins), tmp_path / "a", workers=2), engine)
    other = _write(tmp_path / "b.yaml", margins, batch="7")
    cut = run_campaign(Request(other, tmp_path / "b", workers=1), interrupted_after(4, engine))
    assert not cut.complete
    second = run_campaign(Request(other, tmp_path / "b", workers=1), engine)
    assert second.manifest["digest"] == first.manifest["digest"]
    tlc, lqr = _table(first.folder, "tlc"), _table(first.folder, "lqr")
    assert np.isnan(tlc["gain_margin_min_db"][12:]).all() and np.isfinite(tlc["disk_margin_min"][:12]).all()
    rudder = tlc["control.rudder_effectiveness"][:12]
    unstable = tlc["margin_points_unstable"][:12] > 0
    assert (unstable == (rudder > 1.098)).all() and 0 < unstable.sum() < 12
    assert (tlc["gain_margin_min_db"][:12][unstable] == 0.0).all()
    weak = (rudder > 1.0) & ~unstable
    assert np.allclose(tlc["gain_margin_min_db"][:12][weak], 20 * np.log10(1.0984 / rudder[weak]), atol=0.1)
    assert (lqr["margin_points_unstable"][:12] == 2).all() and (lqr["phase_margin_min_deg"][:12] == 0.0).all()
    replay = replay_flight(first.folder, "tlc", 3, engine.fly)
    assert replay.differences == ()


@pytest.fixture(scope="module")
def required(engine, tmp_path_factory):
    """A campaign that requires margins of all flights."""
    folder = tmp_path_factory.mktemp("required")
    path = _write(folder / "c.yaml", "{at: [trim], flights: all}", REQUIRED)
    return run_campaign(Request(path, folder / "c", runs=12, workers=1), engine)


def test_they_can_be_required_of_all_flights(required):
    (judged,) = required.manifest["requirements"]
    values = _table(required.folder, "tlc")["gain_margin_min_db"]
    assert judged["failures"] == int((values <= 0.1).sum()) and judged["flights"] == 12


@pytest.mark.parametrize(
    ("margins", "requirements", "words"),
    [
        ("{at: [trim, 61 s]}", "[]", ("61 s", "0 to 60 s")),
        ("{at: [trim], flights: 10}", REQUIRED, ("margins of 10 of 40 flights", "flights: all")),
        ("null", REQUIRED, ("without 'margins'", "flights: all")),
        (
            "{at: [trim], flights: all}",
            REQUIRED.replace("above: 0.1", "above: 6 deg"),
            ("6 deg", "plain number, in dB"),
        ),
    ],
)
def test_what_cannot_be_is_refused(margins, requirements, words, tmp_path):
    path = _write(tmp_path / "bad.yaml", margins, requirements)
    with pytest.raises(InputError) as refused:
        read_campaign(path)
    assert all(each in str(refused.value) for each in words), str(refused.value)


def test_a_missed_margin_is_explained(engine, required):
    missed = _table(required.folder, "tlc")["gain_margin_min_db"] <= 0.1
    assert missed.any() and not missed.all()
    found = explain_flight(required.folder, "tlc", int(np.flatnonzero(missed)[0]), engine.fly, "gain_margin_min_db")
    assert found.causes == ("control.rudder_effectiveness",) and "gain_margin_min_db" in found.failure.words
    with pytest.raises(InputError, match="kept gain_margin_min_db"):
        explain_flight(required.folder, "tlc", int(np.flatnonzero(~missed)[0]), engine.fly, "gain_margin_min_db")


def test_delays_that_no_flight_remembers_are_refused(engine, tmp_path):
    path = _write(tmp_path / "e.yaml", "null")
    late = "  sensor.delay: {distribution: uniform, low: 0 ms, high: 300 ms}\nrequirements:"
    path.write_text(path.read_text(encoding="utf-8").replace("requirements:", late), encoding="utf-8")
    with pytest.raises(InputError, match=r"300 ms.*0 to 250 ms"):
        run_campaign(Request(path, tmp_path / "e", workers=1), engine)
    assert not (tmp_path / "e").exists()
