"""abhv-mc verify as a user calls it: tables, JSON, exit codes."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from abhv_mc.cli.verify import app

FIELDS = ["case", "simulator", "quantity", "unit", "difference", "tolerance", "ok"]


@pytest.fixture(scope="module")
def references(repository):
    return repository / "tests" / "reference"


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_check_cases_and_their_json(references, tmp_path):
    shutil.copytree(references / "nesc" / "Atmos_09_EastwardCannonball", tmp_path / "Atmos_09_EastwardCannonball")
    result = run("nesc", tmp_path, "--json", tmp_path / "new/rows.json")
    assert result.exit_code == 0
    assert "12 differences, 0 outside" in result.stdout
    written = json.loads((tmp_path / "new/rows.json").read_text())
    assert written["ok"] is True
    assert [list(row) for row in written["rows"]] == [FIELDS] * 12
    assert {row["case"] for row in written["rows"]} == {"nesc 09"}


def test_a_tolerance_that_is_missed_exits_1(references, tmp_path):
    file = references / "cadac-ghame6" / "sturn50_total_h1e-4.csv.gz"
    assert run("ghame6", file).exit_code == 0
    result = run("ghame6", file, "--tolerance-scale", "0.01", "--json", tmp_path / "rows.json")
    assert result.exit_code == 1
    assert "OUTSIDE" in result.stdout
    written = json.loads((tmp_path / "rows.json").read_text())
    assert written["ok"] is False
    assert written["rows"][0]["tolerance"] == pytest.approx(0.0009)
