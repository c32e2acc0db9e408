"""List of the campaigns below a folder, in the terminal and as a page."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from types import SimpleNamespace

import pytest
from programs import invoke
from report.synthetic import write_campaign

from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.folder.stores import LocalStore
from abhv_mc.report.numbers.runs import CampaignRun, CampaignRuns, find_runs
from abhv_mc.report.pages import runs_page
from abhv_mc.report.pages.build import build_report


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """Write three campaigns, a damaged folder, another program's manifest, and a comparison."""
    root = tmp_path_factory.mktemp("runs") / "reports"
    first = write_campaign(root / "first", runs=12)
    other = write_campaign(root / "deeper/other's one", runs=40, seed=7)
    write_campaign(root / "third", runs=12)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("abhv_mc.topics.registry.make_figures", lambda models: {})
        build_report(first)
    for name, text in (("damaged", '{"format": 4,'), ("strange", '{"manifest_version": 3}')):
        (root / name).mkdir()
        (root / name / "manifest.json").write_text(text, encoding="utf-8")
    assert invoke("compare", first, other, "-o", root / "compared").exit_code == 0
    return root


def test_every_campaign_is_found_and_a_damaged_one_says_why(reports):
    campaigns = find_runs(reports, LocalStore(reports))
    by_folder = {campaign.folder: campaign for campaign in campaigns.runs}
    assert set(by_folder) == {"first", "deeper/other's one", "third", "damaged"}
    assert "manifest" in by_folder["damaged"].problem
    first = by_folder["first"]
    report = json.loads((reports / "first/report.json").read_text("utf-8"))
    assert first.answer.startswith(report["summary"]["records"][0]["label"])
    assert first.question == report["provenance"]["question"]
    assert (first.flights, first.digest) == (12, report["digest"])
    assert sum(first.verdicts.values()) == sum(
        "tlc" in entry["controllers"] for entry in report["verdicts"]["requirements"]
    )
    assert by_folder["third"].answer == ""  # without a report
    other = by_folder["deeper/other's one"]
    pair = f"{first.digest} {other.digest}"
    assert campaigns.comparisons == {pair: "compared/report.html"}


def test_an_edited_report_is_not_printed(reports):
    report = reports / "first/report.json"
    text = report.read_text("utf-8")
    report.write_text(text.replace('"question": "', '"question": "All is well. '), "utf-8")
    runs = {entry.folder: entry for entry in find_runs(reports, LocalStore(reports)).runs}
    report.write_text(text, "utf-8")
    assert (runs["first"].answer, runs["first"].question) == ("", "")


def test_the_terminal_fits_80_columns(reports, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "80")
    output = invoke("runs", reports, "-o", tmp_path / "x.html").stdout
    assert max(map(len, output.splitlines()[:-1])) <= 80 and "damaged" in output
    own = read_manifest(reports / "first/manifest.json")
    facts = rf"first {own.started[:10]}, 12 flights, .*?, digest {own.digest[:12]} "
    assert re.search(facts, " ".join(output.split()))
    listed = json.loads(invoke("runs", reports, "--json", "-", "-o", tmp_path / "x.html").stdout)
    assert len(listed) == 4 and (tmp_path / "x.html").is_file()
    (tmp_path / "none").mkdir()
    assert invoke("runs", tmp_path / "none").stdout.split()[:2] == ["no", "campaigns"]
    assert not any((tmp_path / "none").iterdir())


def test_an_incomplete_campaign_is_listed_with_its_state(reports, tmp_path):
    path = shutil.copytree(reports / "third", tmp_path / "r/third") / "manifest.json"
    assert "12 flights," in invoke("runs", tmp_path / "r").stdout
    write_manifest(path, replace(read_manifest(path), state="interrupted"))
    output = invoke("runs", tmp_path / "r").stdout
    assert ", interrupted," in output and "12 flights" not in output


