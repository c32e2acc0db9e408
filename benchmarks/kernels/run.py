"""The kernels' gains as ratios, which hold from machine to machine better than times do.

python -m benchmarks.kernels.run [--json FILE]
"""

import argparse
from pathlib import Path

from abhv_mc.bench.figures import find_simd
from abhv_mc.bench.speed import make_work
from abhv_mc.flight.lanes import LANES
from benchmarks.document import replace_part, write_json
from benchmarks.kernels.functions import PAIRS, measure_function
from benchmarks.kernels.look_up import COMPARED, measure_look_up
from benchmarks.watch import measure_gain

ROOT = Path(__file__).parents[2]


def measure_ratios() -> dict[str, float]:
    """Every ratio, by what it compares."""
    plans, parameters = make_work(LANES)
    gains = {name: measure_gain(plan, parameters) for name, plan in plans.items()}
    return {
        **{f"flight, {name}: one at a time / {LANES} abreast": gain for name, gain in gains.items()},
        **{f"look-up: {compared}": measure_look_up(compared) for compared in COMPARED},
        **{f"{name}: libm / own": measure_function(name) for name in PAIRS},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, default=ROOT / "benchmarks" / "results" / "kernels.json")
    options = parser.parse_args()
    ratios = measure_ratios()
    simd = find_simd()
    write_json(options.json, {"simd": simd, "ratios": {name: round(ratio, 3) for name, ratio in ratios.items()}})
    rows = [f"| {name} | {ratio:.2f} |" for name, ratio in ratios.items()]
    table = "\n".join([f"| slower / faster ({simd}) | ratio of times |", "|---|---|", *rows])
    replace_part(ROOT / "docs" / "performance.md", "kernels", table)
    print(table)


if __name__ == "__main__":
    main()
