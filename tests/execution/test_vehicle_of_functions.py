"""A campaign on a vehicle of functions: workers, resume, replay, margins and a cluster as with one of tables."""

import json
import re

import numpy as np
import pytest
from execution.test_user_code import threads
from user_code.test_vehicle_functions import write_ghame_x

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.engine import make_engine
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.fly import fly
from abhv_mc.flight.prepare import prepare
from abhv_mc.shipped import shipped_configs

CAMPAIGN = """\
name: functions
vehicle: {vehicle}
mission: mission.yaml
controllers: {{tlc: {configs}/control/tlc.yaml, lqr: {configs}/control/lqr_retuned.yaml}}
runs: {runs}
seed: 3
dispersions:
  aero.lift: {{distribution: uniform, half_width: 10 %}}
  aero.rolling_moment.roll_rate: {{distribution: uniform, half_width: 20 %}}
margins: {{at: [trim, 1 s], flights: 8}}
execution: {{workers: 2, batch: 16}}
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A user's folder; ``write(runs)`` makes the campaign, ``write(runs, vehicle)`` on another vehicle."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    configs = shipped_configs()
    mission = (configs / "mission" / "s_manoeuvre.yaml").read_text(encoding="utf-8")
    (tmp_path / "mission.yaml").write_text(re.sub("^duration.*$", "duration: 2 s", mission, flags=re.MULTILINE))
    own = write_ghame_x(tmp_path, "body")

    def write(runs=24, vehicle=own):
        path = tmp_path / "campaign.yaml"
        path.write_text(CAMPAIGN.format(configs=configs, runs=runs, vehicle=vehicle), encoding="utf-8")
        return path

    return write


def test_workers_resume_replay_and_margins(study, tmp_path):
    one = run_campaign(Request(study(40), tmp_path / "one", workers=1), threads()).manifest
    run_campaign(Request(study(24), tmp_path / "two"), make_engine())  # processes
    two = run_campaign(Request(study(40), tmp_path / "two"), make_engine()).manifest
    assert two["digest"] == one["digest"]
    for name in ("tlc", "lqr"):
        assert replay_flight(tmp_path / "two", name, 7, fly).differences == ()
    tables = shipped_configs() / "vehicle" / "ghame_x.yaml"
    run_campaign(Request(study(40, tables), tmp_path / "tables", workers=1), threads())
    found, wanted = (
        json.loads((tmp_path / name / "margins.json").read_text())["controllers"] for name in ("two", "tables")
    )
    for name in ("tlc", "lqr"):
        assert "fault" not in found[name], found[name]
        assert "fault" not in wanted[name], wanted[name]
        for ours, theirs in zip(found[name]["nominal"], wanted[name]["nominal"], strict=True):
            assert ours["stable"] == theirs["stable"]
            for key, value in theirs.items():
                if isinstance(value, float):
                    assert ours[key] == pytest.approx(value, rel=1e-3), (name, key)


def test_gains_of_lqr_are_those_of_the_tables(study, tmp_path):
    study()
    controller = shipped_configs() / "control" / "lqr_retuned.yaml"
    vehicles = tmp_path / "functions.yaml", shipped_configs() / "vehicle" / "ghame_x.yaml"
    gains = [prepare(vehicle, tmp_path / "mission.yaml", controller, "lqr").gains for vehicle in vehicles]
    size = np.abs(gains[1]).max(axis=0)
    assert (np.abs(gains[0] - gains[1]).max(axis=0) <= 1e-5 * size + 1e-9).all()
