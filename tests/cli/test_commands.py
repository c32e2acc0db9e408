"""Tests of the commands fly, trim, list, verify, margins and linearize."""

import json
import re
import shutil
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy.io
from golden import compare_report
from programs import invoke
from report.synthetic import CONTROLLERS

from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.cli.querying import list_shipped, show_records
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.metrics import BUILT_IN, METRICS
from abhv_mc_vehicle.plant.parameters import PARAMETERS


def test_fly_prints_every_metric_of_every_controller():
    out = invoke("fly", "level").stdout
    assert re.search(r"\blevel\b.*\babhv\b", out) and "\ntlc: " in out and "\nlqr: " in out
    rows = [line.split() for line in out.splitlines()]
    assert ["outcome", "ok", "ok"] in rows
    for metric in METRICS:
        values = next(row[1:] for row in rows if row and row[0] == metric.name)
        assert len(values) == 2 and np.isfinite([float(value) for value in values]).all()
    figures = json.loads(invoke("fly level --controllers lqr,tlc --json -").stdout)
    assert list(figures["controllers"]) == ["lqr", "tlc"] and figures["vehicle"] == "abhv"
    flown = figures["controllers"]["tlc"]
    assert flown["outcome"] == "ok" and flown["end_time_s"] == 60.0
    assert list(flown["metrics"]) == [metric.name for metric in METRICS]


def test_fly_writes_history_and_figures(repository, tmp_path):
    files = repository / "configs"
    mission, tlc = str(files / "mission/level.yaml"), str(files / "control/tlc.yaml")
    named = shutil.copy(tlc, tmp_path / "${$.yaml")  # not interpreted as a formula
    options = (
        "--vehicle",
        files / "vehicle/ghame_x.yaml",
        "--controllers",
        f"{tlc},{named}",
        "-o",
        tmp_path / "level",
    )
    flown = invoke("fly", mission, *options)
    history = pq.read_table(tmp_path / "level/nominal.parquet")
    assert history.column_names == ["controller", "time", *(channel.name for channel in CHANNELS)]
    np.testing.assert_allclose(history["time"][:6001], np.arange(6001) * 0.01, atol=1e-12)
    assert history["altitude_m"][0].as_py() == 20_000.0
    flexible = str(files / "mission/flexible.yaml")
    invoke("fly", flexible, "--vehicle", "flexible", "--controllers", "tlc", "-o", tmp_path / "f")
    assert "state.mode_1" in pq.read_table(tmp_path / "f/nominal.parquet").column_names
    assert str(tmp_path / "level/figures/channels.png") in flown.stdout.replace("\n", "")


def test_trim_prints_degrees_and_exits_with_1_if_a_point_has_no_trim(repository):
    result = invoke(
        "trim",
        "ghame",
        "--altitude",
        "20km",
        "--speed",
        "1400",
        "--bank",
        "0,50 deg",
        "--json",
        "-",
    )
    assert result.exit_code == 0
    numbers = json.loads(result.stdout)
    assert (numbers["altitude_m"], numbers["speed_mps"], numbers["mass_kg"]) == (
        20e3,
        1400.0,
        95254.0,
    )
    angles = [
        (point["trimmed"], point["bank_deg"], point["angle_of_attack_deg"])
        for point in numbers["points"]
    ]
    assert angles == [
        (True, 0.0, pytest.approx(3.59, abs=0.005)),
        (True, 50.0, pytest.approx(4.47, abs=0.01)),
    ]
    result = invoke("trim", "ghame_x", "--bank=0,89", "--mass", "1.3 t")
    assert result.exit_code == 1
    assert "ghame_x: 20 km, 1400 m/s, Mach 4.745" in result.stdout
    assert re.findall(r"(\d+) deg\b[^:\n]*: ", result.stdout) == ["89"]  # has no trim
    for flown in ("s_manoeuvre", "campaigns/s_manoeuvre.yaml"):
        point = json.loads(
            invoke("trim", repository / flown if "/" in flown else flown, "--json", "-").stdout
        )
        assert (point["altitude_m"], point["speed_mps"]) == (20e3, 1400.0)
        assert point["points"][0]["angle_of_attack_deg"] == pytest.approx(3.160, abs=0.001)
    climb = json.loads(invoke("trim f16_level --vehicle f16 --json -").stdout)
    assert climb["altitude_m"] == pytest.approx(3051.96, abs=0.01)
    error = invoke("trim", repository / "configs/vehicle/nesc/sphere.yaml").exception
    assert isinstance(error, InputError) and error.file.endswith("sphere.yaml")
    assert "surfaces" in error.found


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("parameters", [parameter.name for parameter in PARAMETERS if parameter.name != "one"]),
        ("channels", [channel.name for channel in CHANNELS]),
        ("metrics", list(BUILT_IN)),
        ("schemas", ["campaign", "vehicle", "mission", "controller", "report", "manifest"]),
    ],
)
def test_definitions_are_listed_as_text_and_as_json(kind, names):
    listed = json.loads(invoke(f"list {kind} --json -").stdout)
    assert [entry["name"] for entry in listed] == names
    table = invoke("list", kind).stdout
    assert all(f"{entry['name']} " in table and entry["doc"] in table for entry in listed)
    if kind == "schemas":
        assert json.loads(invoke("list schemas vehicle").stdout) == make_schema("vehicle")


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


