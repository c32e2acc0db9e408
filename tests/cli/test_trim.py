import json

import pytest
import typer
from typer.testing import CliRunner

from abhv_mc.cli.trim import command

app = typer.Typer()
app.command()(command)


@pytest.fixture
def run(repository):
    def run(name, *options):
        return CliRunner().invoke(app, [str(repository / f"configs/vehicle/{name}.yaml"), *options])

    return run


def test_json_in_degrees(run):
    result = run("ghame", "--altitude", "20km", "--speed", "1400", "--bank", "0,50 deg", "--json", "-")
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert (found["altitude_m"], found["speed_mps"], found["mass_kg"]) == (20e3, 1400.0, 95254.0)
    level, banked = found["points"]
    assert level["angle_of_attack_deg"] == pytest.approx(3.59, abs=0.005)
    assert (banked["bank_deg"], banked["trimmed"]) == (pytest.approx(50.0), True)
    assert banked["elevator_deg"] == pytest.approx(-5.49, abs=0.005)


def test_table_and_exit_code_of_a_point_without_trim(run):
    result = run("ghame_x", "--bank=0,89", "--mass", "1.3 t")
    assert result.exit_code == 1
    assert "ghame_x: 20 km, 1400 m/s, Mach 4.745" in result.stdout
    assert "no trim at 89 deg of bank" in result.stdout and "no trim at 0 deg" not in result.stdout


def test_refuses_a_vehicle_that_cannot_be_trimmed(run):
    assert "without surfaces" in str(run("nesc/sphere").exception)
