"""``fly``, ``trim``, ``list``, ``verify``: what they print, write and exit with."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.cli.app import app
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.metrics import BUILT_IN, METRICS
from abhv_mc.plant.parameters import PARAMETERS


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_fly_prints_every_metric_of_every_controller():
    out = run("fly", "level").stdout
    assert "level with abhv" in out and "tlc: The flight reached the end of the mission." in out
    rows = [line.split() for line in out.splitlines()]
    assert ["outcome", "ok", "ok"] in rows
    for metric in METRICS:
        values = next(row[1:] for row in rows if row and row[0] == metric.name)
        assert len(values) == 2 and np.isfinite([float(value) for value in values]).all()
    figures = json.loads(run("fly", "level", "--controllers", "lqr,tlc", "--json", "-").stdout)
    assert list(figures["controllers"]) == ["lqr", "tlc"] and figures["vehicle"] == "abhv"
    flown = figures["controllers"]["tlc"]
    assert flown["outcome"] == "ok" and flown["end_time_s"] == 60.0
    assert list(flown["metrics"]) == [metric.name for metric in METRICS]


def test_fly_writes_history_and_figures(repository, tmp_path):
    files = repository / "configs"
    mission, tlc = str(files / "mission/level.yaml"), str(files / "control/tlc.yaml")
    named = shutil.copy(tlc, tmp_path / "${$.yaml")  # which is no formula
    words = ("--vehicle", files / "vehicle/ghame_x.yaml", "--controllers", f"{tlc},{named}", "-o", tmp_path / "level")
    flown = run("fly", mission, *words)
    history = pq.read_table(tmp_path / "level/nominal.parquet")
    assert history.column_names == ["controller", "time", *(channel.name for channel in CHANNELS)]
    np.testing.assert_allclose(history["time"][:6001], np.arange(6001) * 0.01, atol=1e-12)
    assert history["altitude_m"][0].as_py() == 20_000.0
    assert str(tmp_path / "level/figures/channels.png") in flown.stdout.replace("\n", "")


def test_trim_in_degrees_and_the_exit_code_of_a_point_without_one(repository):
    result = run("trim", "ghame", "--altitude", "20km", "--speed", "1400", "--bank", "0,50 deg", "--json", "-")
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert (found["altitude_m"], found["speed_mps"], found["mass_kg"]) == (20e3, 1400.0, 95254.0)
    angles = [(point["trimmed"], point["bank_deg"], point["angle_of_attack_deg"]) for point in found["points"]]
    assert angles == [(True, 0.0, pytest.approx(3.59, abs=0.005)), (True, 50.0, pytest.approx(4.47, abs=0.01))]
    result = run("trim", "ghame_x", "--bank=0,89", "--mass", "1.3 t")
    assert result.exit_code == 1
    assert "ghame_x: 20 km, 1400 m/s, Mach 4.745" in result.stdout
    assert "no trim at 89 deg of bank" in result.stdout and "no trim at 0 deg" not in result.stdout
    assert "without surfaces" in str(run("trim", repository / "configs/vehicle/nesc/sphere.yaml").exception)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("parameters", [parameter.name for parameter in PARAMETERS if parameter.name != "one"]),
        ("channels", [channel.name for channel in CHANNELS]),
        ("metrics", list(BUILT_IN)),
        ("schemas", ["campaign", "vehicle", "mission", "controller", "report", "manifest"]),
    ],
)
def test_everything_is_listed_in_words_and_as_json(kind, names):
    listed = json.loads(run("list", kind, "--json", "-").stdout)
    assert [entry["name"] for entry in listed] == names
    table = run("list", kind).stdout
    assert all(f"{entry['name']} " in table and entry["doc"] in table for entry in listed)
    if kind == "schemas":
        assert json.loads(run("list", "schemas", "vehicle").stdout) == make_schema("vehicle")


def test_check_cases_and_their_json(repository, tmp_path):
    case = "Atmos_09_EastwardCannonball"
    shutil.copytree(repository / "tests/reference/nesc" / case, tmp_path / case)
    result = run("verify", "nesc", tmp_path, "--json", tmp_path / "new/rows.json")
    assert result.exit_code == 0 and "12 differences, 0 outside" in result.stdout
    written = json.loads((tmp_path / "new/rows.json").read_text())
    assert written["ok"] is True
    fields = ["case", "simulator", "quantity", "unit", "difference", "tolerance", "ok"]
    assert [list(row) for row in written["rows"]] == [fields] * 12
    assert {row["case"] for row in written["rows"]} == {"nesc 09"}


def test_a_tolerance_that_is_missed_exits_1(repository, tmp_path):
    file = repository / "tests/reference/cadac-ghame6" / "sturn50_total_h1e-4.csv.gz"
    result = run("verify", "ghame6", file, "--tolerance-scale", "0.01", "--json", tmp_path / "rows.json")
    assert result.exit_code == 1 and "OUTSIDE" in result.stdout
    written = json.loads((tmp_path / "rows.json").read_text())
    assert written["ok"] is False and written["rows"][0]["tolerance"] == pytest.approx(0.0009)
