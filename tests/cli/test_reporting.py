"""Tests of the commands report, show, compare and verify campaign."""

import io
import json
import re
import shutil
from dataclasses import replace

import pytest
from programs import invoke
from report.synthetic import CONTROLLERS, write_campaign

from abhv_mc.cli.printing import say
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.contrast_page import (
    Contrast,
    ContrastController,
    ContrastRequirement,
    SideVerdict,
    change_texts,
    find_changes,
)
from abhv_mc.report.pages.pdf import NAMES
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.formatting import percent
from abhv_mc.topics.registry import BUILT_IN
from abhv_mc.topics.verdicts import VERDICTS


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("cli") / "c", runs=12)


@pytest.mark.usefixtures("no_figures")
def test_report_and_its_verification(folder):
    result = invoke("report", folder)
    assert result.exit_code == 0
    assert result.stdout.split() == [str(folder / "report.html")]
    assert invoke("verify", "campaign", folder).exit_code == 0
    verified = verify_changed(
        folder, lambda numbers: numbers["flights"]["counts"]["tlc"].update(flown=13)
    )
    assert re.fullmatch(r"flights\.counts\.tlc\.flown: 13\D+12\D+", verified)


def verify_changed(folder, change):
    """Return what the verification prints of a changed report."""
    path = folder / "report.json"
    numbers = json.loads(path.read_text(encoding="utf-8"))
    change(numbers)
    path.write_text(json.dumps(numbers), encoding="utf-8")
    verification = invoke("verify", "campaign", folder)
    assert verification.exit_code == 1
    return verification.stdout


@pytest.mark.usefixtures("no_figures")
def test_a_report_of_another_version_is_not_called_changed(folder):
    invoke("report", folder)

    def change(numbers):
        numbers["files"]["campaign.yaml"] = numbers["code"] = "0"

    text = verify_changed(folder, change)
    assert re.fullmatch(r"report\.json: written by another version\b.*\n", text)


