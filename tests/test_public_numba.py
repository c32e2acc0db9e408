"""Both interfaces of numba make the same flights: the same small campaign, flown with each.

The public one compiles for a minute or two when its cache is empty: numba optimizes each function by itself. It does
so for the vectors that LLVM would choose, half as wide on Intel's processors: neither changes a bit.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest

import abhv_mc

CAMPAIGN = """\
name: both
question: Does it matter which interface of numba compiles?
vehicle: {configs}/vehicle/ghame_x.yaml
mission: mission.yaml
controllers:
  tlc: {configs}/control/tlc.yaml
  lqr: {configs}/control/lqr.yaml
runs: 6
seed: 3
sampling: random
dispersions:
  atmosphere.density: {{distribution: uniform, half_width: 10 %}}
  aero.lift: {{distribution: uniform, half_width: 10 %}}
  aero.drag: {{distribution: uniform, half_width: 15 %}}
execution: {{workers: 1}}
"""


def fly(campaign: Path, out: Path, public: str) -> dict:
    source = str(Path(abhv_mc.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": source, "ABHV_MC_PUBLIC_NUMBA": public}
    if public == "1":
        environment["NUMBA_CPU_FEATURES"] = llvm.get_host_cpu_features().flatten()
    words = [sys.executable, "-m", "abhv_mc", "run", str(campaign), "-o", str(out), "--no-report"]
    subprocess.run(words, env=environment, check=True, capture_output=True)
    return json.loads((out / "manifest.json").read_text())


@pytest.fixture
def campaign(repository, tmp_path):
    configs = repository / "configs"
    mission = (configs / "mission" / "s_manoeuvre.yaml").read_text()
    assert "duration: 60 s" in mission
    (tmp_path / "mission.yaml").write_text(mission.replace("duration: 60 s", "duration: 8 s"))
    (tmp_path / "both.yaml").write_text(CAMPAIGN.format(configs=configs))
    return tmp_path / "both.yaml"


def test_the_same_flights(campaign, tmp_path):
    private, public = (fly(campaign, tmp_path / name, asked) for name, asked in (("private", "0"), ("public", "1")))
    assert (private["compiler"], public["compiler"]) == ("private", "public")
    assert private["digests"] == public["digests"] and private["digest"] == public["digest"]
    assert private["runs_done"] == 6 and private["runs_failed"] == 0
