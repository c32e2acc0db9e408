"""Creation and verification of reports, and verdicts as JUnit XML and CSV."""

import csv
import json
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from fake_flight import ENGINE
from fake_flight import write_campaign as write_fake
from programs import invoke
from report.synthetic import build_page, write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.cli.running import finish
from abhv_mc.execution.runner import RunResult, run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import ControllerCount, Manifest
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.build import (
    build_report,
    hash_files,
    hash_pages,
    is_up_to_date,
    refuse_search,
)
from abhv_mc.report.pages.matrix import judged_cases, make_junit, make_matrix, make_metrics
from abhv_mc.report.pages.verify import (
    _find_changed,
    find_differences,
    skipped_topics,
    verify_campaign,
)
from abhv_mc.requests import Request
from abhv_mc.shipped import shipped_campaigns
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.metrics import METRICS
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS


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
    assert " ../../copy" in page.read_text("utf-8")  # commands hold at the page
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


WORST = {"kind": "worst", "metric": "m", "box": 3.0, "bad": "high", "controller": "c x",
         "flights": 400}  # fmt: skip
RARE = {"kind": "rare", "requirement": "m < 1", "target_cov": 0.25, "controller": "c",
        "flights": 500}  # fmt: skip


@pytest.mark.parametrize(
    ("search", "name", "options"),
    [
        (WORST, "c x", ["--metric", "m", "--box", "3", "--above", "--flights", "400"]),
        ({**WORST, "bad": "low"}, "c x",
         ["--metric", "m", "--box", "3", "--below", "--flights", "400"]),
        ({**WORST, "bad": None, "box": 2.5}, "c x",
         ["--metric", "m", "--box", "2.5", "--flights", "400"]),
        (RARE, "c", ["--requirement", "m < 1", "--target-cov", "0.25", "--flights", "500"]),
    ],
)  # fmt: skip
def test_the_folder_of_a_search_names_the_command_that_makes_its_page(search, name, options):
    with pytest.raises(InputError) as raised:
        refuse_search(Path("a b"), SimpleNamespace(search=search))
    start = ["abhv-mc", search["kind"], "a b/campaign.yaml", "--controller", name]
    assert f"`{shlex.join([*start, *options, '-o', 'a b'])}`" in str(raised.value)
    refuse_search(Path("a"), SimpleNamespace(search=None))


def test_inputs_are_hashed_by_file_and_flights_by_controller(failing_folder):
    hashes = hash_files(failing_folder)
    flights = {name: text for name, text in hashes.items() if name.startswith("flights/")}
    assert flights.keys() == {f"flights/{name}" for name in ("tlc", "lqr", "lqr_retuned")}
    assert len(set(flights.values())) == 3 and "campaign.yaml" in hashes
    stored = read_flown(failing_folder).manifest.files
    assert all(stored[name] == hashes[name] for name in hashes.keys() - flights.keys())


def test_the_matrix_has_the_counts_of_each_requirement_and_controller(failing):
    verdicts = Models(failing)[VERDICTS]
    rows = list(csv.DictReader(make_matrix(verdicts, failing.campaign.metrics).splitlines()))
    expected = [
        (entry, name, verdict)
        for entry in verdicts.requirements
        for name, verdict in entry.controllers.items()
    ]
    for row, (entry, name, verdict) in zip(rows, expected, strict=True):
        item, flights = entry.asked, failing.flights[name]
        failed = ~(flights.metrics[item.metric] < item.limits.high) | flights.failed
        assert (row["metric"], row["controller"]) == (item.metric, name)
        assert (row["above"], float(row["below"])) == ("", item.limits.high)
        assert (int(row["failures"]), int(row["flights"])) == (failed.sum(), 100)
        binding = "yes" if name in item.controllers else "no"
        assert (row["verdict"], row["binding"]) == (verdict.status, binding)
        assert float(row["probability"]) == 0.9973 and float(row["consumer_risk"]) == 0.1
        assert row["unit"] == failing.campaign.metrics[item.metric].unit
    assert len({row["verdict"] for row in rows}) > 1