def test_the_latest_campaign_comes_first_and_other_folders_are_left_out(reports, tmp_path):
    root = tmp_path / "all"
    manifest = read_manifest(reports / "first/manifest.json")
    for folder, changes in (
        ("a", {"started": "2020-01-02T00:00:00"}),
        ("b", {"started": "2021-01-02T00:00:00", "state": "interrupted", "runs_planned": 20}),
        ("c", {"started": "2020-01-02T00:00:00", "commit": None}),
        ("search", {"search": {"kind": "rare"}}),
        (".hidden", {}),
        ("a/inner", {}),
    ):
        (root / folder).mkdir(parents=True)
        write_manifest(root / folder / "manifest.json", replace(manifest, **changes))
    (root / "a/report.html").write_text("", "utf-8")
    for name, text in (("pair", '{"digests": ["x", "y"]}'), ("odd", "{}")):
        (root / name).mkdir()
        (root / name / "report.html").write_text("", "utf-8")
        (root / name / "comparison.json").write_text(text, "utf-8")
    (root / "page only").mkdir()
    (root / "page only/report.html").write_text("", "utf-8")
    found = find_runs(root, LocalStore(root))
    assert [run.folder for run in found.runs] == ["b", "c", "a"]
    assert found.comparisons == {"x y": "pair/report.html"}
    first, second, third = found.runs
    assert (first.flights, first.flights_planned, first.state) == (12, 20, "interrupted")
    assert (second.commit, third.commit) == ("", manifest.commit or "")
    assert [run.has_page for run in found.runs] == [False, False, True]
    assert (third.version, third.digest) == (manifest.versions["abhv_mc"], manifest.digest)
    assert third.controllers == tuple(dict.fromkeys(x.controller for x in manifest.requirements))


def test_the_page_has_a_row_with_link_and_counts_for_each_campaign(tmp_path, monkeypatch):
    calls = []
    template = SimpleNamespace(render=lambda **entries: calls.append(entries) or "")
    monkeypatch.setattr(
        runs_page, "make_environment", lambda: SimpleNamespace(get_template=lambda _: template)
    )
    done = {"flights": 12000, "flights_planned": 12000, "state": "complete", "has_page": True}
    runs = (
        CampaignRun(folder="a b", verdicts={"PASS": 3, "FAIL": 2}, controllers=("x", "y"), **done),
        CampaignRun(folder="c", flights=5, flights_planned=12, state="interrupted"),
    )
    campaigns = CampaignRuns(runs, {"p q": "d/report.html"})
    runs_page.write_runs_page(campaigns, tmp_path / "root", tmp_path / "pages/index.html")
    (entries,) = calls
    first, second = entries["rows"]
    assert (first["folder"], first["typed"]) == ("../root/a b", "'../root/a b'")
    assert (first["page"], second["page"]) == ("../root/a b/report.html", "")
    assert (first["verdicts"], second["verdicts"]) == ("3 PASS, 2 FAIL of x, y", "")
    assert re.sub(r"\s", "", first["flights"]) == "12000"
    assert second["flights"] == "5 of 12, interrupted"
    assert json.loads(entries["data"]) == {"p q": "../root/d/report.html"}
    assert entries["title"].endswith(" root")


@pytest.mark.thorough
def test_the_page_sorts_filters_and_names_the_comparison(reports, page):
    assert invoke("runs", reports).exit_code == 0
    page.call("Page.navigate", url=(reports / "index.html").as_uri())
    page.wait_for("document.getElementById('count')?.textContent.startsWith('4 of 4')")
    names = (
        "[...document.querySelectorAll('#runs tbody tr:not([hidden]) th')].map((e) => "
        "e.textContent)"
    )
    page.ask("document.querySelectorAll('#runs thead button')[0].click()")
    assert page.ask(names) == sorted(page.ask(names))
    page.ask(
        "{ const f = document.getElementById('filter'); f.value = 'damaged'; "
        "f.dispatchEvent(new Event('input')); }"
    )
    assert page.ask(names) == ["damaged"]
    for name in ("first", "deeper/other's one"):
        page.ask(f'document.querySelector(`input[data-name="{name}"]`).click()')
    command = shlex.split(page.ask("document.querySelector('#compare code').textContent"))
    assert command[:2] == ["abhv-mc", "compare"]
    assert {*command[2:4]} == {"first", "deeper/other's one"}
    assert page.ask("document.querySelector('#compare a').getAttribute('href')") == (
        "compared/report.html"
    )
    page.ask("document.querySelector('input[data-name=\"third\"]').click()")
    assert page.ask("document.querySelector('#compare code')") is None
