"""Creation and verification of reports, and verdicts as JUnit XML and CSV."""

import csv
import json
import shutil
from xml.etree import ElementTree

import numpy as np
import pytest
from fake_flight import ENGINE
from fake_flight import write_campaign as write_fake
from programs import invoke
from report.synthetic import build_page, write_campaign

from abhv_mc.cli.running import finish
from abhv_mc.execution.runner import RunResult, run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import ControllerCount, Manifest
from abhv_mc.report.pages.build import build_report, hash_pages, is_up_to_date
from abhv_mc.report.pages.verify import find_differences, verify_campaign
from abhv_mc.requests import Request
from abhv_mc.shipped import shipped_campaigns
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.topic import Models


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """Write a campaign whose flights all terminate early, at 5 s, with its report."""
    controllers = ("lqr", "lqr_retuned")
    folder = write_campaign(
        tmp_path_factory.mktemp("lost") / "c", runs=30, failing=30, end=5.0, controllers=controllers
    )
    build_report(folder)
    return folder


def test_a_campaign_without_a_whole_flight_gets_its_report(lost):
    assert (lost / "report.html").is_file() and (lost / "figures/channels.png").is_file()


def test_a_second_run_with_nothing_new_does_not_make_the_report_again(lost, monkeypatch, capsys):
    """Regression: a second run took 12.5 s, almost all of them for the same report."""

    def never(*_):
        raise AssertionError("made again")

    monkeypatch.setattr("abhv_mc.report.pages.build.build_report", never)
    counts = {"lqr": ControllerCount({"sideslip_limit": 30})}
    manifest = Manifest("lost", "complete", 1, "", "", 30, 30, controllers=counts)
    finish(RunResult(lost, manifest), no_report=False)
    assert "report.html" in capsys.readouterr().out


def test_a_report_is_up_to_date_until_something_changes(lost):
    assert is_up_to_date(lost)
    for name in ("report.html", "manifest.json"):
        content = (lost / name).read_bytes()
        (lost / name).write_bytes(content + b" ")
        assert not is_up_to_date(lost), name
        (lost / name).write_bytes(content)
        assert is_up_to_date(lost)


def test_figures_are_svg_where_asked_for(lost):
    assert not list((lost / "figures").glob("*.svg"))
    build_report(lost, svg=True)
    drawn = [
        {path.stem for path in (lost / "figures").glob(f"*.{kind}")} for kind in ("svg", "png")
    ]
    assert drawn[0] == drawn[1] and is_up_to_date(lost)


@pytest.fixture
def copy(report_folder, tmp_path):
    return shutil.copytree(report_folder, tmp_path / "copy")


