"""What pipelines read of the verdicts."""

import csv
from xml.etree import ElementTree

from fake_flight import ENGINE, write_campaign
from report.few_figures import build_with
from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.report.pages.matrix import Case, make_junit

REQUIREMENTS = (
    "[{id: GNC-1, text: 'stay, near', source: SRD, metric: altitude_error_max_m, below: 50, probability: 0.5},"
    " {id: GNC-2, metric: altitude_error_max_m, below: 4.9, probability: 0.99, controllers: [one, two]},"
    " {metric: altitude_error_rms_m, below: 50, probability: 99.99 %}]"
)


def test_junit_counts_what_failed_and_what_was_not_shown():
    root = ElementTree.fromstring(
        make_junit("a & b", [Case("x", "PASS", "1 < 2"), Case("y", "FAIL", "no"), Case("z", "NOT SHOWN", "few")])
    )
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("3", "1", "1")
    failed, skipped = root.find(".//failure"), root.find(".//skipped")
    assert failed.get("message") == "no" and skipped.get("message") == "few"
    assert [case.get("name") for case in root.iter("testcase")] == ["x", "y", "z"]


def test_a_run_writes_junit_and_the_report_its_matrix(tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc.execution.runner.make_engine", lambda: ENGINE)
    path = write_campaign(tmp_path / "f", requirements=REQUIREMENTS)
    out, junit = tmp_path / "out", tmp_path / "verdicts.xml"
    done = CliRunner().invoke(app, ["run", str(path), "-o", str(out), "--no-report", "--junit", str(junit)])
    assert done.exit_code == 1, done.output
    cases = {case.get("name"): case for case in ElementTree.parse(junit).iter("testcase")}
    assert len(cases) == 4
    assert cases["GNC-1 altitude_error_max_m below 50 in 50 % (one)"].find("failure") is None
    assert cases["GNC-2 altitude_error_max_m below 4.9 in 99 % (two)"].find("failure") is not None
    page = build_with(out).read_text(encoding="utf-8")
    assert ">GNC-1 " in page and "stay, near · SRD" in page
    assert CampaignFolder(out).unknown_files() == []  # a fresh run deletes all of it
    with (out / "verification_matrix.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6  # three requirements on two controllers
    assert (rows[0]["id"], rows[0]["text"], rows[0]["verdict"], rows[0]["binding"]) == (
        "GNC-1",
        "stay, near",
        "PASS",
        "yes",
    )
    assert rows[1]["binding"] == "no" and rows[3]["verdict"] == "FAIL" and rows[0]["unit"] == "m"
