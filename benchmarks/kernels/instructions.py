"""Instructions of a flight by kind, counted: some control ticks of the machine code, one instruction at a time.

    python -m benchmarks.kernels.instructions [--processes 3] [--json FILE]      or, of one process each, --once

No clock is read, so a busy machine counts the same. Linux on x86-64, with gcc and objdump. Writes
``benchmarks/results/instructions.json`` and a table of ``docs/explanation/performance.md``.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.flight.plan import LANES
from benchmarks.document import replace_part, write_json
from benchmarks.spread import Spread, describe_machine, find_spreads, make_note, make_parser, repeat

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "benchmarks" / "results" / "instructions.json"
DOCUMENT = ROOT / "docs" / "explanation" / "performance.md"
SOURCE = Path(__file__).with_name("single_step.c")
LAWS = ("tlc", "lqr")
STEPS = 250_000  # some ticks of a group of flights
SHORTEST = 5000  # instructions of a tick, at least: what comes back sooner is a loop
KINDS = (
    "vectors: add, multiply",
    "vectors: divide, root",
    "vectors: load, store, spread",
    "vectors: compare, choose, convert",
    "single floats",
    "integers, addresses",
    "jumps",
)
TOTAL = "all"


def fly_on(law: str) -> None:
    """Fly a full group again and again, until killed."""
    from abhv_mc.bench.speed import make_work
    from abhv_mc.flight.fly import fly

    plans, parameters = make_work(LANES)
    fly(plans[law], parameters[:1])
    print("flying", flush=True)
    while True:
        fly(plans[law], parameters)


def kind_of(instruction: str) -> str:
    """The kind, of KINDS, of an instruction as objdump writes it."""
    name = instruction.split(maxsplit=1)[0]
    if name.startswith("j"):
        return "jumps"
    if not re.search(r"%[xyz]mm", instruction):
        return "vectors: compare, choose, convert" if name.startswith("k") else "integers, addresses"
    if not re.search(r"%[yz]mm", instruction):
        return "single floats"
    if re.match(r"v(div|sqrt)", name):
        return "vectors: divide, root"
    if re.match(r"v(add|sub|mul|f[n]?m)", name):
        return "vectors: add, multiply"
    if re.match(r"v(p?broadcast|mov)", name) and "{" not in instruction:
        return "vectors: load, store, spread"
    return "vectors: compare, choose, convert"


def step_through(law: str, folder: Path) -> None:
    """Fill ``folder`` with what single_step.c writes of a flying process."""
    program = folder / "single_step"
    subprocess.run(["gcc", "-O2", "-o", str(program), str(SOURCE)], check=True)
    words = [sys.executable, "-m", "benchmarks.kernels.instructions", "--fly", law]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as flying:
        try:
            next(iter(flying.stdout or ()))
            subprocess.run([str(program), str(flying.pid), str(STEPS), str(folder)], check=True)
        finally:
            flying.kill()


def find_tick(steps: np.ndarray, first: int, end: int) -> tuple[int, int]:
    """Two steps that are a tick apart: some instruction of the code from ``first`` to ``end`` comes back evenly.

    Raises ValueError where none does.
    """
    inside = (steps >= first) & (steps < end)
    places: dict[int, list[int]] = {}
    for i in np.flatnonzero(inside).tolist():
        places.setdefault(int(steps[i]), []).append(i)
    for found in places.values():
        gaps = np.diff(found)
        if len(gaps) >= 2 and gaps.min() >= SHORTEST and np.ptp(gaps) <= 0.02 * gaps.mean():
            return found[0], found[1]
    raise ValueError("no control tick found")


def count_instructions(law: str) -> dict[str, float]:
    """Instructions of a control tick and flight by kind, and all of them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        step_through(law, folder)
        steps = np.fromfile(folder / "steps", dtype=np.uint64).astype(np.int64)
        pieces = {int(path.name, 16): path for path in folder.iterdir() if re.fullmatch("[0-9a-f]{6,}", path.name)}

        def hits(first: int) -> int:
            return int(np.sum((steps >= first) & (steps < first + pieces[first].stat().st_size)))

        first = max(pieces, key=hits)
        end = first + pieces[first].stat().st_size
        start, stop = find_tick(steps, first, end)
        words = ["objdump", "-D", "-b", "binary", "-m", "i386:x86-64", "--no-show-raw-insn", f"--adjust-vma={first:#x}"]
        listing = subprocess.run([*words, str(pieces[first])], check=True, capture_output=True, text=True).stdout
    written = {
        int(line[1], 16): line[2].strip() for line in re.finditer(r"^\s*([0-9a-f]+):\t(.*)$", listing, re.MULTILINE)
    }
    tick = [step for step in steps[start:stop].tolist() if first <= step < end]  # calls into libraries left out
    kinds = Counter(kind_of(written[step]) for step in tick)
    return {**{kind: kinds[kind] / LANES for kind in KINDS}, TOTAL: len(tick) / LANES}


def make_table(machine: dict[str, Any], processes: int, counts: dict[str, dict[str, Spread]]) -> str:
    """The table as Markdown."""
    lines = [make_note(machine, processes), ""]
    lines += [f"| instructions of a tick and flight ({machine['simd']}) | TLC | LQR |", "|---|---|---|"]
    for kind in (*KINDS, TOTAL):
        lines.append(f"| {kind} | {counts['tlc'][kind].median:.0f} | {counts['lqr'][kind].median:.0f} |")
    return "\n".join(lines)


def main() -> None:
    parser = make_parser(__doc__, RESULT)
    parser.add_argument("--once", action="store_true", help="count in one process each, print JSON, write nothing")
    parser.add_argument("--fly", choices=LAWS, help="be the process that is looked at")
    options = parser.parse_args()
    if options.fly:
        fly_on(options.fly)
    if options.once:
        print(json.dumps({law: count_instructions(law) for law in LAWS}))
        return
    load = os.getloadavg()[0]
    runs = repeat(options.processes, "benchmarks.kernels.instructions", "--once")
    counts = {law: find_spreads([run[law] for run in runs]) for law in LAWS}
    machine = describe_machine(load)
    found = {law: {kind: one._asdict() for kind, one in counts[law].items()} for law in LAWS}
    write_json(options.json, {**found, "machine": machine, "processes": len(runs), "lanes": LANES})
    table = make_table(machine, len(runs), counts)
    replace_part(DOCUMENT, "instructions", table)
    print(table)


if __name__ == "__main__":
    main()
