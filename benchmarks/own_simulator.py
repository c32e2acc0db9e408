"""What abhv-mc itself costs a flight of a user's simulator: processor time of runs that do nothing in their flights.

    python -m benchmarks.own_simulator        a Python function and a C program (needs cc); milliseconds a flight

It is the difference between a run of 40,000 and one of 4000 flights, all processes together, without the report.
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
    """A campaign of two inputs and a metric, whose simulator does nothing."""
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
    """Processor time of a run with all its processes, s."""
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
    """Of processor time."""
    return 1e3 * (seconds(campaign, MANY, workers) - seconds(campaign, FEW, workers)) / (MANY - FEW)


def main() -> None:
    """Print both, three times each."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "nothing.py").write_text(PYTHON)
        (folder / "nothing.c").write_text(C)
        subprocess.run(["cc", "-O2", "-o", folder / "nothing", folder / "nothing.c"], check=True)
        for words, simulator in (
            ("python", {"python": "nothing.py"}),
            ("command", {"command": ["./nothing"]}),
        ):
            campaign = write_campaign(folder, simulator)
            print(words, *(f"{milliseconds_a_flight(campaign):.4f} ms" for _ in range(3)))


if __name__ == "__main__":
    main()
