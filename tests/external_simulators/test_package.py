"""A simulator of an installed package, which loads nothing of the vehicle."""

import json
import os

import pytest
from programs import run_python

CAMPAIGN = {
    "name": "ballistic",
    "runs": 300,
    "seed": 3,
    "simulator": {"package": "ballistic"},
    "inputs": {
        "speed": {"nominal": 100.0, "unit": "m/s"},
        "angle": {"nominal": 45.0, "unit": "deg"},
        "drag": {"nominal": 0.05},
    },
    "dispersions": {
        "speed": {"distribution": "normal", "sigma": 2.0},
        "angle": {"distribution": "uniform", "half_width": 2.0},
        "drag": {"distribution": "uniform", "half_width": 0.02},
    },
    "metrics": {"range": {"unit": "m", "bad": "low"}, "apex": {"unit": "m"}},
    "requirements": [{"metric": "range", "above": 880, "probability": 0.9}],
}
_RUN = """
import sys
from abhv_mc.cli.app import main
try:
    main()
finally:
    print(*sorted(name for name in sys.modules if name.startswith("abhv_mc")), file=sys.stderr)
"""


@pytest.fixture(scope="module")
def installed(repository, tmp_path_factory):
    """Return a folder for sys.path with the module of the how-to page and its entry point."""
    folder = tmp_path_factory.mktemp("site")
    text = (repository / "docs/how-to/ballistic.py").read_text()
    assert len(text.splitlines()) <= 35
    (folder / "ballistic.py").write_text(text)
    info = folder / "ballistic-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: ballistic\nVersion: 1\n")
    entries = "[abhv_mc.simulators]\nballistic = ballistic:Ballistic\n"
    (info / "entry_points.txt").write_text(entries)
    return folder


def run(installed, *arguments, code=0):
    """Return standard output and standard error of a command."""
    paths = filter(None, [str(installed or ""), os.environ.get("PYTHONPATH")])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    done = run_python("-c", _RUN, *arguments, env=environment)
    assert done.returncode == code, done.stderr
    return done.stdout, done.stderr


def test_a_package_flies_in_threads_and_processes_and_is_judged_alike(installed, tmp_path):
    digests, loaded = set(), ""
    for isolation in ("threads", "processes"):
        file, out = tmp_path / f"{isolation}.json", tmp_path / isolation
        file.write_text(json.dumps(CAMPAIGN | {"execution": {"isolation": isolation}}))
        _, loaded = run(installed, "run", file, "-o", out, "--no-report", "--workers", 2)
        digests.add(json.loads((out / "manifest.json").read_text())["digest"])
    assert len(digests) == 1
    assert not [name for name in loaded.split() if name.startswith("abhv_mc_vehicle")]
    shown, _ = run(installed, "show", "verdicts", out)
    assert "PASS" in shown and "ESTIMATE" not in shown
    _, error = run(None, "show", "verdicts", out, code=2)
    assert "the simulator 'ballistic' is not available" in error
    search = "worst", file, "--metric", "range", "--flights", 400, "-o", tmp_path / "worst"
    assert "Worst flight" in run(installed, *search)[0]
