"""Commands that packages add by entry points, and packages that are broken or missing."""

import configparser
import os
import tomllib

import pytest
from programs import invoke, run_python

from abhv_mc.shipped import PACKAGES

GREETING = '''
def greet(name: str) -> None:
    """Say hello."""
    print(f"hello {name}")
'''
GREETED = ("greet", "verify.greet", "verify.run")


@pytest.fixture
def program(tmp_path):
    """Return a function that runs the program with a working and a broken package installed."""
    for name, text, entries in (
        ("broken", "import no_such_module", "one = broken:one\ntwo = broken:two"),
        ("greeter", GREETING, "".join(f"{name} = greeter:greet\n" for name in GREETED)),
    ):
        (tmp_path / f"{name}.py").write_text(f"print('{name} is imported')\n{text}")
        information = tmp_path / f"{name}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        )
        (information / "entry_points.txt").write_text(f"[abhv_mc.commands]\n{entries}\n")
    searched = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])

    def run(*arguments):
        environment = os.environ | {"PYTHONPATH": searched, "COLUMNS": "100"}
        return run_python("-m", "abhv_mc", *arguments, env=environment, cwd=tmp_path)

    return run


def test_a_package_adds_commands_and_a_broken_one_causes_one_warning(program):
    help_text = program("--help")
    assert help_text.returncode == 0
    assert help_text.stderr.count("warning: ") == 1
    assert "broken" in help_text.stderr and "no_such_module" in help_text.stderr
    added = help_text.stdout.split(" Extensions ")[1]
    assert " greet " in added and "Say hello." in added and " one " not in added
    assert program("greet", "world").stdout.splitlines()[-1] == "hello world"
    in_a_group = program("verify", "greet", "all")
    assert in_a_group.stdout.splitlines()[-1] == "hello all"
    assert program("one").returncode == 2
    # A command in a group has no examples of the program's command with the same name.
    assert program("run", "--help").stdout.count("abhv-mc run ") >= 3
    assert "abhv-mc run " not in program("verify", "run", "--help").stdout


@pytest.mark.parametrize(
    "arguments", [("list", "schemas"), ("explore", "--help"), ("trim", "--help")]
)
def test_a_command_imports_only_its_own_package(program, arguments):
    assert "is imported" not in program(*arguments).stdout


def test_the_version_says_which_package_is_missing(monkeypatch):
    monkeypatch.setattr("abhv_mc.cli.app.PACKAGES", (*PACKAGES, "abhv_mc_absent"))
    output = invoke("--version").stdout
    (line,) = [line for line in output.splitlines() if "not installed" in line]
    assert "abhv_mc_absent" in line


def test_every_package_is_built_typed_and_checked(repository):
    settings = tomllib.loads((repository / "pyproject.toml").read_text())["tool"]
    built = settings["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert built == [f"src/{name}" for name in PACKAGES]
    contracts = configparser.ConfigParser()
    contracts.read(repository / ".importlinter")
    assert contracts["importlinter"]["root_packages"].split() == list(PACKAGES)
    typed = sorted(path.parent.name for path in repository.glob("src/*/py.typed"))
    assert typed == list(PACKAGES)
    assert typed == sorted(path.parent.name for path in repository.glob("src/*/__init__.py"))


def test_commands_load_where_another_package_replaces_the_entry_points():
    pytest.importorskip("importlib_metadata")  # returns entry points of a class of its own
    code = "import importlib_metadata; from abhv_mc.cli.app import main; main()"
    assert "--controllers" in run_python("-c", code, "fly", "--help", check=True).stdout
