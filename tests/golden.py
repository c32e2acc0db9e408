"""Numbers of small reports that a change of structure must not move, and how they are renewed.

    python tests/golden.py --renew [NAME...]    writes tests/reference/golden/NAME.json.gz

The cases are the shipped campaigns with a few flights, two simulators in Python, and a table. Renew
them in the commit that is meant to move numbers, and say there which and why.
"""

import argparse
import gzip
import json
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

from own_simulators import DIVE_CHANNELS, DIVE_HISTORY, dive_campaign

from abhv_mc.cli.app import main
from abhv_mc.shipped import shipped_configs, shipped_files

STORED = Path(__file__).parent / "reference" / "golden"
CASES = (*shipped_files("campaign"), "rocket", "dive", "table")
FLIGHTS = 8
_PATCHES = {  # drawing and searching take most of the time
    "abhv_mc.topics.registry.make_figures": lambda models: {},
    "abhv_mc.statistics.unknowns.FEWEST_SEARCHED": 8,
}
# What is another in each folder, on each machine or in each version; texts are tested elsewhere.
_OTHER = {
    "code",
    "failure_map",
    "hash",
    "key",
    "pages",
    "files",
    "pictures",
    "digest",
    "digests",
    "warnings",
    "versions",
    "labels",
}
_STATUS = re.compile(r"[A-Za-z][\w.]*|NOT SHOWN")
_DIGITS = 12  # that are stored
_TOLERANCE = 1e-9  # relative, for floating-point numbers of another machine
# flights that cycle at their limits or end early amplify the last bits of gains
_TOLERANCES = {"wide": 1e-7, "wind_and_sensors": 1e-7}
# ratio of a variance to that of paired differences, which may be near their rounding
_AMPLIFIED, _FACTOR = "pairing_gain", 1e6
_ZERO = 1e-10  # absolute, for differences of numbers that are nearly equal
# The rudder of its trim lies on a node of the tables; the last bits decide on which side, and
# slopes differ there.
_ON_A_NODE = {"winged_cone": "margins"}


def run_program(folder: Path, *arguments: object) -> None:
    """Run a command of the program in this process; exit codes of verdicts are ignored."""
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {"XDG_CONFIG_HOME": str(folder / "config")}))
        stack.enter_context(patch.object(sys, "argv", ["abhv-mc", *map(str, arguments)]))
        for name, value in _PATCHES.items():
            stack.enter_context(patch(name, value))
        try:
            main()
        except SystemExit as ended:
            if ended.code not in (None, 0, 1):
                raise


def make_report(case: str, folder: Path) -> Any:
    """Return the numbers and statuses of a case's ``report.json``, made in an empty folder."""
    results = folder / "results"
    if case in ("dive", "table"):
        own = dive_campaign(folder / "own", DIVE_HISTORY, histories=DIVE_CHANNELS, runs=300)
        run_program(folder, "run", own, "-o", results, "--workers", 2)
    if case == "table":
        run_program(folder, "query", results, "--csv", folder / "exported")
        content = json.loads(own.read_text())
        for name in ("simulator", "runs", "histories"):
            del content[name]
        del content["inputs"]["dive"]  # nominal in each flight, and not in the table
        own.write_text(json.dumps(content | {"independent": True}))
        table, results = folder / "exported" / "flights.csv", folder / "adopted"
        run_program(folder, "import", "flights", table, "--campaign", own, "-o", results)
    if case == "rocket":
        campaign = shipped_configs() / "simulator" / "campaign.yaml"
        python = campaign.parent / "python" / "rocket.py"
        (folder / "rocket.py").write_bytes(python.read_bytes())
        own = folder / "campaign.yaml"
        own.write_bytes(campaign.read_bytes())
        run_program(folder, "run", own, "-o", results, "--runs", 200, "--workers", 2)
    if case in (shipped := shipped_files("campaign")):
        run_program(folder, "run", shipped[case], "-o", results, "--runs", FLIGHTS, "--workers", 1)
    report = json.loads((results / "report.json").read_text("utf-8"))
    report.pop(_ON_A_NODE.get(case), None)
    return keep_numbers(report)


def keep_numbers(value: Any) -> Any:
    """Return a value of ``report.json`` without texts and entries that depend on the folder."""
    if isinstance(value, dict):
        return {
            name: keep_numbers(entry)
            for name, entry in value.items()
            if name not in _OTHER and not _is_text(entry)
        }
    if isinstance(value, list):
        return [keep_numbers(entry) for entry in value if not _is_text(entry)]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    return value


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and not _STATUS.fullmatch(value)


def find_differences(
    stored: Any, value: Any, tolerance: float = _TOLERANCE, path: str = ""
) -> Iterator[str]:
    """Yield stored numbers and statuses that are missing or differ; new entries are ignored."""
    if isinstance(stored, dict) and isinstance(value, dict):
        for name, entry in stored.items():
            if name in value:
                own = tolerance * (_FACTOR if name == _AMPLIFIED else 1.0)
                yield from find_differences(entry, value[name], own, f"{path}/{name}")
            else:
                yield f"{path}/{name}: missing"
    elif isinstance(stored, list) and isinstance(value, list):
        if len(stored) != len(value):
            yield f"{path}: {len(value)} entries instead of {len(stored)}"
        for k, (entry, other) in enumerate(zip(stored, value, strict=False)):
            yield from find_differences(entry, other, tolerance, f"{path}/{k}")
    elif not _is_same(stored, value, tolerance):
        yield f"{path}: {value!r} instead of {stored!r}"


def _is_same(stored: Any, value: Any, tolerance: float) -> bool:
    if isinstance(stored, float) and isinstance(value, float):
        return math.isclose(stored, value, rel_tol=tolerance, abs_tol=_ZERO)
    return type(stored) is type(value) and bool(stored == value)


def compare_report(case: str, folder: Path) -> list[str]:
    """Return the differences of a case's report, made in an empty folder, from the stored one."""
    tolerance = _TOLERANCES.get(case, _TOLERANCE)
    return list(find_differences(read_stored(case), make_report(case, folder), tolerance))


def read_stored(case: str) -> Any:
    """Return the stored numbers of a case."""
    return json.loads(gzip.decompress((STORED / f"{case}.json.gz").read_bytes()))


def write_stored(case: str, numbers: Any) -> Path:
    """Store the numbers of a case, in the same bytes for the same numbers."""
    text = json.dumps(numbers, separators=(",", ":"))
    path = STORED / f"{case}.json.gz"
    path.write_bytes(gzip.compress(text.encode(), compresslevel=9, mtime=0))
    return path


def _renew() -> None:
    parser = argparse.ArgumentParser(description="Renew the stored numbers of small reports.")
    parser.add_argument("--renew", nargs="*", metavar="NAME", choices=CASES, required=True)
    for case in parser.parse_args().renew or CASES:
        with tempfile.TemporaryDirectory() as folder:
            numbers = make_report(case, Path(folder))
        stored = STORED / f"{case}.json.gz"
        moved = list(find_differences(read_stored(case), numbers)) if stored.exists() else ["new"]
        path = write_stored(case, numbers)
        print(f"{case}: {len(moved)} differences, {path.stat().st_size} bytes", flush=True)


if __name__ == "__main__":
    _renew()