def _call(*arguments):
    """Run a command without catching its errors, and return its standard output."""
    return invoke(*arguments, catch_exceptions=False).stdout


def test_margins_writes_rows_for_each_controller_time_and_loop(tmp_path):
    command = (
        "margins",
        "level",
        "--vehicle",
        "ghame_x",
        "--at",
        "trim,2s",
        "--controllers",
        "tlc,lqr_retuned_ghame_x",
    )
    rows = json.loads(invoke(*command, "--json", "-").stdout)["rows"]
    loops = ["aileron", "rudder", "elevator", "equivalence_ratio", "all"]
    assert [row["loop"] for row in rows] == loops * 4
    assert [row["time_s"] for row in rows[::5]] == [None, 2.0, None, 2.0]
    assert [row["controller"] for row in rows[::5]] == [
        "tlc",
        "tlc",
        "lqr_retuned_ghame_x",
        "lqr_retuned_ghame_x",
    ]
    assert all(list(row) == KEYS for row in rows if row["loop"] != "all")
    rudder = next(
        row
        for row in rows
        if row["controller"] == "lqr_retuned_ghame_x" and row["loop"] == "rudder"
    )
    assert rudder["gain_margin_low_db"] is None and rudder["gain_margin_high_db"] == pytest.approx(
        5.55, abs=0.01
    )
    assert rows[4]["disk_margin"] == pytest.approx(0.0579, abs=1e-4)
    assert rows[4]["disk_gain_db"] == pytest.approx(0.503, abs=1e-3)
    result = invoke(*command)
    assert "-1.31" in result.stdout and "none" in result.stdout
    assert re.search(r"equivalence_ratio 1\.002\d .* 1\.0000\b", result.stderr)


def test_margins_of_a_campaign_are_those_of_its_vehicle_mission_and_controllers(tmp_path):
    file = tmp_path / "rows.json"
    _call("margins", "winged_cone", "--controllers", "tlc", "--json", file)
    numbers = json.loads(file.read_text())
    assert numbers["vehicle"] == "winged_cone"
    assert {row["controller"] for row in numbers["rows"]} == {"tlc"}
    for options, problem in (
        (("--controllers", "pid"), "tlc"),
        (("--worst", "--at", "30s"), "--worst"),
    ):
        with pytest.raises(InputError, match=problem):
            _call("margins", "winged_cone", *options)


def _linearize(file, controller="tlc", instants="trim"):
    _call("linearize", "level", "-o", file, "--controller", controller, "--at", instants)


def test_linearize_writes_a_model_that_python_control_opens(tmp_path):
    import control  # it imports pyplot, for seconds

    _linearize(tmp_path / "model.npz")
    with np.load(tmp_path / "model.npz", allow_pickle=False) as model:
        period = float(model["period_s"])
        systems = {
            system: control.ss(
                *(model[f"{system}_{matrix}"] for matrix in "ABCD"), period, name=system
            )
            for system in ("plant", "law", "loop", "closed")
        }
        continuous = control.ss(*(model[f"plant_continuous_{matrix}"] for matrix in "ABCD"))
        states, units = model["closed_states"].tolist(), model["closed_state_units"].tolist()
    assert (
        len(states) == len(units) == 36
        and states[0] == "altitude"
        and states[-1] == "law_last_elevator"
    )
    discrete = control.sample_system(continuous, period, "zoh")
    np.testing.assert_allclose(discrete.A, systems["plant"].A, atol=1e-9)
    np.testing.assert_allclose(discrete.B, systems["plant"].B, atol=1e-9)
    # The closed loop of the file equals the feedback connection of plant and law.
    together = control.feedback(systems["plant"], systems["law"], sign=1)
    poles = np.sort(np.abs(together.poles()))
    np.testing.assert_allclose(poles, np.sort(np.abs(systems["closed"].poles())), atol=1e-6)
    assert np.abs(systems["closed"].poles()).max() < 1.0


def test_linearize_writes_the_same_model_in_each_format(tmp_path):
    for suffix in (".npz", ".mat", ".json"):
        _linearize(tmp_path / f"new/model{suffix}", "lqr_retuned_ghame_x", "1s")
    text = json.loads((tmp_path / "new/model.json").read_text())
    matlab = scipy.io.loadmat(tmp_path / "new/model.mat", simplify_cells=True)
    with np.load(tmp_path / "new/model.npz", allow_pickle=False) as packed:
        models = [
            text["loop"],
            matlab["loop"],
            {key: packed[f"loop_{key}"] for key in ("A", "B", "states")},
        ]
    for model, next_model in pairwise(models):
        for key in ("A", "B"):
            np.testing.assert_array_equal(np.array(model[key]), np.array(next_model[key]))
        assert list(model["states"]) == list(next_model["states"])


