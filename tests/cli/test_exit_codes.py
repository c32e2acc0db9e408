"""Exit codes of the commands that judge."""

import json
import re

import pytest
from fake_flight import write_campaign

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
