"""Installation of the package as a wheel in a separate environment, away from the checkout."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest


def install(source, folder):
    """Install a source's wheel in a new environment with the tests' libraries; return its bin."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--no-deps",
        "--no-index",
        str(wheel),
    ]
    subprocess.run(pip, check=True, capture_output=True)
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    libraries = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    # A path in a .pth file is not searched for other .pth files: the checkout's editable
    # installation stays out.
    (site / "libraries.pth").write_text("\n".join(sorted(libraries)))
    return python.parent


@pytest.fixture(scope="module")
def installed(repository, tmp_path_factory):
    return install(repository, tmp_path_factory.mktemp("wheel"))


def test_a_package_index_would_accept_the_metadata(installed):
    (wheel,) = installed.parents[1].glob("*.whl")
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", str(wheel)], check=True)


def test_the_extra_kernels_has_the_locked_compilers(repository):
    """`make dist` compiles the wheel's kernels with the versions of the extra."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    locked = (repository / "requirements.lock").read_text().split()
    assert set(project["optional-dependencies"]["kernels"]) < set(locked)


def test_every_shipped_file_comes_with_it(installed, repository):
    (names,) = installed.parent.glob("lib/python*/site-packages/abhv_mc/shipped_files")
    files = [
        path
        for name in ("configs", "campaigns")
        for path in (repository / name).rglob("*")
        if path.is_file()
    ]
    assert files
    for path in files:
        assert (names / path.relative_to(repository)).read_bytes() == path.read_bytes()


def test_a_new_user_flies_a_campaign(installed, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cache")}

    def abhv_mc(*arguments, folder=tmp_path):
        command = [installed / "abhv-mc", *arguments]
        return subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )

    where = "import abhv_mc; print(abhv_mc.__file__)"
    python = [installed / "python", "-c", where]
    imported = subprocess.run(
        python, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert installed.parent in Path(imported.stdout).parents

    assert "missing" not in abhv_mc("--version").stdout
    for command in (("explore",), ("import", "daveml"), ("import", "jsbsim"), ("tune",)):
        assert abhv_mc(*command, "--help").returncode == 0, command

    assert abhv_mc("new", "demo").returncode == 0
    first = abhv_mc("run", "campaign.yaml", "--runs", "32", folder=tmp_path / "demo")
    assert first.returncode == 0, first.stderr
    assert "compiling" in first.stderr
    (output,) = [line for line in first.stdout.splitlines() if line.startswith("report ")]
    report = tmp_path / "demo" / output.split()[-1]
    assert report.name == "report.html" and report.stat().st_size > 100_000
    manifest = json.loads((report.parent / "manifest.json").read_text())
    assert manifest["state"] == "complete" and manifest["runs_done"] == 32
    assert "commit" not in manifest

    again = abhv_mc(
        "run", "campaign.yaml", "--runs", "32", "--fresh", "--no-report", folder=tmp_path / "demo"
    )
    assert again.returncode == 0, again.stderr
    assert "compiling" not in again.stderr
    assert json.loads((report.parent / "manifest.json").read_text())["digest"] == manifest["digest"]


def test_kernels_that_come_with_it_are_used_and_give_the_same_bits(repository, tmp_path):
    source = tmp_path / "source"
    leave = shutil.ignore_patterns(".*", "docs", "reports", "studies", "tests", "__pycache__")
    shutil.copytree(repository, source, ignore=leave)
    prebuild = [sys.executable, str(repository / ".ci/prebuild.py"), str(source)]
    subprocess.run(prebuild, check=True, capture_output=True)
    if not list((source / "src/abhv_mc_vehicle/prebuilt").glob("*.zip")):
        pytest.skip("no level of x86-64 that kernels travel for")
    (tmp_path / "wheel").mkdir()
    bin_folder = install(source, tmp_path / "wheel")
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    fresh = environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    campaign = str(repository / "campaigns/s_manoeuvre.yaml")
    digests = []
    for python, variables in ((bin_folder / "python", fresh), (sys.executable, environment)):
        out = tmp_path / f"flown{len(digests)}"
        command = [
            python,
            "-m",
            "abhv_mc",
            "run",
            campaign,
            "--runs",
            "64",
            "-o",
            out,
            "--no-report",
        ]
        done = subprocess.run(
            command, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False
        )
        assert done.returncode in {0, 1}, done.stderr
        assert digests or "compiling" not in done.stderr
        digests.append(json.loads((out / "manifest.json").read_text())["digest"])
    assert len(set(digests)) == 1
