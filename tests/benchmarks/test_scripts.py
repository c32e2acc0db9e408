"""Tests that every script of studies and benchmarks that a page names runs with little work."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from programs import run_python

ROOT = Path(__file__).parents[2]
STUDIES = (
    "example",
    "fronts",
    "fronts_results",
    "paper",
    "retune_lqr",
    "robust lqr",
    "thrust_line",
    "tune_tlc",
)
BENCHMARKS = (
    *(
        "advised_flights",
        "comparison",
        "driver_intervals",
        "gate",
        "growth",
        "interval_coverage",
        "limit",
        "margins",
        "operations",
        "parent",
        "parts",
        "placement",
    ),
    *(
        "rare_against_plain",
        "rare_coverage",
        "stepping",
        "storage",
        "trim_time",
        "unknowns",
        "user_law",
        "verdict_errors",
    ),
    *(f"versions {ROOT}", "worst_seeds", "table_checks", "others.fair_fight", "others.sensitivity"),
)
# These need other programs or the network, run completely in other tests or in
# `make test-thorough`, or belong to another script.
OTHERS = {
    "benchmarks.watch": "runs whole in make test-thorough",
    "benchmarks.bench": "limit runs it",
    "benchmarks.others.page": "test_others.py",
    "benchmarks.others.rocketpy_table": "test_others.py",
    "benchmarks.others.rocketpy_monte_carlo": "needs RocketPy",
    "benchmarks.others.reliability": "downloads otbenchmark",
    "benchmarks.others.surrogate": "downloads otbenchmark",
    "benchmarks.others.gcas_search": "needs AeroBenchVVPython",
    "benchmarks.others.gcas.gcas": "is the simulator of gcas_search",
    "benchmarks.peers.run": "installs other simulators",
}


def list_changes():
    """Return the status by git of the folders for results."""
    command = ["git", "-C", str(ROOT), "status", "--porcelain", "benchmarks", "docs", "studies"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def run(*arguments, folder):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    before = list_changes()
    done = run_python(*arguments, "--smoke", cwd=folder, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert list_changes() == before


@pytest.mark.parametrize("script", [*STUDIES, "unknown_grid"])
def test_a_study_runs(script, tmp_path):
    name, *arguments = script.split()
    run(str(ROOT / "studies" / f"{name}.py"), *arguments, folder=tmp_path)


@pytest.mark.parametrize("script", BENCHMARKS)
def test_a_benchmark_runs(script, tmp_path):
    name, *arguments = script.split()
    run("-m", f"benchmarks.{name}", *arguments, folder=tmp_path)


def test_every_script_that_a_page_names_is_run():
    pages = [ROOT / "README.md", ROOT / "Makefile", *ROOT.glob("docs/*/*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = re.findall(r"\b(?:studies|benchmarks)(?:[./]\w+)+", text)
    modules = {name.replace("/", ".").removesuffix(".py") for name in named}
    scripts = {name for name in modules if (ROOT / f"{name.replace('.', '/')}.py").is_file()}
    run_here = {f"studies.{script.split()[0]}" for script in (*STUDIES, "unknown_grid")}
    run_here |= {f"benchmarks.{script.split()[0]}" for script in BENCHMARKS}
    paper_vehicle = {name for name in scripts if name.startswith("studies.paper_vehicle")}
    assert scripts - paper_vehicle <= run_here | OTHERS.keys()
    assert all(
        (ROOT / f"{name.replace('.', '/')}.py").is_file() for name in run_here | OTHERS.keys()
    )