def test_the_table_of_metrics_has_quantiles_and_worst_flights(failing):
    rows = list(csv.DictReader(make_metrics(Models(failing)[METRICS]).splitlines()))
    assert len(rows) == 3 * len({row["metric"] for row in rows})
    for row in rows:
        if row["metric"] not in ("speed_error_max_mps", "sideslip_max_deg"):
            continue
        flights = failing.flights[row["controller"]]
        values = np.where(flights.failed, np.inf, flights.metrics[row["metric"]])
        assert float(row["q50_value"]) == pytest.approx(np.median(values), rel=0.02)
        assert float(row["q50_low"]) < float(row["q50_value"]) < float(row["q50_high"])
        completed = np.where(flights.failed, -np.inf, flights.metrics[row["metric"]])
        assert float(row["worst"]) == pytest.approx(completed.max())
        assert int(row["worst_flight"]) == flights.flight[completed.argmax()]
        assert row["unit"] == failing.campaign.metrics[row["metric"]].unit
    assert make_metrics(SimpleNamespace(table={})).strip() == ""


def test_a_report_of_another_version_is_said_to_be_one_once(copy):
    path = copy / "report.json"
    numbers = {**json.loads(path.read_text("utf-8")), "code": "0" * 64}
    path.write_text(json.dumps(numbers), "utf-8")
    assert list(verify_campaign(copy)) == []
    numbers["verdicts"]["requirements"][0]["controllers"]["lqr"]["failures"] += 1
    numbers["verdicts"]["requirements"][0]["controllers"]["tlc"]["failures"] += 1
    path.write_text(json.dumps(numbers), "utf-8")
    (line,) = verify_campaign(copy)
    assert "another version" in line


def test_differences_of_lists_are_told_by_length_or_entry():
    assert list(find_differences({"a": [1, 2], "b": "x" * 90}, {"a": [1], "b": "y"})) == [
        "a: [1, 2] in the report, but [1] in the data",
        f'b: "{"x" * 76}... in the report, but "y" in the data',
    ]
    assert list(find_differences([[1], 2], [[3], 2], "k", "x")) == [
        "k[0][0]: 1 in x, but 3 in the data"]  # fmt: skip
    assert not list(find_differences({"a": [1, {"b": None}]}, {"a": [1, {"b": None}]}))


def test_changed_and_missing_files_are_told_apart():
    written, current = {"b": "1", "a": "1", "d": "1"}, {"b": "2", "c": "3", "d": "1", "a": None}
    lines = list(_find_changed(written, current))
    assert [line.partition(": ")[0] for line in lines] == ["a", "b", "c"]
    assert ["missing" in line for line in lines] == [True, False, False]


def test_topics_that_are_not_installed_are_skipped(tmp_path):
    assert skipped_topics(tmp_path) == []
    (tmp_path / "report.json").write_text('{"topics": {"y": 1, "x": 2}}', "utf-8")
    assert skipped_topics(tmp_path) == ["x", "y"]


def test_junit_counts_failures_and_skips_what_is_undecided():
    traced, plain = (
        SimpleNamespace(
            asked=SimpleNamespace(
                metric="m", limits=Bounds(high=50.0), probability=0.95, traced=entries
            )
        )
        for entries in ({"id": "R-1"}, {})
    )
    verdicts = {k: SimpleNamespace(status=k, words=f"said {k}") for k in ("PASS", "FAIL", "OPEN")}
    binding = [(traced, "a", verdicts["PASS"]), (plain, "b", None), (plain, "c", verdicts["FAIL"])]
    binding += [(plain, "d", verdicts["FAIL"]), (plain, "e", verdicts["OPEN"])]
    cases = judged_cases(SimpleNamespace(binding=binding))
    names = ["R-1 m below 50 in 95 % (a)", *(f"m below 50 in 95 % ({name})" for name in "cde")]
    assert [(case.name, case.status, case.words) for case in cases] == [
        (name, status, f"said {status}")
        for name, status in zip(names, ("PASS", "FAIL", "FAIL", "OPEN"), strict=True)
    ]
    root = ElementTree.fromstring(make_junit("suite", cases))
    (suite,) = root
    facts = {"name": "suite", "tests": "4", "failures": "2", "errors": "0", "skipped": "1"}
    assert root.attrib == suite.attrib == facts
    found = [(case.get("name"), *((item.tag, item.text or item.get("message")) for item in case))
             for case in suite]  # fmt: skip
    kinds = ("system-out", "failure", "failure", "skipped")
    assert found == [
        (name, (kind, case.words)) for name, kind, case in zip(names, kinds, cases, strict=True)
    ]
