"""Commands that packages add by entry points, and packages that are broken or missing."""

import os
import subprocess
import sys
import tomllib

import pytest
from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.shipped import PACKAGES

GREETING = '''
def greet(name: str) -> None:
    """Say hello."""
    print(f"hello {name}")
'''


@pytest.fixture
def program(tmp_path):
    """Run the program beside two packages that add commands: one whose import fails, and one that greets."""
    for name, text, entries in (
        ("broken", "import no_such_module", "one = broken:one\ntwo = broken:two"),
        ("greeter", GREETING, "greet = greeter:greet\nverify.greet = greeter:greet"),
    ):
        (tmp_path / f"{name}.py").write_text(f"print('{name} is imported')\n{text}")
        information = tmp_path / f"{name}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        )
        (information / "entry_points.txt").write_text(f"[abhv_mc.commands]\n{entries}\n")
    searched = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])

    def run(*words):
        command = [sys.executable, "-m", "abhv_mc", *words]
        environment = os.environ | {"PYTHONPATH": searched, "COLUMNS": "100"}
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False, cwd=tmp_path
        )

    return run


def test_a_package_adds_commands_and_a_broken_one_costs_one_warning(program):
    told = program("--help")
    assert told.returncode == 0
    assert told.stderr.count("warning: ") == 1
    assert "broken" in told.stderr and "no_such_module" in told.stderr
    added = told.stdout.split(" Extensions ")[1]
    assert " greet " in added and "Say hello." in added and " one " not in added
    assert program("greet", "world").stdout.splitlines()[-1] == "hello world"
    in_a_group = program("verify", "greet", "all")
    assert in_a_group.stdout.splitlines()[-1] == "hello all"
    assert program("one").returncode == 2


@pytest.mark.parametrize("words", [("list", "schemas"), ("explore", "--help"), ("verify", "nesc")])
def test_a_command_imports_no_package_but_its_own(program, words):
    assert "is imported" not in program(*words).stdout


def test_the_version_says_which_package_is_missing(monkeypatch):
    monkeypatch.setattr("abhv_mc.cli.app.PACKAGES", (*PACKAGES, "abhv_mc_absent"))
    told = CliRunner().invoke(app, ["--version"]).stdout
    assert "abhv_mc_absent is missing" in told and told.count("missing") == 1


def test_every_package_is_built_typed_and_checked(repository):
    settings = tomllib.loads((repository / "pyproject.toml").read_text())["tool"]
    built = settings["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert built == [f"src/{name}" for name in PACKAGES]
    assert settings["importlinter"]["root_packages"] == list(PACKAGES)
    found = sorted(path.parent.name for path in repository.glob("src/*/py.typed"))
    assert found == list(PACKAGES)
    assert found == sorted(path.parent.name for path in repository.glob("src/*/__init__.py"))
