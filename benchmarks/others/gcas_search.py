"""Number of calls until searches find a ground impact in AeroBench's collision avoidance.

    python -m benchmarks.others.gcas_search AEROBENCH/code [--seeds 5] [--calls 320] [--json FILE]

AEROBENCH is a copy of AeroBenchVVPython (GPL 3, not a package and not included here), which is
copied beside a copy of `gcas/campaign.yaml`. `abhv-mc worst` runs this campaign; the random flights
are those that it runs for comparison. Simulated annealing is scipy's dual_annealing without local
search, which PSY-TaLiRo's DualAnnealing calls.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset
from scipy.optimize import dual_annealing

from benchmarks.document import write_json

STUDY = Path(__file__).parent / "gcas"
BOX = {
    "roll": (36.0, 51.0),
    "pitch": (-72.0, -63.0),
    "yaw": (-67.5, -22.5),
}  # deg, as in the campaign


def search(aerobench: Path, seed: int, calls: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest altitudes (ft) in the order of calls, of the search and random flights."""
    with tempfile.TemporaryDirectory() as folder:
        study = Path(shutil.copytree(STUDY, f"{folder}/gcas"))
        shutil.copytree(aerobench / "aerobench", study / "aerobench")
        arguments = [
            "worst",
            f"{study}/campaign.yaml",
            "--metric",
            "altitude_min",
            "--flights",
            str(calls),
            "--seed",
            str(seed),
        ]
        command = [sys.executable, "-m", "abhv_mc", *arguments, "-o", f"{folder}/worst"]
        subprocess.run(command, check=True, capture_output=True)
        table = pyarrow.dataset.dataset(f"{folder}/worst/flights").to_table().sort_by("flight")
    return tuple(np.split(table["altitude_min"].to_numpy(), 2))


def anneal(seed: int, calls: int) -> np.ndarray:
    """Return the lowest altitudes (ft) of simulated annealing in the order of calls."""
    from gcas import fly

    altitudes: list[float] = []

    def value(angles: np.ndarray) -> float:
        inputs = dict(zip(BOX, angles.tolist(), strict=True))
        altitudes.append(fly(inputs, {"altitude": 2330.0})["altitude_min"])
        return altitudes[-1]

    dual_annealing(value, list(BOX.values()), rng=seed, maxfun=calls, no_local_search=True)
    return np.array(altitudes[:calls])


def summarise(values: np.ndarray) -> dict[str, Any]:
    """Return the lowest altitude, and the number of the first call below ground or None."""
    below = np.flatnonzero(values <= 0.0)
    return {
        "calls": len(values),
        "lowest_ft": float(values.min()),
        "first": int(below[0]) + 1 if below.size else None,
    }


def study(aerobench: Path, seeds: int, calls: int) -> list[dict[str, Any]]:
    """Return a row for each seed."""
    rows = []
    for seed in range(1, seeds + 1):
        searched, random = search(aerobench, seed, calls)
        methods = {"worst": searched, "random": random, "annealing": anneal(seed, calls)}
        rows.append({"seed": seed, **{name: summarise(values) for name, values in methods.items()}})
        print(describe(rows[-1]), flush=True)
    return rows


def describe(row: dict[str, Any]) -> str:
    """Return a row of the page's table."""
    cells = [
        f"{summary['first'] or 'none'}, {summary['lowest_ft']:.1f} ft"
        for name, summary in row.items()
        if name != "seed"
    ]
    return f"| {row['seed']} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("aerobench", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--calls", type=int, default=320)
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    aerobench = arguments.aerobench.resolve()
    sys.path += [str(aerobench), str(STUDY)]
    rows = study(aerobench, arguments.seeds, arguments.calls)
    if arguments.json:
        write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
