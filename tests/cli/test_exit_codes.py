"""Exit codes of the commands that judge."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_flight import run, write_campaign

from abhv_mc.analysis.replay import Replay
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.report.numbers.compare import Compared
from abhv_mc.topics.topic import Section

pytestmark = pytest.mark.usefixtures("fake_engine", "no_figures")
ENTRY = {"metric": "altitude_error_max_m", "probability": 0.9, "consumer_risk": 0.1}
MET, MISSED_BY_TWO = {**ENTRY, "below": 50}, {**ENTRY, "below": 3}


@pytest.mark.parametrize(
    ("tested", "own", "bound"),
    [
        ("[one]", {}, ["one"]),
        ("[two]", {}, ["two"]),
        ("", {}, ["one", "two"]),
        ("[one]", {"controllers": ["two"]}, ["two"]),
        ("[two]", {"controllers": ["one"]}, ["one"]),
    ],
)
def test_the_exit_code_is_that_of_the_controllers_under_test(abhv_mc, tmp_path, tested, own, bound):
    """The controller 'two' misses one of two requirements."""
    requirements = [{**entry, **own} for entry in (MET, MISSED_BY_TWO)]
    keys = {"under_test": tested, "requirements": json.dumps(requirements), "runs": "150"}
    campaign, out = write_campaign(tmp_path / "f", **keys), tmp_path / "out"
    code, text, _ = abhv_mc(
        "run", campaign, "-o", out, "--no-report", "--junit", tmp_path / "j.xml"
    )
    assert code == int("two" in bound) and f"exit code {code}" in text
    cases = re.findall(r"<testcase .*\((\w+)\)", (tmp_path / "j.xml").read_text())
    assert sorted(set(cases)) == bound and ("<failure" in (tmp_path / "j.xml").read_text()) == code
    assert f"of {', '.join(bound)}, version" in " ".join(abhv_mc("runs", tmp_path)[1].split())
    assert abhv_mc("report", out)[0] == 0
    (tmp_path / "r.yaml").write_text(json.dumps({"requirements": requirements}))
    judged = ("report", out, "-o", tmp_path / "o", "--requirements")
    assert abhv_mc(*judged, tmp_path / "r.yaml")[0] == code
    (tmp_path / "r.yaml").write_text(json.dumps({"requirements": requirements[:1]}))
    assert abhv_mc(*judged, tmp_path / "r.yaml")[0] == 0


def test_commands_for_one_controller_ask_which_of_several(abhv_mc, tmp_path):
    campaign, out = write_campaign(tmp_path / "f", under_test="", runs="60"), tmp_path / "out"
    assert abhv_mc("run", campaign, "-o", out, "--no-report")[0] == 0
    (tmp_path / "t.csv").write_text("altitude_error_max_m\n1\n")
    for command in (
        ("replay", out, "--flight", 1),
        ("explain", out, "--flight", 1),
        ("compare", tmp_path / "t.csv", out),
        ("worst", campaign, "--metric", "altitude_error_max_m", "-o", tmp_path / "w"),
        ("rare", campaign, "--requirement", "altitude_error_max_m", "-o", tmp_path / "r"),
        ("tune", campaign, "-o", tmp_path / "t.yaml"),
    ):
        code, _, err = abhv_mc(*command)
        assert code == 2 and "--controller" in err and "'one' and 'two'" in err, command
    assert abhv_mc("replay", out, "--flight", 1, "--controller", "two")[0] == 0


@pytest.mark.parametrize(
    ("gates", "options", "code"),
    [
        ("y yy", "", 0),
        ("y yn", "", 1),
        ("y y", "--fail-if-loses 2", 0),
        ("y y y", "--fail-if-loses 2", 1),
    ],
)
def test_each_gate_of_each_pair_must_be_shown(abhv_mc, tmp_path, monkeypatch, gates, options, code):
    """Pair k has newly lost k flights."""
    pairs = [
        SimpleNamespace(
            controllers=("a", "b"),
            newly_lost=k,
            not_worse={i: SimpleNamespace(shown=gate == "y") for i, gate in enumerate(text)},
        )
        for k, text in enumerate(gates.split())
    ]
    found = SimpleNamespace(found=Compared((), {}, tuple(pairs)), section=Section("s", ()), page="")
    monkeypatch.setattr("abhv_mc.report.pages.compare_page.compare_folders", lambda *_: found)
    ended, out, _ = abhv_mc("compare", tmp_path, tmp_path, *options.split())
    assert ended == code and out.count("a -> b: 1") == bool(options)


@pytest.mark.parametrize(
    ("statuses", "code"), [("FAIL FAIL PASS -", 0), ("PASS", 0), ("FAIL - FAIL", 1)]
)
def test_tighten_needs_one_confirmed_width(abhv_mc, tmp_path, monkeypatch, statuses, code):
    """The first verdict is that of the campaign; a bar stands for no width."""
    first, *others = (
        SimpleNamespace(status=status, failures=1, flights=9) if status != "-" else None
        for status in statuses.split()
    )
    numbers = dict.fromkeys(("reweighted", "width"), 0.5)
    own = [SimpleNamespace(name="lift", **numbers, entry=None, verdict=x) for x in others]
    found = SimpleNamespace(controller="a", verdict=first, dispersions=own, folder="")
    monkeypatch.setattr("abhv_mc.search.tighten.tighten", lambda *_, **__: found)
    ended, out, _ = abhv_mc("tighten", tmp_path)
    assert ended == code and out.count("no PASS at any width") == statuses.count("-")
    assert "folder " not in out
    found.folder = "results"
    assert "folder    results" in abhv_mc("tighten", tmp_path)[1]


@pytest.mark.parametrize(
    ("search", "code"),
    [("worst 0", 0), ("worst 1", 3), ("rare 0", 0), ("rare 0 no", 1), ("rare 1 no", 3)],
)
def test_searches_are_incomplete_before_they_fail(abhv_mc, tmp_path, monkeypatch, search, code):
    """The second word is the number of flights that failed to run, the third a refusal."""
    command, failed, *refusal = search.split()
    estimate = SimpleNamespace(refusal=refusal[0] if refusal else None)
    found = SimpleNamespace(numbers=dict, failed_to_run=int(failed), estimate=estimate)
    folders, page = [], SimpleNamespace(section=Section("s", ()))
    monkeypatch.setattr(
        f"abhv_mc.api.{command}", lambda **request: folders.append(request["output"]) or found
    )
    answer = f"abhv_mc.report.pages.search_pages.make_{command}_answer"
    monkeypatch.setattr(answer, lambda *_: page)
    asked = {"worst": "--metric", "rare": "--requirement"}[command]
    campaign = write_campaign(tmp_path / "study.v2")
    assert abhv_mc(command, campaign, asked, "altitude_error_max_m")[0] == code
    assert folders == [Path(f"reports/campaign_{command}_altitude_error_max_m")]


@pytest.mark.parametrize(
    ("difference", "repeatable", "code"),
    [
        ("", None, 0),
        ("x", None, 1),
        ("x", Repeatability.DECLARED, 0),
    ],
)
def test_a_replay_may_differ_only_with_declared_noise(
    abhv_mc, tmp_path, monkeypatch, difference, repeatable, code
):
    replay = Replay(
        "a", 1, SimpleNamespace(end_time=[2.0]), {}, {}, tuple(difference), "", "ok", (), repeatable
    )
    monkeypatch.setattr("abhv_mc.analysis.replay.replay_flight", lambda *_, **__: replay)
    chosen = SimpleNamespace(choose_controller=str)
    monkeypatch.setattr("abhv_mc.folder.inputs.read_folder_campaign", lambda _: chosen)
    assert abhv_mc("replay", tmp_path, "--flight", 1, "--controller", "a")[0] == code


def test_a_merge_prints_the_counts_of_all_seeds(abhv_mc, tmp_path):
    """The number of flights, the outcomes and the failures are sums over the merged folders."""
    campaign = write_campaign(tmp_path / "f", keep="{}")
    sizes = {1: 300, 2: 200}
    parts = [run(campaign, tmp_path / f"s{k}", seed=k, runs=n) for k, n in sizes.items()]
    _, out, _ = abhv_mc("run", campaign, "-o", tmp_path / "s2", "--seed", 2, "--runs", 200)
    label = parts[0].manifest.requirements[0].label
    assert f"'s1' (300 flights: 1 {label})" in out and f"merge {tmp_path}/s2 {tmp_path}/s1 " in out
    code, out, _ = abhv_mc("merge", *(part.folder for part in parts), "-o", "m", "--no-report")
    assert code == 0 and "complete, 500 of 500" in out
    for name in ("one", "two"):
        lost = sum(p.manifest.controllers[name].outcomes["sideslip_limit"] for p in parts)
        assert re.search(rf"(?m)^  {name} +{500 - lost} ok, {lost} sideslip_limit$", out)
    failures = sum(part.manifest.requirements[0].failures for part in parts)
    assert re.search(rf" PASS {failures} of 500\b", out)
