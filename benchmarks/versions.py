"""Time of a flight beside that of another version of the program, in turns.

    python -m benchmarks.versions CHECKOUT [--rounds 3]

CHECKOUT is another version's working tree (``git worktree add --detach ../before REVISION``), whose configuration both
fly. Processor time, 64 dispersed flights of the S manoeuvre, the best of 7 in each process.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

LAWS = ("tlc", "lqr_retuned")
FLIGHT = """
import sys, time
from pathlib import Path
import numpy as np
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.prepare import prepare
from abhv_mc.plant.parameters import PARAMETERS

configs, law = Path(sys.argv[1]), sys.argv[2]
files = (configs / "vehicle/ghame_x.yaml", configs / "mission/s_manoeuvre.yaml", configs / f"control/{law}.yaml")
plan, parameters, draw = prepare(*files, law), nominal_parameters(64), np.random.default_rng(1)
for name, width in (("atmosphere.density", 0.1), ("aero.lift", 0.1), ("aero.drag", 0.15)):
    parameters[:, [one.name for one in PARAMETERS].index(name)] = 1.0 + draw.uniform(-width, width, 64)
fly(plan, parameters)
times = []
for _ in range(7):
    start = time.thread_time()
    fly(plan, parameters)
    times.append(time.thread_time() - start)
print(min(times) / 64)
"""


def measure(tree: Path, configs: Path, law: str) -> float:
    """Seconds of a flight in a process of its own that runs the package of ``tree``."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    words = [sys.executable, "-c", FLIGHT, str(configs), law]
    return float(subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    here, before = Path(__file__).resolve().parents[1], options.checkout.resolve()
    for law in LAWS:
        ratios = [
            measure(here, before / "configs", law) / measure(before, before / "configs", law)
            for _ in range(options.rounds)
        ]
        print(f"{law}: {', '.join(f'{ratio:.3f}' for ratio in sorted(ratios))} of the other version's time")


if __name__ == "__main__":
    main()
