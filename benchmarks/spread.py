"""One measurement in several processes of its own: medians, how far they spread, and on which machine."""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

PROCESSES = 3  # a number of the page was seen in as many


class Spread(NamedTuple):
    """What the processes found for one quantity."""

    median: float
    lowest: float
    highest: float


def find_spread(values: Sequence[float]) -> Spread:
    """Median, lowest and highest of the values. Raises ValueError where there are none."""
    return Spread(median(values), min(values), max(values))


def find_spreads(runs: Sequence[Mapping[str, float]]) -> dict[str, Spread]:
    """By quantity, what runs of the same quantities found."""
    return {name: find_spread([run[name] for run in runs]) for name in runs[0]}


def repeat(processes: int, *words: str) -> list[Any]:
    """The JSON that ``python -m`` with these words prints, of one process after another.

    Raises subprocess.CalledProcessError where a process fails: a number that fewer saw is none.
    """
    runs = []
    for i in range(processes):
        print(f"process {i + 1} of {processes}: {' '.join(words)}", file=sys.stderr, flush=True)
        done = subprocess.run(
            [sys.executable, "-m", *words], check=True, stdout=subprocess.PIPE, text=True
        )
        runs.append(json.loads(done.stdout))
    return runs


def describe_machine(load_before: float) -> dict[str, Any]:
    """This machine and its load before the start, as results say them.

    Call it when all is measured: libraries that it loads would share their pages with the measured processes, whose
    memory would then count for less.
    """
    from abhv_mc.identity import find_machine
    from abhv_mc_verification.bench.speed import find_simd

    return {**find_machine(), "simd": find_simd(), "load_before": load_before}


def make_note(machine: Mapping[str, Any], processes: int) -> str:
    """The line above a table: where, and how often."""
    counted = "one process" if processes == 1 else f"medians of {processes} processes"
    return (
        f"{machine['processor']}, {machine['simd']}, {machine['cores']} cores, "
        f"load {machine['load_before']:.1f} before the start; {counted}."
    )


def make_parser(doc: str, result: Path) -> argparse.ArgumentParser:
    """What benchmarks of several processes are told on the command line: ``processes`` and ``json``."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument(
        "--processes", type=read_count, default=PROCESSES, help=f"default: {PROCESSES}"
    )
    parser.add_argument(
        "--json", type=Path, default=result, help=f"default: {result.name} among the results"
    )
    return parser


def read_count(text: str) -> int:
    """A number of processes, at least 1. Raises ValueError, which argparse reports."""
    count = int(text)
    if count < 1:
        raise ValueError(text)
    return count
