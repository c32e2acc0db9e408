"""Comparison of abhv-mc with other tools on the same runs of a custom function.

    python -m benchmarks.others.fair_fight [--rounds 3] [--json FILE]

A round runs 10,000 cheap and 3000 costly (1 ms) evaluations with each tool in turn, with two
workers if the tool has workers. Processor time is that of all processes. monaco is installed into
``benchmarks/others/.packages`` (needs the network). The script prints a table with the cost, the
stored results and the conclusions of each tool.
"""

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.document import write_json
from benchmarks.processes import measure_all
from benchmarks.spread import describe_machine, make_note

ROOT = Path(__file__).parents[2]
PACKAGES = Path(__file__).parent / ".packages"
MONACO = ("monaco==0.23.0", "tqdm", "psutil", "cloudpickle")
CASES = {"10,000 cheap": (10_000, 1), "3000 costly": (3_000, 10_000)}  # runs, steps of each
LIMIT, PROBABILITY = 1.2, 0.99

MODEL = """
import math

def evaluate(a, b, steps):
    x = a
    for _ in range(steps):
        x = math.sin(x + b) + 0.1 * a
    return x

def fly(inputs, settings):
    return {"miss": evaluate(inputs["a"], inputs["b"], STEPS)}
"""
_DRAW = """
import csv, sys
import numpy as np
from model import evaluate
runs, steps = int(sys.argv[1]), int(sys.argv[2])
"""
_FINISH = """
with open("table.csv", "w", newline="") as file:
    csv.writer(file).writerows(zip(*points.T, values))
print(np.mean(np.array(values) > 1.2))
"""
_POINTS = "points = np.random.default_rng(1).normal(size=(runs, 2))\n"


class Tool(NamedTuple):
    """Program of a tool, and descriptions of its results."""

    script: str
    stores: str
    concludes: str
    module: str = "numpy"  # required module


TABLE, SHARE = "a table", "the share of failures"
TOOLS = {
    "plain loop": Tool(
        _DRAW + _POINTS + "values = [evaluate(a, b, steps) for a, b in points]\n" + _FINISH,
        TABLE,
        SHARE,
    ),
    "joblib": Tool(
        _DRAW
        + "from joblib import Parallel, delayed\n"
        + _POINTS
        + "values = Parallel(2)(delayed(evaluate)(a, b, steps) for a, b in points)\n"
        + _FINISH,
        TABLE,
        SHARE,
        "joblib",
    ),
    "Dask": Tool(
        _DRAW
        + "from distributed import Client\n"
        + _POINTS
        + "if __name__ == '__main__':\n"
        + "    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:\n"
        + "        futures = client.map(evaluate, *points.T, steps=steps, pure=False, "
        "batch_size=500)\n"
        + "        values = client.gather(futures)\n"
        + _FINISH.replace("\n", "\n    ").rstrip(" "),
        TABLE,
        SHARE,
        "distributed",
    ),
    "OpenTURNS": Tool(
        _DRAW
        + "import openturns as ot\n"
        + "ot.RandomGenerator.SetSeed(1)\n"
        + "function = ot.PythonFunction(2, 1, lambda x: [evaluate(x[0], x[1], steps)])\n"
        + "points = ot.Normal(2).getSample(runs)\n"
        + "values, points = np.array(function(points))[:, 0], np.array(points)\n"
        + _FINISH,
        TABLE,
        SHARE,
        "openturns",
    ),
    "monaco": Tool(
        """
import sys
import monaco
from scipy.stats import norm
from model import evaluate
runs, steps = int(sys.argv[1]), int(sys.argv[2])

def preprocess(case):
    return case.invals["a"].val, case.invals["b"].val

def run(a, b):
    return (evaluate(a, b, steps),)

def postprocess(case, miss):
    case.addOutVal("miss", miss)

if __name__ == "__main__":
    functions = {"preprocess": preprocess, "run": run, "postprocess": postprocess}
    sim = monaco.Sim("fight", ndraws=runs, fcns=functions, firstcaseismedian=False, seed=1,
                     singlethreaded=True, savesimdata=True, savecasedata=False, verbose=False)
    sim.addInVar("a", dist=norm, distkwargs={"loc": 0, "scale": 1})
    sim.addInVar("b", dist=norm, distkwargs={"loc": 0, "scale": 1})
    sim.runSim()
    print(sum(value > 1.2 for value in sim.outvars["miss"].nums) / runs)
""",
        "its objects, pickled",
        "statistics that are asked for",
        "monaco",
    ),
}