def flipped(path, position):
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    "name", ["report.html", "metrics.csv", "verification_matrix.csv", "figures/channels.png"]
)
def test_a_changed_bit_of_a_page_or_figure_is_found_and_a_missing_one(copy, name):
    flipped(copy / name, (copy / name).stat().st_size // 2)
    changed = next(verify_campaign(copy))
    (copy / name).unlink()
    missing = next(verify_campaign(copy))
    assert changed.startswith(f"{name}: ") and missing.startswith(f"{name}: missing")
    assert changed != missing


def test_flights_are_checked_without_a_report(copy):
    (copy / "report.json").unlink()
    assert [line.split(":")[0] for line in verify_campaign(copy)] == ["report.json"]
    (copy / "report.html").unlink()
    assert list(verify_campaign(copy)) == []
    flights = next((copy / "flights").glob("*.parquet"))
    flipped(flights, flights.stat().st_size // 2)
    assert next(verify_campaign(copy)).startswith("flights/")


def test_a_verdict_changed_in_the_matrix_is_found(copy):
    matrix = copy / "verification_matrix.csv"
    text = matrix.read_text("utf-8")
    assert ",FAIL," in text
    matrix.write_text(text.replace(",FAIL,", ",PASS,", 1), "utf-8")
    assert [line.split(":")[0] for line in verify_campaign(copy)] == [matrix.name]
    assert not is_up_to_date(copy)


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("no_figures")
def test_a_report_elsewhere_leaves_the_folder_as_it_was(copy, tmp_path):
    before, parts = contents(copy), [copy, *copy.rglob("*")]
    for path in parts:
        path.chmod(0o555 if path.is_dir() else 0o444)
    out = tmp_path / "there" / "deep"
    page = build_report(copy, out=out)
    for path in parts:
        path.chmod(0o755 if path.is_dir() else 0o644)
    assert page == out / "report.html" and contents(copy) == before
    tables = {"report.html", "metrics.csv", "verification_matrix.csv"}
    assert {path.name for path in contents(out)} == {*tables, "report.json"}
    written = json.loads((out / "report.json").read_text("utf-8"))
    assert written["pages"] == hash_pages(out, tables)


def test_rows_computed_again_in_other_blocks_are_the_same_rows(tmp_path):
    path = write_fake(tmp_path / "f", requirements=REQUIREMENTS)
    out = tmp_path / "out"
    run_campaign(Request(path, out), ENGINE)
    build_page(out)
    blocks = {file.name for file in (out / "flights").glob("*.parquet")}
    next((out / "flights").glob("*.parquet")).unlink()
    path = write_fake(tmp_path / "f", requirements=REQUIREMENTS, execution="{batch: 7}")
    assert run_campaign(Request(path, out), ENGINE).complete
    assert {file.name for file in (out / "flights").glob("*.parquet")} != blocks
    assert list(verify_campaign(out)) == []


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "runs"), [("wide", 100), ("wind_and_sensors", 40)])
def test_reports_of_shipped_campaigns_follow_from_their_data(name, runs, engine, tmp_path):
    flown = run_campaign(
        Request(shipped_campaigns() / f"{name}.yaml", tmp_path / name, runs), engine
    )
    build_report(flown.folder)
    assert flown.complete and list(verify_campaign(flown.folder)) == []
    results = read_flown(flown.folder)
    tlc, lqr = (results.flights[law].failed.sum() for law in ("tlc_robust", "lqr_robust"))
    assert (0 < tlc < lqr) if name == "wide" else (lqr == 0 < tlc)
    for law, channels in Models(results)[
        ENVELOPES
    ].ranges.items():  # of ticks: those of samples were much narrower
        worst = np.nanmax(results.flights[law].metrics["aileron_max_deg"])
        assert np.abs(channels["aileron_deg"]).max() == pytest.approx(worst, rel=1e-6)


def test_differences_name_their_place():
    written, remade = {"a": [1, {"b": 2}], "c": 1}, {"a": [1, {"b": 3}], "d": 1}
    assert [line.split(":")[0] for line in find_differences(written, remade, "x")] == [
        "x.a[1].b",
        "x.c",
        "x.d",
    ]


REQUIREMENTS = (
    "[{id: GNC-1, text: 'stay, near', source: SRD, metric: altitude_error_max_m, below: 50, "
    "probability: 0.5},"
    " {id: GNC-2, metric: altitude_error_max_m, below: 4.9, probability: 0.99, controllers: "
    "[one, two]},"
    " {metric: altitude_error_rms_m, below: 50, probability: 95 %}]"
)


def test_a_run_writes_junit_and_the_report_its_matrix(tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
    path = write_fake(tmp_path / "f", requirements=REQUIREMENTS)
    out, junit = tmp_path / "out", tmp_path / "verdicts.xml"
    done = invoke(f"run {path} -o {out} --no-report --junit {junit}")
    assert done.exit_code == 1, done.output
    suite = ElementTree.parse(junit).getroot()
    cases = {case.get("name"): case for case in suite.iter("testcase")}
    assert len(cases) == 4 == int(suite.get("tests"))
    for count, kind in (("failures", "failure"), ("skipped", "skipped")):
        assert int(suite.get(count)) == len(list(suite.iter(kind))) > 0
    assert cases["GNC-1 altitude_error_max_m below 50 in 50 % (one)"].find("failure") is None
    assert cases["GNC-2 altitude_error_max_m below 4.9 in 99 % (two)"].find("failure") is not None
    page = build_page(out).read_text("utf-8")
    assert ">GNC-1 " in page and "stay, near · SRD" in page
    CampaignFolder(out).refuse_foreign_files(fresh=True)  # a fresh run deletes all of it
    with (out / "verification_matrix.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6  # three requirements on two controllers
    first = {"id": "GNC-1", "text": "stay, near", "unit": "m", "verdict": "PASS", "binding": "yes"}
    assert rows[0].items() >= first.items()
    assert rows[1]["binding"] == "no" and rows[3]["verdict"] == "FAIL"
