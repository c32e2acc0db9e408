"""Tests of the commands run, runs, replay, query and validate, and of their exit codes."""

import contextlib
import csv
import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import typer
from fake_flight import DENSITY, ENGINE, fly, interrupted_after, run, write_campaign

from abhv_mc.cli.running import exit_by_verdicts, finish, print_state
from abhv_mc.execution.runner import RunResult
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown, read_replayed
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import (
    ControllerCount,
    Manifest,
    RequirementVerdict,
    read_manifest,
    write_manifest,
)
from abhv_mc.report.pages.build import report_key
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.figures import draw_replayed
from abhv_mc.topics.topic import Models, Picture

pytestmark = pytest.mark.usefixtures("fake_engine", "no_figures")


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown")
    return run(write_campaign(folder / "files"), folder / "out", runs=60).folder


@pytest.fixture
def flown(campaign_folder, tmp_path):
    """Copy a campaign's folder."""
    return shutil.copytree(campaign_folder, tmp_path / "reports/fake")


def test_run_prints_outcomes_verdicts_and_digest(abhv_mc, tmp_path, monkeypatch):
    code, out, _ = abhv_mc("run", write_campaign(tmp_path / "files"), "--no-report")
    manifest = json.loads((tmp_path / "reports/fake/manifest.json").read_text())
    assert code == 0
    assert f"digest    {manifest['digest']}" in out
    assert "289 ok, 11 sideslip_limit" in out
    assert "complete, 300 of 300" in out and re.search(r"PASS 11 of 300\b", out)
    assert max(map(len, out.splitlines())) <= 80
    monkeypatch.setattr("abhv_mc.cli.running._MOST_COLUMNS", 0)
    out = abhv_mc("runs", tmp_path / "reports/fake")[1]
    assert re.search(r"(?m)^ +\w+ \* +PASS 11 of 300", out)


@pytest.mark.parametrize(("probability", "met"), [(0.9, "yes"), (0.999, "no")])
def test_the_recommended_next_command_works(abhv_mc, tmp_path, probability, met):
    """With too few flights it runs more, for PASS; with too many failures it explains them."""
    limit = f"below: 1e6, probability: {probability}, consumer_risk: 0.1"
    requirements = f"[{{metric: altitude_error_max_m, {limit}}}]"
    campaign = write_campaign(tmp_path / "files", requirements=requirements)
    runs = 20 if met == "yes" else 300
    output = abhv_mc(f"run {campaign} --runs {runs}")[1]
    (command,) = re.findall(r"^Next +`abhv-mc (.*)`:", output, re.M)
    code, output, err = abhv_mc(*shlex.split(command))
    if met == "yes":
        assert code == 0 and output.startswith("Meets "), err
    else:
        assert command == "explain reports/fake --all" and code == 0, err


def test_an_interrupt_is_exit_code_3_and_the_same_command_resumes(abhv_mc, tmp_path, monkeypatch):
    stopped, campaign = interrupted_after(5), write_campaign(tmp_path / "files")
    with monkeypatch.context() as patched:
        patched.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: stopped)
        code, out, err = abhv_mc("run", campaign)
    assert code == 3 and "interrupted" in out and "resume" in err
    assert not (tmp_path / "reports/fake/report.html").exists()
    assert "interrupted" in abhv_mc("runs", "reports/fake")[1]
    assert abhv_mc(f"run {campaign} --no-report")[0] == 0


def test_runs_shows_one_campaign_or_lists_several(abhv_mc, flown):
    code, out, _ = abhv_mc(f"runs {flown} --json -")
    status = json.loads(out)
    assert (
        code == 0
        and status["state"] == "complete"
        and status["runs_done"] == 60
        and status["holder"] is None
    )
    out = abhv_mc("runs", flown)[1]
    size = sum(path.stat().st_size for path in flown.rglob("*") if path.is_file())
    assert "complete, 60 of 60" in out and f"disk      {size / 1e6:.1f} MB" in out
    (flown.parent / "other").mkdir()
    (flown.parent / "other/manifest.json").write_text("{}")
    listed = json.loads(abhv_mc("runs --json -")[1])
    assert [entry["name"] for entry in listed] == ["fake"]
    assert status["digest"][:12] in abhv_mc("runs")[1]
    assert abhv_mc("runs", flown / "nowhere")[0] == 2
    manifest = flown / "manifest.json"
    write_manifest(manifest, replace(read_manifest(manifest), state="running"))  # killed
    assert json.loads(abhv_mc(f"runs {flown} --json -")[1])["state"] == "interrupted"