def test_a_missing_chromium_is_reported_before_files_are_written(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    error = invoke("report", folder, "-o", tmp_path / "there", "--pdf").exception
    assert isinstance(error, InputError) and "chromium" in error.expected
    assert not (tmp_path / "there").exists()


@pytest.mark.thorough
@pytest.mark.skipif(not any(map(shutil.which, NAMES)), reason="no Chromium is installed")
def test_report_as_pdf(folder, tmp_path):
    result = invoke("report", folder, "-o", tmp_path / "there", "--pdf")
    assert result.stdout.split() == [
        str(tmp_path / "there" / f"report.{kind}") for kind in ("html", "pdf")
    ]
    assert (tmp_path / "there/report.pdf").read_bytes().startswith(b"%PDF")
    result = invoke("report", folder, "-o", tmp_path / "there", "--brief")
    assert result.stdout.split()[-1] == str(tmp_path / "there/brief.pdf")
    brief = (tmp_path / "there/brief.pdf").read_bytes()
    assert len(re.findall(rb"/Type\s*/Page[^s]", brief)) == 2


def test_verdicts_have_colours_only_on_a_terminal(monkeypatch):
    screen, pipe = io.StringIO(), io.StringIO()
    screen.isatty = lambda: True
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for file in (screen, pipe):
        say("1 FAIL \x1b[2J", file=file)
    assert screen.getvalue() == "1 \x1b[31mFAIL\x1b[0m \\x1b[2J\n"
    assert pipe.getvalue() == "1 FAIL \\x1b[2J\n"


def test_compare(folder, tmp_path):
    failing = write_campaign(tmp_path / "failing", runs=40, failing=4)
    crossed = invoke("compare", failing, failing, "--controllers", "tlc,lqr").stdout
    for text in ("Sideslip, max (deg)", "of 95 % quantiles", "Pairing gain", "abhv-mc replay"):
        assert text in crossed
    (line,) = [line for line in crossed.splitlines() if line.strip().startswith("Completed")]
    assert line.split()[3:8] == ["0", "0", "4", "36", "0.12"]
    assert len(json.loads(invoke("compare", folder, folder, "--json", "-").stdout)["paired"]) == 3


@pytest.mark.usefixtures("no_figures")
def test_a_report_by_other_requirements_needs_another_folder(folder, tmp_path):
    file, out, junit = tmp_path / "r.yaml", tmp_path / "page", tmp_path / "j.xml"
    requirement = "{metric: altitude_error_max_m, below: 1e-6, probability: 0.5}"
    file.write_text(f"requirements: [{requirement}]\n", encoding="utf-8")
    names = sorted(path.name for path in folder.iterdir())
    assert isinstance(invoke("report", folder, "--requirements", file).exception, InputError)
    result = invoke("report", folder, "--requirements", file, "-o", out, "--junit", junit)
    numbers = json.loads((out / "report.json").read_text(encoding="utf-8"))
    labels = [record["label"] for record in numbers["summary"]["records"]]
    assert "Misses" in labels and result.exit_code == 1
    assert "<failure" in junit.read_text("utf-8")
    assert sorted(path.name for path in folder.iterdir()) == names
    assert all(label in result.stdout for label in labels)
    assert (
        f"abhv-mc run CAMPAIGN.yaml -o {folder}" in result.stdout
    )  # no command judges by the folder's


def test_show_lists_every_topic_and_prints_tables_of_convergence(folder):
    help_text = " ".join(invoke("show", "--help").stdout.replace("│", " ").split())
    assert all(re.search(rf"\b{topic.name}\b", help_text) for topic in BUILT_IN)
    table = invoke("show", "convergence", folder).stdout
    assert "A quarter" in table and "All flights" in table and "LQR" in table


@pytest.mark.usefixtures("no_figures")
def test_verdicts_of_a_report_are_computed_once(folder, tmp_path):
    computed = []

    def compute(results):
        computed.append(results)
        return compute_verdicts(results)

    compute_verdicts = VERDICTS.compute
    object.__setattr__(VERDICTS, "compute", compute)
    try:
        result = invoke("report", folder, "-o", tmp_path / "r", "--junit", tmp_path / "j.xml")
    finally:
        object.__setattr__(VERDICTS, "compute", compute_verdicts)
    assert result.exit_code == 0 and len(computed) == 1
    assert "<testsuite" in (tmp_path / "j.xml").read_text("utf-8")


@pytest.mark.parametrize(
    ("before", "after", "shown", "label"),
    [
        (("PASS", 0), ("NOT SHOWN", 2), True, "PASS -> NOT SHOWN"),
        (("NOT SHOWN", 3), ("FAIL", 9), False, "NOT SHOWN -> FAIL"),
        (("FAIL", 30), ("FAIL", 60), True, "FAIL -> FAIL"),
        (("PASS", 0), ("PASS", 1), False, "Verdicts unchanged"),
    ],
)
def test_a_comparison_reports_changed_verdicts(before, after, shown, label):
    sides = [SideVerdict(*side, flights=100) for side in (before, after)]
    difference = (after[1] - before[1]) / 100
    width = abs(difference) / 2 if shown else 1.0
    interval = Interval(difference, difference - width, difference + width)
    item = ContrastRequirement("Error < 1 m", 0.9, *sides, share_difference=interval)
    contrasted = ContrastController(("a", "a"), (100, 100), (item,), {})
    ((head, text),) = change_texts(Contrast((), {}, (contrasted,)), ["A"])
    assert head == label
    if "->" in label:
        shares = " -> ".join(percent(side[1] / 100, 2) for side in (before, after))
        assert shares in text and ("(significant)" in text) == shown
    else:
        assert text == "A: 1 PASS of 1"


def test_files_that_differ_in_a_comment_are_equal(folder, tmp_path):
    folders = shutil.copytree(folder, tmp_path / "a"), shutil.copytree(folder, tmp_path / "b")
    for i, copy in enumerate(folders):
        files = {
            "inputs/vehicle/a.py": f"x = 1 # {i}",
            "inputs/vehicle/b.yaml": f"x: 1 # {i}",
            "inputs/vehicle/c.yaml": f"x: {i}",
        }
        manifest = read_manifest(copy / "manifest.json")
        (copy / "inputs/vehicle").mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (copy / name).write_text(text)
        hashes = dict.fromkeys(files, str(i))
        write_manifest(copy / "manifest.json", replace(manifest, inputs=hashes))
    changes = find_changes(*map(read_flown, folders))
    assert changes == ["inputs/vehicle/c.yaml: different content"]


def test_failures_of_one_controller_are_mapped(failing_folder, monkeypatch):
    """The first controller has no failures."""
    mapped = []

    def map_failures(folder, failed, **options):
        mapped.append({name: len(flights) for name, flights in failed.items()})
        raise InputError("x", "mapped", "")

    monkeypatch.setattr("abhv_mc.analysis.failure_map.map_failures", map_failures)
    first, *others = CONTROLLERS
    assert isinstance(invoke("explain", failing_folder, "--all").exception, InputError)
    assert [name for name, number in mapped[0].items() if number >= 12] == others
    assert mapped[0][first] == 0
    result = invoke("explain", failing_folder, "--all", "--controller", first)
    assert result.exit_code == 0 and len(mapped) == 1 and len(result.stdout.splitlines()) == 1


def test_show_prints_a_topic_and_verify_the_first_difference(folder, tmp_path, monkeypatch):
    numbers = json.loads(invoke("show", "verdicts", folder, "--json", "-").stdout)
    assert len(numbers["requirements"]) > 0
    assert len(invoke("show", "simulator", folder).stdout.splitlines()) == 1  # no results on it
    copy = shutil.copytree(folder, tmp_path / "copy")
    for path in copy.glob("report.*"):
        path.unlink()
    assert f"abhv-mc report {copy}" in invoke("verify", "campaign", copy).stdout
    path = copy / "manifest.json"
    write_manifest(path, replace(read_manifest(path), search={"kind": "worst"}))
    monkeypatch.setattr("abhv_mc.report.pages.build.search_command", lambda *_: "again")
    assert invoke("verify", "campaign", copy).stdout.split()[-1] == "again"
    found = iter(["first", "second"])
    monkeypatch.setattr("abhv_mc.report.pages.verify.verify_campaign", lambda _: found)
    result = invoke("verify", "campaign", copy)
    assert (result.exit_code, result.stdout) == (1, "first\n")
