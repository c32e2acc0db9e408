"""Comparison of speed with other simulators, each in separate processes on one core.

    make bench-peers
    python -m benchmarks.peers.run [--rounds 3] [--repeats 5] [--flights 256]

The peers are the extra ``peers`` of pyproject.toml, installed into ``benchmarks/peers/.venv``; the
twin needs g++. The results are written to ``benchmarks/results/peers.json`` and a table of
``docs/explanation/performance.md``. Times are processor time, so that other programs on the machine
have little influence; a number is the median over all repetitions of all processes. If a peer
fails, it is named, the others are measured, and the exit code is 1.
"""

import argparse
import json
import os
import pickle
import platform
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.document import replace_part, write_json
from benchmarks.spread import describe_machine

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "benchmarks" / "results" / "peers.json"
DOCUMENT = ROOT / "docs" / "explanation" / "performance.md"
ENVIRONMENT = Path(__file__).parent / ".venv"

MODULES = ("ours", "twin", "jsbsim_x15", "rocketpy_flight")
TIME_LIMIT = 300.0  # s, of a process: compiling, checking, repeats
YARDSTICK = "abhv-mc lqr batched"
OUR_EQUATIONS = "GHAME-X, LQR, 100 Hz"
ROWS = {  # peer: (method, simulated vehicle)
    "abhv-mc tlc batched": ("numba, batched flights, metrics", "GHAME-X, TLC, 100 Hz"),
    YARDSTICK: ("numba, batched flights, metrics", OUR_EQUATIONS),
    "abhv-mc tlc one at a time": (
        "numba, one flight at a time, metrics",
        "GHAME-X, TLC, 100 Hz",
    ),
    "abhv-mc lqr one at a time": ("numba, one flight at a time, metrics", OUR_EQUATIONS),
    "C++ twin": ("g++ -O3 -march=native, one flight at a time", OUR_EQUATIONS),
    "JSBSim": (
        "C++ called step by step",
        "another vehicle: its X-15 and autopilot, gliding, 100 Hz",
    ),
    "RocketPy": ("Python and LSODA", "another vehicle: a sounding rocket, no controller"),
}


def install() -> Path:
    """Return the peers' interpreter; install it if it is missing or its requirements changed."""
    python = ENVIRONMENT / "bin" / "python"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    requirements = json.dumps([project["dependencies"], project["optional-dependencies"]["peers"]])
    stamp = ENVIRONMENT / "installed"
    if not (stamp.exists() and stamp.read_text() == requirements):
        print("installing the peers", file=sys.stderr, flush=True)
        subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run(
            [*pip, "--constraint", "requirements.lock", "--editable", ".[peers]"],
            check=True,
            cwd=ROOT,
        )
        stamp.write_text(requirements)
    return python


def write_work(path: Path, flights: int, repeats: int) -> None:
    """Write the flights that every peer simulates, and the final states of abhv-mc with LQR."""
    from abhv_mc_vehicle.flight.fly import fly
    from benchmarks.speed import make_work

    plans, parameters = make_work(flights)
    block = fly(plans["lqr"], parameters, record_every=plans["lqr"].timing.ticks, keep_states=True)
    if block.outcome.any() or plans["lqr"].timing.duration != 60.0:
        raise RuntimeError("not every flight reached 60 s")
    path.write_bytes(pickle.dumps((plans, parameters, block.states[:, -1], repeats)))


class PeerFailedError(Exception):
    """Failure or time-out of a peer's process."""