def test_replay_reproduces_a_flight_at_the_full_rate(abhv_mc, flown, tmp_path):
    flight = ("replay", flown, "--flight", 17, "--controller", "two")
    code, out, _ = abhv_mc(*flight, "-o", tmp_path / "h.parquet", "--json", "-")
    assert code == 0 and json.loads(out)["differences"] == []
    history = pq.read_table(tmp_path / "h.parquet")
    np.testing.assert_allclose(np.diff(history["time"].to_numpy()), 0.1)
    assert set(history["flight"].to_pylist()) == {17}
    code, _, err = abhv_mc(*flight, "-o", tmp_path / "h.csv")
    assert code == 2 and ".parquet" in err and not (tmp_path / "h.csv").exists()
    assert (
        abhv_mc(f"replay {flown} --flight 60")[0] == 2
        and abhv_mc(f"replay {flown} --flight 59")[0] == 0
    )


def test_a_plotted_flight_becomes_a_panel_of_the_report(abhv_mc, flown, tmp_path):
    folder = shutil.copytree(flown, tmp_path / "copy")
    key = report_key(folder)
    assert abhv_mc("replay", folder, "--flight", 17, "--controller", "two", "--plot")[0] == 0
    assert (folder / "replayed" / "two-17.png").read_bytes().startswith(b"\x89PNG")
    models = Models(read_flown(folder))
    assert Picture("replayed_two-17") in models.section(FLIGHTS).items
    (path,) = CampaignFolder(folder).replayed_files()
    text, figure = draw_replayed(path, models.names)
    assert text.name == "replayed_two-17"
    drawn = [line.get_ydata() for axis in figure.axes for line in axis.lines]
    shown = read_replayed(path)[2], models.results.nominal["two"]
    assert [any(np.array_equal(x, own["speed_mps"]) for x in drawn) for own in shown] == [True] * 2
    levels = {float(x[0]) for x in map(np.asarray, drawn) if x.size and np.ptp(x) == 0.0}
    assert {-50.0, 50.0} <= levels  # limits of the altitude error
    assert report_key(folder) != key and abhv_mc("verify", "campaign", folder)[0] == 0


def test_query(abhv_mc, flown):
    sql = (
        'select controller, count(*) n, max(abs("aero.lift" - 1)) d from flights '
        "group by controller order by 1"
    )
    code, out, _ = abhv_mc("query", flown, sql, "--json", "-")
    rows = json.loads(out)
    assert code == 0 and [(row["controller"], row["n"]) for row in rows] == [
        ("one", 60),
        ("two", 60),
    ]
    samples = pq.read_table(flown / "samples.parquet")["aero.lift"].to_numpy()
    assert rows[0]["d"] == np.abs(samples - 1).max()
    assert abhv_mc("query", flown, "select count(*) from samples", "--csv", "-")[1].split() == [
        "count_star()",
        "60",
    ]
    assert "60" in abhv_mc("query", flown, "select count(*) from samples")[1]
    for table in ("envelopes", "histories", "nominal", "reference"):
        assert abhv_mc("query", flown, f"from {table} limit 1")[0] == 0
    assert abhv_mc("query", flown, "selekt 1")[0] == 2
    assert abhv_mc("query", flown, "select 1 a, 2 a", "--json", "-")[0] == 2


ENDLESS = "select count(*) from flights a, flights b, flights c, flights d, flights e, flights f"
INTERRUPTED = """
import os, signal, sys, threading
from contextlib import contextmanager
from abhv_mc.cli.app import main
from abhv_mc.folder import tables

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background job
original = tables.open_database

@contextmanager
def opened(folder):
    with original(folder) as database:
        threading.Timer({delay}, os.kill, (os.getpid(), signal.SIGINT)).start()
        yield database

tables.open_database = opened
main()
"""


