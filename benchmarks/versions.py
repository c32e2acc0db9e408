"""Cost of a start, a flight and a campaign relative to another version of the program.

    python -m benchmarks.versions CHECKOUT [--rounds 5] [--cold 1]

CHECKOUT is the working tree of another version (``git worktree add --detach ../before REVISION``),
whose configuration both versions run in this environment. Times are processor time of all processes
unless stated otherwise; ratios are medians over the rounds, this version over the other. The time
of a flight is the best of 7 for 64 dispersed flights in a process. The rounds ``--cold`` start
without compiled code and take minutes each. The table is written to
``benchmarks/results/versions.md``.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd

from benchmarks.document import replace_part
from benchmarks.processes import measure_all, measure_disk
from benchmarks.spread import describe_machine, make_note

LAWS = ("tlc", "lqr")
FLIGHT = """
import sys, time
from importlib import import_module
from pathlib import Path
import numpy as np
import abhv_mc

# older versions are one package
is_apart = Path(abhv_mc.__file__).parents[1].joinpath("abhv_mc_vehicle").exists()
package = "abhv_mc_vehicle" if is_apart else "abhv_mc"
fly, nominal_parameters, prepare, PARAMETERS = (
    getattr(import_module(f"{package}.{module}"), name)
    for module, name in (("flight.fly", "fly"), ("flight.fly", "nominal_parameters"),
                         ("flight.prepare", "prepare"), ("plant.parameters", "PARAMETERS"))
)

configs, law = Path(sys.argv[1]), sys.argv[2]
names = f"{law}.yaml", f"{law}_ghame_x.yaml"  # older versions have no name of the vehicle
controller = next(file for name in names for file in (configs / "control").rglob(name))
files = (configs / "vehicle/ghame_x.yaml", configs / "mission/s_manoeuvre.yaml", controller)
plan, parameters, draw = prepare(*files, law), nominal_parameters(64), np.random.default_rng(1)
varied = {"atmosphere.density": 0.1, "aero.lift": 0.1, "aero.drag": 0.15}
if hasattr(plan, "lean_for"):
    plan = plan.lean_for(varied)
for name, width in varied.items():
    parameters[:, [one.name for one in PARAMETERS].index(name)] = 1.0 + draw.uniform(\
-width, width, 64)
fly(plan, parameters)
times = []
for _ in range(int(sys.argv[3])):
    start = time.thread_time()
    fly(plan, parameters)
    times.append(time.thread_time() - start)
print(min(times) / 64 if times else 0.0)
"""
PYTHON = "import abhv_mc, sys; abhv_mc.Campaign.read(sys.argv[1]).run(output=sys.argv[2], runs=64)"
ROWS = 1_000_000  # rows of the imported table
IMPORTED = """
name: imported
question: Does it hold?
inputs: {a: {unit: m, nominal: 10}, b: {unit: m, nominal: 0}}
dispersions:
  a: {distribution: normal, sigma: 1 m}
  b: {distribution: uniform, half_width: 2 m}