def run_peer(python: Path, module: str, work: Path, core: int) -> list[dict[str, Any]]:
    """Return the results of one process on one core. Raise PeerFailedError if it fails."""

    def pin() -> None:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {core})

    try:
        done = subprocess.run(
            [str(python), "-m", f"benchmarks.peers.{module}", str(work)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            preexec_fn=pin,  # this process has one thread
            check=True,
            timeout=TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        raise PeerFailedError(f"not done in {TIME_LIMIT:g} s") from None
    except subprocess.CalledProcessError as error:
        raise PeerFailedError(error.stderr.strip()[-2000:]) from None
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{"peer"')]


def find_versions(python: Path) -> dict[str, str]:
    """Return the versions of the compared programs."""
    names = ("numba", "numpy", "jsbsim", "rocketpy")
    code = (
        f"from importlib.metadata import version; print(*(version(n) for n in {names}), sep='\\n')"
    )
    installed = subprocess.run(
        [str(python), "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()
    versions = {"Python": platform.python_version(), **dict(zip(names, installed, strict=True))}
    if shutil.which("g++"):
        output = subprocess.run(
            ["g++", "-dumpfullversion"], check=True, capture_output=True, text=True
        ).stdout
        versions["g++"] = output.strip()
    return versions


def measure_peers(
    python: Path, rounds: int, repeats: int, flights: int
) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the time per flight of each peer, and the failed modules with their errors.

    Ratios are to abhv-mc in the same round.
    """
    seconds: dict[str, list[float]] = defaultdict(list)
    ratios: dict[str, list[float]] = defaultdict(list)
    further: dict[str, dict[str, float]] = defaultdict(dict)  # largest values of further numbers
    failed: dict[str, str] = {}
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder) / "work.pickle"
        write_work(work, flights, repeats)
        for i in range(rounds):
            this_round = {}
            for module in (name for name in MODULES if name not in failed):
                print(f"round {i + 1} of {rounds}: {module}", file=sys.stderr, flush=True)
                try:
                    results = run_peer(python, module, work, cores[-1])
                except PeerFailedError as error:
                    if module == MODULES[0]:
                        raise
                    failed[module] = str(error)
                    print(f"{module} failed: {error}", file=sys.stderr, flush=True)
                    continue
                for result in results:
                    name = result.pop("peer")
                    this_round[name] = result.pop("seconds")
                    further[name] = {
                        key: max(value, further[name].get(key, value))
                        for key, value in result.items()
                    }
            for name, times in this_round.items():
                seconds[name] += times
                ratios[name].append(median(times) / median(this_round[YARDSTICK]))
    peers = {
        name: {
            "seconds_per_flight": median(times),
            "lowest": min(times),
            "highest": max(times),
            "over_ours": median(ratios[name]),
            "repeats": len(times),
            "processes": len(ratios[name]),
            **further[name],
        }
        for name, times in seconds.items()
    }
    return peers, failed


def make_table(record: dict[str, Any]) -> str:
    """Return the results as Markdown."""
    machine, peers = record["machine"], record["peers"]
    ours = peers[YARDSTICK]
    lines = [
        f"{machine['processor']}, {machine['simd']}, {machine['cores']} cores, load "
        f"{machine['load_before']:.1f} before the start; a core's measured peak "
        f"{ours['peak_gflops']:.0f} GFLOP/s; "
        + ", ".join(f"{name} {version}" for name, version in record["versions"].items())
        + ".",
        "",
        "| simulator | implementation | flight | ms per 60 s flight and core | lowest to highest | "
        "relative to abhv-mc |",
        "|---|---|---|---|---|---|",
    ]
    for name, (how, what) in ROWS.items():
        title = f"**{name}**" if name.startswith("abhv-mc") else name
        if name not in peers:
            lines.append(f"| {title} | {how} | {what} | failed | | |")
            continue
        peer = peers[name]
        low, mid, high = (
            f"{1e3 * peer[key]:.3g}" for key in ("lowest", "seconds_per_flight", "highest")
        )
        lines.append(
            f"| {title} | {how} | {what} | {mid} | {low} to {high} | {peer['over_ours']:.2f} |"
        )
    differences = [
        f"{peer['altitude_difference_m']:.1e} m ({name})"
        for name, peer in peers.items()
        if "altitude_difference_m" in peer
    ]
    lines += [
        "",
        f"Medians of {ours['repeats']} repeats in each of {ours['processes']} processes; processor "
        f"time of one core; the last column is relative to `{YARDSTICK}` in the same round. "
        "The altitude after 60 s differs from that of abhv-mc by at most "
        + ", ".join(differences)
        + ".",
    ]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--flights", type=int, default=256)
    options = parser.parse_args()
    python = install()
    load = os.getloadavg()[0]
    versions = find_versions(python)
    peers, failed = measure_peers(python, options.rounds, options.repeats, options.flights)
    machine = describe_machine(load)
    record = {
        "machine": machine,
        "versions": versions,
        "flights": options.flights,
        "peers": peers,
        "failed": failed,
    }
    write_json(RESULT, record)
    table = make_table(record)
    replace_part(DOCUMENT, "peers", table)
    print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
