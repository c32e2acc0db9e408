"""Tests of the commands new and validate, and of the schemas of input files."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from own_simulators import dive_campaign
from programs import invoke

import abhv_mc
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.kinds import find_kind
from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.campaign.file.unknowns import unknowns_hint
from abhv_mc.check_inputs import check_inputs
from abhv_mc.cli.starting import _print_plan, _records
from abhv_mc.execution.estimate import Estimate
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc.requests import Request
from abhv_mc.shipped import (
    find_input,
    shipped_campaigns,
    shipped_configs,
    shipped_files,
    shipped_folder,
)
from abhv_mc.topics.topic import full_labels
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.new_campaign import _QUESTION, write_new_campaign, write_new_simulator


@pytest.mark.parametrize("name", ["s_manoeuvre", "failures", "wide", "flexible", "navigation"])
def test_a_new_folder_is_self_contained(name, tmp_path):
    folder = tmp_path / "deep" / "study"
    written = write_new_campaign(folder, name)
    assert {check.kind for check in check_inputs(written[0])} == {
        "campaign",
        "vehicle",
        "mission",
        "controller",
    }
    created, shipped = (
        read_campaign(written[0]).model,
        read_campaign(shipped_files("campaign")[name]).model,
    )
    for file in (created.vehicle, created.mission, *created.controllers.values()):
        assert file.resolve().is_relative_to(folder)
    assert created.dispersions == shipped.dispersions
    assert created.name == "study"
    assert find_input(folder, "campaign") == find_input(f"{folder}/", "campaign") == written[0]
    assert "#" in written[0].read_text()


def test_a_new_folder_with_another_vehicle_omits_controllers_of_the_first(tmp_path):
    mine = tmp_path / "mine"
    shutil.copytree(shipped_configs() / "vehicle", mine)
    (mine / "ghame.yaml").rename(mine / "own.yaml")
    campaign, *files = write_new_campaign(tmp_path / "study", vehicle=mine / "own.yaml", tune=True)
    model = read_campaign(campaign).model
    assert model.vehicle.resolve() == tmp_path / "study/vehicle/own.yaml"
    assert not model.question and "tuned for this vehicle" not in campaign.read_text("utf-8")
    assert list(model.controllers) == ["tlc", "lqr"] and model.tune is not None
    assert tmp_path / "study/vehicle/abhv.yaml" not in files
    assert not [warning for check in check_inputs(campaign) for warning in check.warnings]
    campaign, *_ = write_new_campaign(
        tmp_path / "shipped", vehicle=shipped_files("vehicle")["ghame_x"]
    )
    controllers = read_campaign(campaign).model.controllers
    assert "tlc_robust_ghame_x" in controllers and "tlc_robust" not in controllers


def test_a_vehicle_with_files_elsewhere_is_rejected_without_files(tmp_path):
    shutil.copytree(shipped_configs() / "vehicle/ghame", tmp_path / "deck")
    text = (shipped_configs() / "vehicle/ghame.yaml").read_text().replace("ghame/", "../deck/")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/own.yaml").write_text(text)
    with pytest.raises(InputError, match=r"own\.yaml: .*deck"):
        write_new_campaign(tmp_path / "study", vehicle=tmp_path / "mine/own.yaml")
    assert not (tmp_path / "study").exists()


def test_the_first_validation_of_a_template_gives_no_warning(tmp_path):
    for law in (None, "python", "c"):
        campaign, *_ = write_new_campaign(tmp_path / str(law), law=law)
        assert not [warning for check in check_inputs(campaign) for warning in check.warnings]
    lqr = tmp_path / "flown/inputs/controllers/lqr/lqr.yaml"
    lqr.parent.mkdir(parents=True)
    shutil.copy(tmp_path / "None/control/lqr.yaml", lqr)
    assert full_labels(tmp_path / "flown", ["lqr"]) == {"lqr": "LQR (paper's weights)"}


def test_new_files_name_their_schema_and_are_valid(tmp_path):
    files = [file for file in write_new_campaign(tmp_path / "study") if file.suffix == ".yaml"]
    assert len(files) > 4
    files += write_new_simulator(tmp_path / "simulator", "python")[:1]
    for file in files:
        name = file.read_text().splitlines()[0].removeprefix("# yaml-language-server: $schema=")
        schema = json.loads((file.parent / name).read_text())
        assert schema["$id"].endswith(f":{find_kind(file)}")
        assert list(Draft202012Validator(schema).iter_errors(read_document(file).data)) == []


def test_a_custom_law_comes_with_a_campaign_and_completes_its_flight(tmp_path):
    written = write_new_campaign(tmp_path / "study", law="python")
    model = read_campaign(written[0]).model
    assert next(iter(model.controllers)) == "my_law"
    assert model.question == _QUESTION
    checks = check_inputs(written[0])  # compiles it and runs a tick
    assert not any(check.warnings for check in checks if check.path.name == "my_law.yaml")
    flight = abhv_mc.fly(model.mission, model.vehicle, model.controllers["my_law"], every=100)
    assert (
        flight.attrs["outcome"] == "ok" and flight.attrs["metrics"]["altitude_error_max_m"] < 50.0
    )


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_law_in_c_equals_the_law_in_python_and_builds_by_its_makefile(tmp_path):
    python, c = (
        write_new_campaign(tmp_path / law, law=law)[0].parent / "control" for law in ("python", "c")
    )
    code = (c / "my_law.c").read_text()
    assert code.count("#define EVERY 10 ") == 1
    (c / "my_law.c").write_text(
        code.replace("#define EVERY 10 ", "#define EVERY 1 ")
    )  # guidance at every tick, too
    flights = [
        abhv_mc.fly("level", controller=folder / "my_law.yaml", every=100) for folder in (python, c)
    ]
    assert flights[1].attrs["outcome"] == "ok"
    assert flights[1].equals(flights[0])
    subprocess.run(["make", "--quiet", "CC=cc"], cwd=c, check=True)
    text = (c / "my_law.yaml").read_text().replace("sources: [my_law.c]", "library: libmy_law.so")
    (c / "my_law.yaml").write_text(text)
    assert abhv_mc.fly("level", controller=c / "my_law.yaml", every=100).equals(flights[0])


def fly_both(folder):
    """Return the metrics of 20 flights of each system of a new simulator's campaign."""
    out = folder / "out"
    run_campaign(Request(folder / "campaign.yaml", out, runs=20))
    flights = read_flown(out).flights
    return [
        {name: flights[system].metrics[name].tolist() for name in ("apogee", "load_max")}
        for system in flights
    ]


@pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None, reason="no C compiler"
)
def test_a_simulator_in_c_equals_the_one_in_python(tmp_path):
    python, c = (
        write_new_simulator(tmp_path / kind, kind)[0].parent for kind in ("python", "command")
    )
    assert (c / "rocket").is_file()
    flown = fly_both(python)
    assert flown == fly_both(c)
    predicted, timed = flown
    assert max(predicted["apogee"]) < max(timed["apogee"])  # brakes that react to excess height


def test_without_a_compiler_the_program_is_left_to_be_built(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    result = invoke("new", tmp_path / "study", "--simulator", "command")
    assert (
        result.exit_code == 0
        and "make" in result.output
        and not (tmp_path / "study" / "rocket").exists()
    )


def test_existing_files_and_unknown_names_or_kinds_are_rejected(tmp_path):
    with pytest.raises(InputError, match=r"(?s)'failure'.*failures"):
        write_new_campaign(tmp_path / "x", "failure")
    (tmp_path / "mine").write_text("precious")
    for folder in (tmp_path, tmp_path / "mine"):
        with pytest.raises(InputError, match="empty"):
            write_new_campaign(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    (tmp_path / "mine").write_text("colour: red\n")
    with pytest.raises(InputError, match="'campaign', 'vehicle', 'mission' or 'controller'"):
        find_kind(tmp_path / "mine")


@pytest.mark.parametrize("option", [["--law"], ["--tune"], ["--vehicle", "abhv"]])
def test_options_of_the_built_in_simulator_are_refused_for_a_custom_one(abhv_mc, tmp_path, option):
    code, _, err = abhv_mc("new", tmp_path / "x", "--simulator", "python", *option)
    assert code == 2 and "--simulator" in err and not (tmp_path / "x").exists()


FOLDERS = {
    "campaigns": "campaign",
    "configs/vehicle": "vehicle",
    "configs/mission": "mission",
    "configs/control": "controller",
}
SHIPPED = [
    (kind, path)
    for folder, kind in FOLDERS.items()
    for path in sorted((shipped_folder() / folder).rglob("*.yaml"))
    if path.name
    != "check_cases.yaml"  # initial states and commands of published flights: no input of a command
]


@pytest.mark.parametrize(("kind", "path"), SHIPPED, ids=lambda value: getattr(value, "stem", value))
def test_shipped_files_are_valid_and_fit_their_schema(kind, path):
    assert find_kind(path) == kind
    assert check_inputs(path)[0].kind == kind
    assert list(Draft202012Validator(make_schema(kind)).iter_errors(read_document(path).data)) == []


def test_all_errors_of_all_files_are_reported(tmp_path):
    for folder in (shipped_configs(), shipped_campaigns()):
        shutil.copytree(folder, tmp_path / folder.name)
    for name, old, new in (
        ("mission/paper_s", "name:", "nmae:"),
        ("control/tlc", "law: tlc", "law: tcl"),
    ):
        path = tmp_path / f"configs/{name}.yaml"
        path.write_text(path.read_text().replace(old, new, 1))
    answer = invoke("validate", tmp_path / "campaigns/s_manoeuvre.yaml")
    assert isinstance(answer.exception, InputErrors)
    assert {Path(error.file).name for error in answer.exception.errors} == {
        "paper_s.yaml",
        "tlc.yaml",
    }


def test_a_hint_names_parameters_that_may_be_constant_but_unknown():
    names = ("s_manoeuvre", "wide", "s_manoeuvre_unknown")
    hints = {
        name: unknowns_hint(read_campaign(shipped_campaigns() / f"{name}.yaml").names)
        for name in names
    }
    assert "'aero.lift' and 'aero.drag'" in hints["s_manoeuvre"]
    assert hints["wide"] and not hints["s_manoeuvre_unknown"]


def test_the_schema_rejects_wrong_names_and_values():
    validator = Draft202012Validator(make_schema("campaign"))
    right = read_document(shipped_folder() / "campaigns/s_manoeuvre.yaml").data
    del right["metrics"]  # with custom metrics a requirement may name any
    requirement = right["requirements"][0]
    for wrong in (
        {**right, "requirements": [{**requirement, "metric": "altitude_eror_max_m"}]},
        {**right, "dispersions": {"aero.lfit": {"distribution": "normal", "sigma": "1 %"}}},
        {**right, "sampling": "montecarlo"},
        {**right, "execution": {"flight_time_limit": 10.0}},
        {**right, "execution": {"flight_time_limit": "10"}},
    ):
        assert not validator.is_valid(wrong), wrong
    named, own = make_schema("campaign")["$defs"]["RequirementEntry"]["properties"]["metric"][
        "anyOf"
    ]
    assert set(METRIC_INDEX) < set(named["enum"]) and "pattern" in own


@pytest.mark.parametrize(
    ("options", "law", "file"),
    [
        ((), None, None),
        (("--law",), "python", "my_law.py"),
        (("--law", "c"), "c", "my_law.c"),
        (("--tune",), None, None),
        (
            ("--law", "python", "--tune", "--vehicle", "ghame_x", "--from", "wide"),
            "python",
            "my_law.py",
        ),
    ],
)
def test_next_commands_are_those_for_the_files_written(tmp_path, monkeypatch, options, law, file):
    written = []

    def write(folder, source, law, **further):
        written.append((folder, source, law, further))
        return [folder / "campaign.yaml", folder / "a", folder / "b"]

    monkeypatch.setattr("abhv_mc_vehicle.new_campaign.write_new_campaign", write)
    result = invoke("new", tmp_path / "x", *options)
    assert result.exit_code == 0
    ((folder, source, wanted, further),) = written
    assert (folder, source, wanted) == (
        tmp_path / "x",
        "wide" if "wide" in options else "s_manoeuvre",
        law,
    )
    vehicle = shipped_files("vehicle")["ghame_x"] if "ghame_x" in options else None
    assert further == {"vehicle": vehicle, "tune": "--tune" in options}
    first, *lines = result.stdout.splitlines()
    assert f"{folder / 'campaign.yaml'}, further files: 2" in first
    assert [line.split()[4] for line in lines] == [
        *["fly"] * (law is not None),
        *["tune"] * ("--tune" in options),
        "run",
    ]
    assert law is None or lines[0].endswith(file)


def test_a_language_without_a_law_is_refused(tmp_path):
    error = invoke("new", tmp_path / "x", "c").exception
    assert isinstance(error, InputError) and error.expected == "--law c"


def test_inputs_are_checked_and_written(own_list, tmp_path):
    limit = [{"metric": "load", "below": 7.0, "probability": "95 %"}]
    campaign = dive_campaign(tmp_path / "f", requirements=limit)
    table = tmp_path / "inputs.csv"
    result = invoke("validate", campaign, "--runs", 1200, "--samples", table)
    assert result.exit_code == 0
    check, *_, last = result.stdout.splitlines()
    assert check.split()[0] == f"{campaign}:" and check.split()[-2] == "campaign"
    assert last.split()[0] == f"{table}:" and "1200 flights" in last.replace("\u202f", "")
    assert len(table.read_text("utf-8").splitlines()) == 1201
    result = invoke("validate", campaign, "--json", "-")
    assert json.loads(result.stdout) == {} and f"{campaign}:" in result.stderr
    assert invoke("validate", campaign, campaign).exit_code == 0
    for option, value in (("--samples", table), ("--output", tmp_path / "o")):
        error = invoke("validate", campaign, campaign, option, value).exception
        assert isinstance(error, InputError) and error.file == option and "2" in error.found


COST = Estimate(
    flights=4000,
    controllers=3,
    kind="system",
    workers=2,
    batch=64,
    flight_s=0.25,
    flying_s=1600.0,
    rows_bytes=3_000_000,
    histories_bytes=500_000,
    searched=200,
    kept=7,
    envelope_bytes=20_000_000,
    warnings=(),
)


def plain(text):
    return text.replace("\u202f", "").replace("\xa0", " ")


def test_records_of_a_dry_run_state_cost_and_conditions():
    def texts(cost, plan, hint=""):
        records = _records(cost, plan, hint).records
        return {record.label: plain(record.entries[0].text) for record in records}

    found = texts(COST, None, "hint")
    assert found["Flights"] == "4000 per system (3)" and found["Unknowns"] == "hint"
    assert found["Search"].startswith("200 ") and found["Search"].endswith(" 75 s")
    assert re.findall(r"[\d.]+", found["Time"]) == ["1600", "2", "250.00", "64"]
    assert re.findall(r"[\d.]+", found["Disk"]) == ["23.5", "3.0", "7", "0.5", "20.0"]
    assert [*found] == ["Flights", "Search", "Time", "Disk", "Unknowns"]
    plan = SimpleNamespace(
        most_points=9, runs=800, search_flights=600, family_risk=0.0525, independent_flights=False
    )
    found = texts(replace(COST, searched=0), plan)
    assert re.findall(r"\d+", found["Points of the unknowns"]) == ["9", "800", "600"]
    assert "5.2" in found["Any false PASS"] and "Sampling" in found
    assert not {"Search", "Unknowns"} & found.keys()
    plan.most_points, plan.family_risk, plan.independent_flights = 1, None, True
    assert [*texts(COST, plan)] == ["Flights", "Search", "Time", "Disk"]


@pytest.mark.parametrize("count", [1, 2])
def test_the_table_of_a_plan_has_flights_and_chances_at_a_fifth_of_the_allowed_rate(capsys, count):
    def chance(*pair):
        return SimpleNamespace(at_some_flight=[0.9, pair[0], 0.1], at_runs=[0.8, pair[1], 0.2])

    band = SimpleNamespace(low=[0.0, 0.5512, 1.0], high=[0.0, 0.6513, 1.0])
    planned = SimpleNamespace(
        name="own",
        runs=1000,
        rates_over_allowed=np.array([0.1, 0.21, 0.5]),
        requirements=[
            SimpleNamespace(
                words=f"r{k}",
                probability=0.9,
                flights_for_failures={str(n): 100 * n + k + 22 for n in range(4)},
                pass_chance=(chance(0.301, 0.252), chance(0.703, 0.454)),
            )
            for k in range(count)
        ],
        together=[SimpleNamespace(runs=runs, at_some_flight=band) for runs in (1000, 2000)],
    )
    _print_plan(planned)
    lines = plain(capsys.readouterr().out).replace(" %", "%").splitlines()
    (head,) = [line for line in lines if line.strip().startswith("requirement")]
    assert re.findall(r"\d+", head) == ["0", "1", "2", "3", "1000", "2000"]
    rows = [line.split() for line in lines if re.match(r" *r\d in 90", line)]
    assert [row[3:] for row in rows] == [
        [*(str(100 * n + k + 22) for n in range(4)), "30%", "(25%)", "70%", "(45%)"]
        for k in range(count)
    ]
    together = [line.split() for line in lines if line.startswith("All PASS by 1000")]
    assert [row[-3:] for row in together] == [["55%", "to", "65%"]] * (count > 1)