metrics: {miss: {unit: m, bad: high}}
requirements: [{metric: miss, below: 15 m, probability: 90 %, consumer_risk: 10 %}]
independent: true
"""
Costs = dict[str, float]


class Version:
    """Working tree with a separate cache of compiled code."""

    def __init__(self, tree: Path, cache: Path, campaign: Path) -> None:
        self.tree, self.cache, self.campaign = tree, cache, campaign
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(tree / "src"),
            "XDG_CACHE_HOME": str(cache),
        }
        self.environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def flight(self, law: str) -> float:
        """Return the time of a flight, s."""
        command = [
            sys.executable,
            "-c",
            FLIGHT,
            str(self.campaign.parents[1] / "configs"),
            law,
            "7",
        ]
        return float(
            subprocess.run(
                command, env=self.environment, check=True, capture_output=True, text=True
            ).stdout
        )

    def command(self, *arguments: str) -> tuple[float, float, float]:
        """Return processor time (s), wall time (s) and memory of the largest process (MB).

        Raise RuntimeError if the command fails.
        """
        start = time.perf_counter()
        seconds, memory = measure_all([sys.executable, *arguments], self.environment)
        return seconds, time.perf_counter() - start, memory

    def campaigns(self, folder: Path) -> Costs:
        """Return the cost of campaigns of 64 and 4096 flights with compiled code."""
        run = ("-m", "abhv_mc", "run", str(self.campaign), "--runs")
        bare, complete, many = folder / "bare", folder / "whole", folder / "many"
        default = self.command(
            "-m", "abhv_mc", "run", str(self.campaign), "-o", str(folder / "all")
        )
        return {
            "default campaign and report": default[0],
            "default campaign and report, memory of the largest process": default[2],
            "64 flights from Python": self.command(
                "-c", PYTHON, str(self.campaign), str(folder / "python")
            )[0],
            "64 flights, no report": self.command(*run, "64", "--output", str(bare), "--no-report")[
                0
            ],
            "64 flights and report": self.command(*run, "64", "--output", str(complete))[0],
            "run with nothing new": self.command(*run, "64", "--output", str(complete))[0],
            "4096 flights, no report": self.command(
                *run, "4096", "--output", str(many), "--no-report"
            )[0],
        }

    def import_table(self, table: Path, folder: Path) -> Costs:
        """Return the cost of importing a table of flights."""
        (folder / "imported.yaml").write_text(IMPORTED)
        is_older = "def adopt" in (self.tree / "src/abhv_mc/cli/running.py").read_text()
        words = ("adopt",) if is_older else ("import", "flights")
        files = ("--campaign", str(folder / "imported.yaml"), "-o", str(folder / "imported"))
        cost = self.command("-m", "abhv_mc", *words, str(table), *files)
        return {f"import of {ROWS:,} rows": cost[0], f"import of {ROWS:,} rows, memory": cost[2]}

    def cold(self, folder: Path) -> Costs:
        """Return the cost of the kernel and of a campaign without compiled code."""
        with tempfile.TemporaryDirectory() as cache:
            empty = Version(self.tree, Path(cache), self.campaign)
            kernel = empty.command(
                "-c", FLIGHT, str(self.campaign.parents[1] / "configs"), "tlc", "0"
            )
        with tempfile.TemporaryDirectory() as cache:
            empty = Version(self.tree, Path(cache), self.campaign)
            first = empty.command(
                "-m", "abhv_mc", "run", str(self.campaign), "--output", str(folder / "first")
            )
            disk = measure_disk(Path(cache))
        return {
            "kernel alone": kernel[0],
            "kernel alone, memory": kernel[2],
            "first start": first[0],
            "first start, clock": first[1],
            "first start, memory of the largest process": first[2],
            "kernels on disk": disk,
        }


def write_table(path: Path, rows: int) -> None:
    """Write a table of flights that :meth:`Version.import_table` imports."""
    draw = np.random.default_rng(1)
    a, b = 10.0 + draw.standard_normal(rows), draw.uniform(-2.0, 2.0, rows)
    columns = {"flight": np.arange(rows), "outcome": "ok", "a": a, "b": b, "miss": abs(a + b)}
    pd.DataFrame(columns).to_csv(path, index=False)


def compare(
    current: Version, before: Version, rounds: int, measure: Callable[[Version, Path], Costs]
) -> list[str]:
    """Return and print rows with the ratios over rounds, which the versions start alternately."""
    pairs: list[tuple[Costs, Costs]] = []
    for number in range(rounds):
        costs = {}
        for version in (current, before) if number % 2 else (before, current):
            with tempfile.TemporaryDirectory() as folder:
                costs[version.tree] = measure(version, Path(folder))
        pairs.append((costs[current.tree], costs[before.tree]))
    rows = []
    for name in pairs[0][0] if pairs else ():
        ratios = sorted(ours[name] / theirs[name] for ours, theirs in pairs)
        middle = (
            median(ours[name] for ours, _ in pairs),
            median(theirs[name] for _, theirs in pairs),
        )
        spread = f"{ratios[0]:.2f} to {ratios[-1]:.2f}" if rounds > 1 else "once"
        rows.append(
            f"| {name} | {median(ratios):.2f} | {spread} | {middle[0]:.3g} | {middle[1]:.3g} |"
        )
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cold", type=int, default=1)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    current_tree, other = Path(__file__).resolve().parents[1], options.checkout.resolve()
    campaign = other / "campaigns/s_manoeuvre.yaml"
    if options.smoke:
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
            version = Version(other, cache, campaign)
            print(version.flight(LAWS[0]))
            write_table(Path(folder) / "table.csv", 60)
            print(version.import_table(Path(folder) / "table.csv", Path(folder)))
            print(
                version.command(
                    "-m", "abhv_mc", "run", str(campaign), "--runs", "2", "-o", f"{folder}/run"
                )
            )
        return
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as caches:
        ours, theirs = (
            Version(tree, Path(caches) / name, campaign)
            for tree, name in ((current_tree, "a"), (other, "b"))
        )
        rows = compare(ours, theirs, options.cold, lambda version, folder: version.cold(folder))
        for version in (ours, theirs) if options.rounds else ():  # compile
            with tempfile.TemporaryDirectory() as folder:
                version.campaigns(Path(folder))
        rows += compare(
            ours,
            theirs,
            options.rounds,
            lambda version, _: {law: version.flight(law) for law in LAWS},
        )
        rows += compare(
            ours, theirs, options.rounds, lambda version, folder: version.campaigns(folder)
        )
        flights = Path(caches) / "table.csv"
        write_table(flights, ROWS)
        rows += compare(
            ours,
            theirs,
            options.rounds,
            lambda version, folder: version.import_table(flights, folder),
        )
    if not (options.cold and options.rounds):
        return
    revision = subprocess.run(
        ["git", "-C", str(other), "rev-parse", "--short", "HEAD"],
        capture_output=True,
        check=False,
        text=True,
    )
    note = make_note(describe_machine(load), options.rounds).replace("processes", "rounds")
    note += f" Kernels and first starts: {options.cold}."
    head = [
        note,
        "",
        f"| of {revision.stdout.strip() or 'the other version'}'s | ratio | lowest to highest | "
        "this, s or MB | that |",
    ]
    table = "\n".join([*head, "|---|---|---|---|---|", *rows])
    replace_part(current_tree / "benchmarks" / "results" / "versions.md", "versions", table)


if __name__ == "__main__":
    main()
