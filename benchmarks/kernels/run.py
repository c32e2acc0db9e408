"""The kernels' gains as ratios, which hold from machine to machine better than times do.

    python -m benchmarks.kernels.run [--processes 3] [--json FILE]      or, of one process and to the screen, --once

Writes ``benchmarks/results/kernels.json`` and prints it as a table.
"""

import json
import os
from pathlib import Path
from typing import Any

from abhv_mc.bench.speed import make_work
from abhv_mc.flight.plan import LANES
from benchmarks.document import write_json
from benchmarks.kernels.functions import PAIRS, measure_function
from benchmarks.kernels.look_up import COMPARED, measure_look_up
from benchmarks.spread import Spread, describe_machine, find_spreads, make_note, make_parser, repeat
from benchmarks.watch import measure_gain

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "benchmarks" / "results" / "kernels.json"


def measure_ratios() -> dict[str, float]:
    """Every ratio, by what it compares."""
    plans, parameters = make_work(LANES)
    gains = {name: measure_gain(plan, parameters) for name, plan in plans.items()}
    return {
        **{f"flight, {name}: one at a time / {LANES} batched": gain for name, gain in gains.items()},
        **{f"look-up: {compared}": measure_look_up(compared) for compared in COMPARED},
        **{f"{name}: libm / own": measure_function(name) for name in PAIRS},
    }


def make_record(machine: dict[str, Any], processes: int, ratios: dict[str, Spread]) -> dict[str, Any]:
    """What is kept: the medians as ``ratios``, and their ends."""
    ends = {"ratios": "median", "lowest": "lowest", "highest": "highest"}
    found = {key: {name: round(getattr(one, end), 3) for name, one in ratios.items()} for key, end in ends.items()}
    return {"simd": machine["simd"], "machine": machine, "processes": processes, **found}


def make_table(machine: dict[str, Any], processes: int, ratios: dict[str, Spread]) -> str:
    """The table as Markdown."""
    head = [make_note(machine, processes), ""]
    head += [f"| slower / faster ({machine['simd']}) | ratio of times | lowest to highest |", "|---|---|---|"]
    rows = [f"| {name} | {one.median:.2f} | {one.lowest:.2f} to {one.highest:.2f} |" for name, one in ratios.items()]
    return "\n".join([*head, *rows])


def main() -> None:
    parser = make_parser(__doc__, RESULT)
    parser.add_argument("--once", action="store_true", help="measure in this process, print JSON, write nothing")
    options = parser.parse_args()
    if options.once:
        print(json.dumps(measure_ratios()))
        return
    load = os.getloadavg()[0]
    ratios = find_spreads(repeat(options.processes, "benchmarks.kernels.run", "--once"))
    machine = describe_machine(load)
    write_json(options.json, make_record(machine, options.processes, ratios))
    print(make_table(machine, options.processes, ratios))


if __name__ == "__main__":
    main()