def write_campaign(folder: Path, runs: int) -> None:
    """Write the abhv-mc campaign that uses the function."""
    dispersed = {name: {"distribution": "normal", "sigma": 1.0} for name in ("a", "b")}
    content = {
        "name": "fight",
        "simulator": {"python": "model.py"},
        "inputs": {"a": {}, "b": {}},
        "dispersions": dispersed,
        "metrics": {"miss": {}},
        "requirements": [{"metric": "miss", "below": LIMIT, "probability": PROBABILITY}],
        "runs": runs,
    }
    (folder / "fight.yaml").write_text(json.dumps(content), encoding="utf-8")


def measure_round(cases: dict[str, tuple[int, int]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return processor and wall time (s) by tool and case."""
    times: dict[str, dict[str, dict[str, float]]] = {}
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    ours = [sys.executable, "-m", "abhv_mc", "run", "fight.yaml", "--workers", "2", "-o"]
    for case, (runs, steps) in cases.items():
        with tempfile.TemporaryDirectory() as folder_name:
            folder = Path(folder_name)
            model = MODEL.replace("STEPS", str(steps))
            (folder / "model.py").write_text(model, encoding="utf-8")
            write_campaign(folder, runs)
            commands = {
                "**abhv-mc**, no report": [*ours, "bare", "--no-report"],
                "**abhv-mc** and report": [*ours, "whole"],
            }
            for number, (name, tool) in enumerate(TOOLS.items()):
                if importlib.util.find_spec(tool.module) is not None:
                    (folder / f"tool{number}.py").write_text(tool.script, encoding="utf-8")
                    arguments = f"tool{number}.py", str(runs), str(steps)
                    commands[name] = [sys.executable, *arguments]
            searched = os.pathsep.join([folder_name, str(ROOT / "src"), str(PACKAGES)])
            for name, command in commands.items():
                print(f"{case}: {name}", file=sys.stderr, flush=True)
                start = time.perf_counter()
                seconds, _ = measure_all(
                    command, environment | {"PYTHONPATH": searched}, folder=folder
                )
                wall = time.perf_counter() - start
                times.setdefault(name, {})[case] = {"processor": seconds, "clock": wall}
    return times


def make_table(rounds: list[dict[str, dict[str, dict[str, float]]]]) -> list[str]:
    """Return the medians as Markdown."""
    cases = list(CASES)
    lines = [
        f"| tool | {' | '.join(f'{case}: processor (clock), s' for case in cases)} | stores | "
        "concludes |",
        "|---|---|---|---|---|",
    ]
    verdict = "verdicts at a stated risk, drivers, failure rules"
    for name in rounds[0]:
        stores, concludes = "Parquet with hashes, resumable", verdict
        if name in TOOLS:
            stores, concludes = TOOLS[name].stores, TOOLS[name].concludes
        cells = []
        for case in cases:
            processor, clock = (
                median(times[name][case][kind] for times in rounds)
                for kind in ("processor", "clock")
            )
            cells.append(f"{processor:.2g} ({clock:.2g})")
        lines.append(f"| {name} | {' | '.join(cells)} | {stores} | {concludes} |")
    return lines


def install_monaco() -> None:
    """Install monaco separately, without libraries that are already installed."""
    if not (PACKAGES / "monaco").is_dir():
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, "--no-deps", "--target", str(PACKAGES), *MONACO], check=True)
    sys.path.append(str(PACKAGES))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    if options.smoke:
        print(json.dumps(measure_round({"smoke": (200, 1)}), indent=1))
        return
    install_monaco()
    load = os.getloadavg()[0]
    rounds = [measure_round(CASES) for _ in range(options.rounds)]
    machine = describe_machine(load)
    if options.json:
        write_json(options.json, {"machine": machine, "rounds": rounds})
    note = make_note(machine, options.rounds).replace("processes", "rounds")
    print("\n".join([note, "", *make_table(rounds)]))


if __name__ == "__main__":
    main()
