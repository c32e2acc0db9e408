"""``margins`` and ``linearize``."""

import json
from itertools import pairwise

import control
import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.io.documents import InputError

KEYS = [
    "controller",
    "time_s",
    "loop",
    "gain_margin_low_db",
    "gain_margin_high_db",
    "phase_margin_deg",
    "delay_margin_ms",
    "sensitivity_peak",
    "crossover_rad_s",
    "stable",
]


def _call(*words):
    """Run a command, as its errors are raised; gives its standard output."""
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False).stdout


def test_margins_writes_rows_for_each_controller_time_and_loop(tmp_path):
    words = ("margins", "level", "--vehicle", "ghame_x", "--at", "trim,2s", "--controllers", "tlc,lqr_retuned")
    rows = json.loads(CliRunner().invoke(app, [*words, "--json", "-"]).stdout)["rows"]
    loops = ["aileron", "rudder", "elevator", "equivalence_ratio", "all"]
    assert [row["loop"] for row in rows] == loops * 4
    assert [row["time_s"] for row in rows[::5]] == [None, 2.0, None, 2.0]
    assert [row["controller"] for row in rows[::5]] == ["tlc", "tlc", "lqr_retuned", "lqr_retuned"]
    assert all(list(row) == KEYS for row in rows if row["loop"] != "all")
    rudder = next(row for row in rows if row["controller"] == "lqr_retuned" and row["loop"] == "rudder")
    assert rudder["gain_margin_low_db"] is None and rudder["gain_margin_high_db"] == pytest.approx(5.55, abs=0.01)
    assert rows[4]["disk_margin"] == pytest.approx(0.0579, abs=1e-4)
    assert rows[4]["disk_gain_db"] == pytest.approx(0.503, abs=1e-3)
    said = CliRunner().invoke(app, words)
    assert "-1.31" in said.stdout and "none" in said.stdout
    assert "near the node 1.0000" in said.stderr


def test_an_unstable_loop_has_no_margins_but_poles():
    words = ("margins", "level", "--vehicle", "ghame_x", "--controllers", "lqr")
    rows = json.loads(_call(*words, "--at", "trim", "--json", "-"))["rows"]
    assert not any(row["stable"] for row in rows)
    assert all(rows[0][key] is None for key in KEYS[3:9])
    np.testing.assert_allclose(rows[4]["poles"], [[0.120, 2.783]], atol=1e-3)
    assert "unstable, no margins; poles +0.120 +- 2.78j per second" in _call(*words)


def test_margins_of_a_campaign_are_those_of_its_vehicle_mission_and_controllers(tmp_path):
    file = tmp_path / "rows.json"
    _call("margins", "winged_cone", "--controllers", "tlc", "--json", file)
    found = json.loads(file.read_text())
    assert found["vehicle"] == "winged_cone" and {row["controller"] for row in found["rows"]} == {"tlc"}
    for words, found in ((("--controllers", "pid"), "tlc"), (("--worst", "--at", "30s"), "--worst")):
        with pytest.raises(InputError, match=found):
            _call("margins", "winged_cone", *words)


def _linearize(file, controller="tlc", at="trim"):
    _call("linearize", "level", "-o", file, "--controller", controller, "--at", at)


def test_linearize_writes_a_model_that_python_control_opens(tmp_path):
    _linearize(tmp_path / "model.npz")
    with np.load(tmp_path / "model.npz", allow_pickle=False) as found:
        period = float(found["period_s"])
        systems = {
            part: control.ss(*(found[f"{part}_{each}"] for each in "ABCD"), period, name=part)
            for part in ("plant", "law", "loop", "closed")
        }
        continuous = control.ss(*(found[f"plant_continuous_{each}"] for each in "ABCD"))
        states, units = found["closed_states"].tolist(), found["closed_state_units"].tolist()
    assert len(states) == len(units) == 36 and states[0] == "altitude" and states[-1] == "law_last_elevator"
    held = control.sample_system(continuous, period, "zoh")
    np.testing.assert_allclose(held.A, systems["plant"].A, atol=1e-9)
    np.testing.assert_allclose(held.B, systems["plant"].B, atol=1e-9)
    # The closed loop is the plant under the law, whichever way it is put together.
    together = control.feedback(systems["plant"], systems["law"], sign=1)
    poles = np.sort(np.abs(together.poles()))
    np.testing.assert_allclose(poles, np.sort(np.abs(systems["closed"].poles())), atol=1e-6)
    assert np.abs(systems["closed"].poles()).max() < 1.0


def test_linearize_says_the_same_in_each_format(tmp_path):
    for suffix in (".npz", ".mat", ".json"):
        _linearize(tmp_path / f"new/model{suffix}", "lqr_retuned", "1s")
    text = json.loads((tmp_path / "new/model.json").read_text())
    matlab = scipy.io.loadmat(tmp_path / "new/model.mat", simplify_cells=True)
    with np.load(tmp_path / "new/model.npz", allow_pickle=False) as packed:
        models = [text["loop"], matlab["loop"], {key: packed[f"loop_{key}"] for key in ("A", "B", "states")}]
    for one, other in pairwise(models):
        for key in ("A", "B"):
            np.testing.assert_array_equal(np.array(one[key]), np.array(other[key]))
        assert list(one["states"]) == list(other["states"])


def test_linearize_refuses_what_it_cannot_write(tmp_path):
    for file, controller, at, words in (
        ("model.txt", "tlc", "trim", "npz"),
        ("model.npz", "tlc,lqr", "trim", "one controller"),
        ("model.npz", "tlc", "trim,2s", "one point"),
    ):
        with pytest.raises(InputError, match=words):
            _linearize(tmp_path / file, controller, at)
    assert list(tmp_path.iterdir()) == []


def test_linearize_along_a_path_is_each_of_its_times(tmp_path):
    _linearize(tmp_path / "path.npz", "lqr", "0s:1s:0.5s")
    _linearize(tmp_path / "one.npz", "lqr", "0.5s")
    with np.load(tmp_path / "path.npz") as path, np.load(tmp_path / "one.npz") as one:
        assert path["time_s"].tolist() == [0.0, 0.5, 1.0]
        for name in ("plant_A", "plant_B", "law_D", "closed_A"):
            assert np.array_equal(path[name][1], one[name]), name
        assert path["plant_A"].shape == (3, *one["plant_A"].shape)
        assert np.array_equal(path["plant_states"], one["plant_states"])
