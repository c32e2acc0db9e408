"""Overhead of abhv-mc per flight of a custom simulator that computes nothing.

    python -m benchmarks.own_simulator        a Python function and a C program (needs cc)

The overhead is processor time in milliseconds: the difference between runs of 40,000 and 4000
flights, for all processes together, without the report.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.processes import measure_all

FEW, MANY = 4_000, 40_000
PYTHON = "def fly(inputs, settings):\n    return {'miss': inputs['a']}\n"
C = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
int main(void) {
    static char line[65536];
    while (fgets(line, sizeof line, stdin)) {
        const char *at = strstr(line, "\"a\": ");
        printf("{\"miss\": %.17g}\n", at ? strtod(at + 5, NULL) : 0.0);
        fflush(stdout);
    }
    return 0;
}
"""


def write_campaign(folder: Path, simulator: dict[str, object]) -> Path:
    """Write a campaign with two inputs and a metric whose simulator computes nothing."""
    laws = {name: {"distribution": "normal", "sigma": 1.0} for name in ("a", "b")}
    content = {
        "name": "nothing",
        "simulator": simulator,
        "inputs": {"a": {}, "b": {}},
        "dispersions": laws,
        "metrics": {"miss": {}},
        "requirements": [{"metric": "miss", "below": 5.0, "probability": 0.99}],
        "runs": MANY,
    }
    path = folder / "nothing.yaml"
    path.write_text(json.dumps(content))
    return path


def seconds(campaign: Path, flights: int, workers: int) -> float:
    """Return the processor time of a run with all its processes, s."""
    with tempfile.TemporaryDirectory() as out:
        command = [
            sys.executable,
            "-m",
            "abhv_mc",
            "run",
            str(campaign),
            "--runs",
            str(flights),
            "-o",
            out,
            "--fresh",
        ]
        return measure_all([*command, "--workers", str(workers), "--no-report"])[0]


def milliseconds_a_flight(campaign: Path, workers: int = 2) -> float:
    """Return the processor time per flight, ms."""
    return 1e3 * (seconds(campaign, MANY, workers) - seconds(campaign, FEW, workers)) / (MANY - FEW)


def main() -> None:
    """Print the overhead of both simulators, three times each."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "nothing.py").write_text(PYTHON)
        (folder / "nothing.c").write_text(C)
        subprocess.run(["cc", "-O2", "-o", folder / "nothing", folder / "nothing.c"], check=True)
        for label, simulator in (
            ("python", {"python": "nothing.py"}),
            ("command", {"command": ["./nothing"]}),
        ):
            campaign = write_campaign(folder, simulator)
            print(label, *(f"{milliseconds_a_flight(campaign):.4f} ms" for _ in range(3)))


if __name__ == "__main__":
    main()