def test_linearize_rejects_invalid_options(tmp_path):
    for file, controller, instants, problem in (
        ("model.txt", "tlc", "trim", "npz"),
        ("model.npz", "tlc,lqr", "trim", "controller"),
        ("model.npz", "tlc", "trim,2s", "point"),
    ):
        with pytest.raises(InputError, match=problem):
            _linearize(tmp_path / file, controller, instants)
    assert list(tmp_path.iterdir()) == []


def test_linearize_at_several_times_stacks_the_models_of_each_time(tmp_path):
    _linearize(tmp_path / "path.npz", "lqr", "0s:1s:0.5s")
    _linearize(tmp_path / "one.npz", "lqr", "0.5s")
    with np.load(tmp_path / "path.npz") as path, np.load(tmp_path / "one.npz") as single:
        assert path["time_s"].tolist() == [0.0, 0.5, 1.0]
        for name in ("plant_A", "plant_B", "law_D", "closed_A"):
            assert np.array_equal(path[name][1], single[name]), name
        assert path["plant_A"].shape == (3, *single["plant_A"].shape)
        assert np.array_equal(path["plant_states"], single["plant_states"])


def test_linearize_can_write_only_the_gains_of_a_controller(tmp_path):
    result = invoke(f"linearize level --controller lqr --gains {tmp_path / 'gains.mat'}")
    assert result.exit_code == 0, result.exception
    assert scipy.io.loadmat(tmp_path / "gains.mat") and len([*tmp_path.iterdir()]) == 1


def test_the_numbers_that_commands_print_are_the_stored_ones(tmp_path):
    assert not compare_report("commands", tmp_path)


def test_records_are_listed_with_numbers_to_the_right(tmp_path, capsys):
    records = [
        {"name": "a", "unit": "m", "nominal": 1234567.0, "doc": "first"},
        {"name": "long", "unit": "-", "nominal": 0.5, "doc": "second"},
    ]
    show_records(records, None)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert [line.split() for line in lines] == [
        ["a", "m", "1.23457e+06", "first"],
        ["long", "-", "0.5", "second"],
    ]
    assert lines[0].index("1.23457e+06") + 11 == lines[1].index("0.5") + 3
    assert lines[0].index("first") == lines[1].index("second")


def test_shipped_files_are_listed_by_question_description_or_first_sentence(tmp_path, monkeypatch):
    texts = {
        "a": "question: Why?\ndescription: d\n",
        "b": "# First\n# words. Second.\nquestion: ''\ndescription: d\n",
        "c": "# Mach 2.5 flight. And\n# more.\nname: c\n# later\n",
        "d": "name: d\n",
    }
    paths = {name: tmp_path / f"{name}.yaml" for name in texts}
    for name, path in paths.items():
        path.write_text(texts[name])
    monkeypatch.setattr("abhv_mc.shipped.shipped_files", lambda kind: paths)
    list_shipped("campaign", tmp_path / "l.json")
    listed = json.loads((tmp_path / "l.json").read_text())
    assert [entry["name"] for entry in listed] == [*"abcd"]
    assert [entry["doc"] for entry in listed] == ["Why?", "d", "Mach 2.5 flight.", ""]


def test_queries_are_written_where_asked(failing_folder, tmp_path):
    sql = "select flight, controller from flights where flight < 2 order by controller, flight"
    names = sorted(CONTROLLERS)
    rows = [(flight, name) for name in names for flight in (0, 1)]
    table, numbers = tmp_path / "t.csv", tmp_path / "n.json"
    result = invoke("query", failing_folder, sql, "--csv", table, "--json", numbers)
    assert result.exit_code == 0 and result.stdout == ""
    assert table.read_text().split() == ["flight,controller", *(f"{k},{name}" for k, name in rows)]
    assert json.loads(numbers.read_text()) == [{"flight": k, "controller": n} for k, n in rows]
    assert names[0] in invoke("query", failing_folder, sql).stdout
    nothing = invoke("query", failing_folder, "/* nothing */", "--csv", tmp_path / "no.csv")
    assert nothing.exit_code == 0 and not (tmp_path / "no.csv").exists()
    exported = invoke("query", failing_folder, "--csv", tmp_path / "all").stdout.split()
    assert {*exported} == {str(path) for path in (tmp_path / "all").iterdir()} != set()
    same = "select 1 a, 2 b, 3 a"
    assert invoke("query", failing_folder, same, "--csv", "-").stdout.split() == ["a,b,a", "1,2,3"]
    for options in ((same, "--json", "-"), (), ("--csv", "-"), ("--json", "-")):
        assert isinstance(invoke("query", failing_folder, *options).exception, InputError)
