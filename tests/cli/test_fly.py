"""``fly`` and ``parameters``."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from abhv_mc.cli import fly as cli
from abhv_mc.cli import parameters
from abhv_mc.flight.channels import CHANNELS, METRICS
from abhv_mc.io.documents import InputError
from abhv_mc.plant.parameters import PARAMETERS


def test_fly_prints_every_metric_of_every_controller(capsys):
    cli.command("level", vehicle="ghame_x", controller=["tlc", "lqr"], out=None)
    out = capsys.readouterr().out
    assert "level with ghame_x" in out and "tlc: The flight reached the end of the mission." in out
    rows = [line.split() for line in out.splitlines()]
    assert ["outcome", "ok", "ok"] in rows
    for metric in METRICS:
        values = next(row[1:] for row in rows if row and row[0] == metric.name)
        assert len(values) == 2 and np.isfinite([float(value) for value in values]).all()


def test_fly_writes_history_and_figures(repository, tmp_path, capsys):
    files = repository / "configs"
    mission, tlc = str(files / "mission/level.yaml"), str(files / "control/tlc.yaml")
    named = shutil.copy(tlc, tmp_path / "${$.yaml")  # which is no formula
    controllers = [tlc, str(named)]
    cli.command(mission, vehicle=str(files / "vehicle/ghame_x.yaml"), controller=controllers, out=tmp_path / "level")
    history = pq.read_table(tmp_path / "level/nominal.parquet")
    assert history.column_names == ["controller", "time", *(channel.name for channel in CHANNELS)]
    np.testing.assert_allclose(history["time"][:6001], np.arange(6001) * 0.01, atol=1e-12)
    assert history["altitude_m"][0].as_py() == 20_000.0
    figures = sorted(path.name for path in (tmp_path / "level/figures").iterdir())
    assert len(figures) == 10 and figures[0] == "fig02_ground_track.png"
    assert str(tmp_path / "level/figures" / figures[-1]) in capsys.readouterr().out.replace("\n", "")


@pytest.mark.parametrize(
    ("mission", "controllers", "said"),
    [
        ("levle", ["tlc"], "level_mach15"),
        ("level", ["tlc", "tlc"], "different names"),
        ("level", ["no.yaml"], "no.yaml"),
    ],
)
def test_fly_refuses_what_it_cannot_fly(mission, controllers, said, tmp_path):
    with pytest.raises(InputError, match=said):
        cli.command(mission, vehicle="ghame_x", controller=controllers, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_parameters_lists_all_that_can_be_dispersed(capsys):
    parameters.command(json=True)
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert list(rows) == [parameter.name for parameter in PARAMETERS if parameter.name != "one"]
    assert rows["initial.altitude"] == {
        "name": "initial.altitude",
        "unit": "m",
        "nominal": 0.0,
        "doc": "error of the altitude at the start",
    }
    parameters.command(json=False)
    table = capsys.readouterr().out
    assert all(name in table for name in rows)