@pytest.mark.parametrize(
    "delay", [pytest.param(0.0, marks=pytest.mark.thorough), 0.3]
)  # s: before, while it runs
def test_an_endless_query_can_be_interrupted(flown, delay):
    """Only SIGKILL ended it."""
    program = [sys.executable, "-c", INTERRUPTED.format(delay=delay), "query", str(flown), ENDLESS]
    query = subprocess.run(program, stderr=subprocess.PIPE, text=True, timeout=60.0, check=False)
    assert query.returncode == 3 and "Traceback" not in query.stderr, query.stderr


def test_exported_numbers_are_exact(abhv_mc, flown, tmp_path):
    code, out, _ = abhv_mc(f"query {flown} --csv {tmp_path / 'csv'}")
    assert code == 0 and str(tmp_path / "csv/flights.csv") in out
    with (tmp_path / "csv/flights.csv").open() as file:
        rows = list(csv.DictReader(file))
    table = pq.read_table(flown / "flights").to_pylist()
    assert len(rows) == 120
    assert [float(row["aileron_rms_deg"]) for row in rows] == [
        row["aileron_rms_deg"] for row in table
    ]
    assert {path.name for path in (tmp_path / "csv").iterdir()} >= {
        "samples.csv",
        "envelopes.csv",
        "histories.csv",
    }


@pytest.mark.parametrize("controllers", ["{one: one.yaml}", "{one: one.yaml, two: two.yaml}"])
def test_a_campaign_in_which_all_flights_failed_to_run_is_incomplete(
    abhv_mc, tmp_path, monkeypatch, controllers
):
    """A campaign with 0 of 6 flights was complete, with exit code 0."""

    def none(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        tried = (parameters[:1, DENSITY] == 1.0).all()  # the first flight of the trial is nominal
        lost = np.full(
            len(parameters), not tried and (plan.controller == "one" or "two" not in controllers)
        )
        metrics, history = block.metrics.copy(), block.history.copy()
        metrics[lost], history[lost] = np.nan, np.nan
        return replace(
            block,
            outcome=np.where(lost, Outcome.FAILED_TO_RUN, block.outcome),
            metrics=metrics,
            history=history,
        )

    engine = replace(ENGINE, fly=none)
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: engine)
    keep = "{histories: {flights: none}, envelopes: {rate: 5 Hz}}"
    campaign = write_campaign(tmp_path / "files", runs="6", keep=keep, controllers=controllers)
    code, out, err = abhv_mc("run", campaign)
    assert code == 3 and re.search(r"(?m)^flights [a-z ]*: 6\b", err)
    assert "6 of 6" in out
    assert ("report    " in out) == ("two" in controllers)
    if "two" in controllers:
        page = (tmp_path / "reports/fake/report.html").read_text(encoding="utf-8")
        text = re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", page))
        assert "Missing one 6 of 6 failed" in text


@pytest.mark.parametrize(
    ("lost", "verdict", "code"), [(0, "PASS", 0), (0, "FAIL", 1), (2, "PASS", 3), (2, "FAIL", 3)]
)
def test_the_exit_code_is_3_if_flights_failed_to_run_and_a_requirement_failed(
    tmp_path, lost, verdict, code, capsys
):
    outcomes = {"ok": 300 - lost} | ({"failed_to_run": lost} if lost else {})
    entry = RequirementVerdict("a", 0.9, "one", verdict, verdict, below=1.0)
    manifest = Manifest("fake", "complete", 1, "", "", 300, 300 - lost, requirements=(entry,),
                        controllers={"one": ControllerCount(outcomes)})  # fmt: skip
    with pytest.raises(typer.Exit) if code else contextlib.nullcontext() as end:
        finish(RunResult(tmp_path, manifest), no_report=True)
    assert (end.value.exit_code if code else 0) == code
    assert re.findall(r"(?m)^flights [a-z ]*: (\d+)", capsys.readouterr().err) == (
        ["2"] if lost else []
    )


