"""Repetition of a measurement in several processes: medians, ranges and the machine."""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

PROCESSES = 3  # number of processes behind each number of the page


class Spread(NamedTuple):
    """Median and range of one quantity over the processes."""

    median: float
    lowest: float
    highest: float


def find_spread(values: Sequence[float]) -> Spread:
    """Return median, lowest and highest of the values. Raise ValueError if there are none."""
    return Spread(median(values), min(values), max(values))


def find_spreads(runs: Sequence[Mapping[str, float]]) -> dict[str, Spread]:
    """Return the spread of each quantity over the runs."""
    return {name: find_spread([run[name] for run in runs]) for name in runs[0]}


def repeat(processes: int, *arguments: str) -> list[Any]:
    """Return the JSON that ``python -m`` prints, from one process after another.

    Raise subprocess.CalledProcessError if a process fails.
    """
    runs = []
    for i in range(processes):
        print(f"process {i + 1} of {processes}: {' '.join(arguments)}", file=sys.stderr, flush=True)
        done = subprocess.run(
            [sys.executable, "-m", *arguments], check=True, stdout=subprocess.PIPE, text=True
        )
        runs.append(json.loads(done.stdout))
    return runs


def describe_machine(load_before: float) -> dict[str, Any]:
    """Return a description of this machine and its load before the start.

    Call the function after all measurements, because the libraries that it loads would share pages
    with the measured processes and reduce their memory.
    """
    from abhv_mc.identity import find_machine
    from benchmarks.speed import find_simd

    return {**find_machine(), "simd": find_simd(), "load_before": load_before}


def make_note(machine: Mapping[str, Any], processes: int) -> str:
    """Return the line above a table, with machine and number of processes."""
    counted = "one process" if processes == 1 else f"medians of {processes} processes"
    return (
        f"{machine['processor']}, {machine['simd']}, {machine['cores']} cores, "
        f"load {machine['load_before']:.1f} before the start; {counted}."
    )


def make_parser(doc: str, result: Path) -> argparse.ArgumentParser:
    """Return the parser of benchmarks with several processes: ``processes`` and ``json``."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument(
        "--processes", type=read_count, default=PROCESSES, help=f"default: {PROCESSES}"
    )
    parser.add_argument(
        "--json", type=Path, default=result, help=f"default: {result.name} among the results"
    )
    return parser


def read_count(text: str) -> int:
    """Return a number of processes. Raise ValueError, which argparse reports, if below 1."""
    count = int(text)
    if count < 1:
        raise ValueError(text)
    return count
