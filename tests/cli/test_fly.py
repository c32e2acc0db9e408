"""``fly``."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.metrics import METRICS


def run(*words):
    return CliRunner().invoke(app, ["fly", *map(str, words)])


def test_fly_prints_every_metric_of_every_controller():
    out = run("level").stdout
    assert "level with abhv" in out and "tlc: The flight reached the end of the mission." in out
    rows = [line.split() for line in out.splitlines()]
    assert ["outcome", "ok", "ok"] in rows
    for metric in METRICS:
        values = next(row[1:] for row in rows if row and row[0] == metric.name)
        assert len(values) == 2 and np.isfinite([float(value) for value in values]).all()
    figures = json.loads(run("level", "--controllers", "lqr,tlc", "--json", "-").stdout)
    assert list(figures["controllers"]) == ["lqr", "tlc"] and figures["vehicle"] == "abhv"
    flown = figures["controllers"]["tlc"]
    assert flown["outcome"] == "ok" and flown["end_time_s"] == 60.0
    assert list(flown["metrics"]) == [metric.name for metric in METRICS]


def test_fly_writes_history_and_figures(repository, tmp_path):
    files = repository / "configs"
    mission, tlc = str(files / "mission/level.yaml"), str(files / "control/tlc.yaml")
    named = shutil.copy(tlc, tmp_path / "${$.yaml")  # which is no formula
    vehicle = files / "vehicle/ghame_x.yaml"
    flown = run(mission, "--vehicle", vehicle, "--controllers", f"{tlc},{named}", "-o", tmp_path / "level")
    history = pq.read_table(tmp_path / "level/nominal.parquet")
    assert history.column_names == ["controller", "time", *(channel.name for channel in CHANNELS)]
    np.testing.assert_allclose(history["time"][:6001], np.arange(6001) * 0.01, atol=1e-12)
    assert history["altitude_m"][0].as_py() == 20_000.0
    figures = sorted(path.name for path in (tmp_path / "level/figures").iterdir())
    assert figures == ["channels.png"]
    assert str(tmp_path / "level/figures" / figures[-1]) in flown.stdout.replace("\n", "")