@pytest.mark.parametrize(
    ("state", "count", "is_common"),
    [("interrupted", 2, True), ("interrupted", 1, False), ("complete", 2, False)],
)
def test_an_incomplete_campaign_counts_flights_of_every_controller(
    tmp_path, capsys, state, count, is_common
):
    controllers = {f"c{k}": ControllerCount({"ok": 5}) for k in range(count)}
    manifest = Manifest("fake", state, 1, "", "", 9, 5, controllers=controllers)
    print_state(tmp_path, manifest, "d", [("run time", "2.0 s")])
    out = capsys.readouterr().out
    assert ("every controller" in out) == is_common and f"{state}, 5 of 9" in out
    assert out.count(" 5 ok") == count and "run time  2.0 s" in out


def entry(controller, verdict="PASS", words="PASS", **changes):
    entries = {"metric": "miss", "below": 5.0, "probability": 0.9, "failures": 3, "flights": 2000}
    return RequirementVerdict(
        controller=controller, verdict=verdict, words=words, **entries | changes
    )


@pytest.mark.parametrize("most", [0, 9])
def test_verdicts_are_printed_by_requirement_and_controller(monkeypatch, tmp_path, capsys, most):
    """With many controllers, each has a row. The first must meet its requirements."""
    monkeypatch.setattr("abhv_mc.cli.running._MOST_COLUMNS", most)
    few = "NOT SHOWN; too few flights"
    manifest = Manifest(
        name="x",
        state="running",
        seed=1,
        campaign_hash="",
        source_hash="",
        runs_done=1500,
        runs_planned=2000,
        digest="d",
        controllers={
            "one": ControllerCount({"lost": 7, "ok": 1493}, 1500),
            "two": ControllerCount({}, 0),
        },
        requirements=(entry("one"), entry("one", "NOT SHOWN", few, above=1.0, below=None)),
        requirements_shown=(
            entry("two", "FAIL", "FAIL; too many; late", failures=1200),
            entry("two", "NOT SHOWN", few, above=1.0, below=None, probability=0.95, set_later=True),
        ),
    )
    print_state(tmp_path, manifest, "there", [("disk", "5 MB")])
    out = capsys.readouterr().out.replace("\u202f", "")
    lines = [line.split() for line in out.splitlines() if line.strip()]
    assert lines[0] == ["folder", "there"] and lines[1][:5] == [
        "flights",
        "running,",
        "1500",
        "of",
        "2000",
    ]
    assert len(lines[1]) > 5  # not all controllers have flown
    assert lines[2:4] == [["one", "7", "lost,", "1493", "ok"], ["two", "none"]]
    assert ["digest", "d"] in lines and ["disk", "5", "MB"] in lines
    label = entry("two", "NOT SHOWN", few, set_later=True).label
    cells = {
        "miss below 5 in 90 %": ["PASS 3 of 2000", "FAIL 1200 of 2000"],
        "miss above 1 in 90 %": ["NOT SHOWN 3 of 2000", ""],
        "miss above 1 in 95 %": ["", f"{label} 3 of 2000"],
    }
    if most:
        (head,) = [line for line in lines if line[:2] == ["one", "*"]]
        assert head == ["one", "*", "two"]
        for asked, texts in cells.items():
            assert f"{asked} {' '.join(texts)}".split() in lines
    else:
        for k, name in enumerate(("one *", "two")):
            row = " ".join([name, *(texts[k] for texts in cells.values())]).split()
            assert row in lines
    reasons = [line[:6] for line in lines if line[1:4] == ["of", "4", "verdicts"]]
    assert sorted(reasons) == [
        *(
            ["1", "of", "4", "verdicts", "FAIL:", "late"],
            ["1", "of", "4", "verdicts", "FAIL:", "too"],
        ),
        ["2", "of", "4", "verdicts", "NOT", "SHOWN:"],
    ]


@pytest.mark.parametrize(
    ("labels", "code"),
    [
        ([("a", "PASS"), ("b", "FAIL, requirement set later")], 1),
        ([("a", "NOT SHOWN"), ("b", "PASS, after a FAIL")], 0),
        ([], 0),
    ],
)
def test_a_failed_verdict_decides_the_exit_code(labels, code):
    if not code:
        exit_by_verdicts(labels)
        return
    with pytest.raises(typer.Exit) as caught:
        exit_by_verdicts(labels)
    assert caught.value.exit_code == code
