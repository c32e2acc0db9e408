"""Import of RocketPy's Monte Carlo simulation by `abhv-mc import flights`, and comparison.

    python -m benchmarks.others.rocketpy_table write FILE

The command reads FILE.inputs.txt and FILE.outputs.txt.
    python -m benchmarks.others.rocketpy_table adopt [--json FILE]

The first command writes `tests/reference/rocketpy/monte_carlo.csv` with a row per flight; nested
inputs, such as the inputs of a motor, are found by their names in `rocketpy.yaml`. The second
command imports that table and compares the results.
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import read_campaign
from benchmarks.document import write_json

CAMPAIGN = Path(__file__).parent / "rocketpy.yaml"
TABLE = Path(__file__).parents[2] / "tests" / "reference" / "rocketpy" / "monte_carlo.csv"
# by benchmarks.others.rocketpy_monte_carlo
THEIRS = Path(__file__).parents[1] / "results" / "others_rocketpy_theirs.json"


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return RocketPy's lines of JSON sorted by index, because its workers write in any order."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return sorted(lines, key=lambda line: line["index"])


def find_values(content: Any) -> Iterator[tuple[str, Any]]:
    """Yield every number in a line with its name, at any depth, the outermost first."""
    if isinstance(content, dict):
        yield from content.items()
        for value in content.values():
            yield from find_values(value)
    elif isinstance(content, list):
        for value in content:
            yield from find_values(value)


def write_table(base: Path) -> None:
    """Write a row for each flight, with the inputs and metrics of the campaign."""
    model = read_campaign(CAMPAIGN).model
    inputs, outputs = (
        read_lines(base.with_name(f"{base.name}.{kind}.txt")) for kind in ("inputs", "outputs")
    )
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["flight", *model.inputs, *model.metrics])
        for number, (drawn, returned) in enumerate(zip(inputs, outputs, strict=True)):
            values = dict(reversed([*find_values(drawn)])) | returned
            writer.writerow(
                [number, *(f"{values[name]:.12g}" for name in (*model.inputs, *model.metrics))]
            )


def adopt() -> list[dict[str, Any]]:
    """Import the table, and return the results of RocketPy and of the report for each metric."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["import", "flights", str(TABLE), "--campaign", str(CAMPAIGN), "-o", folder]
        subprocess.run([sys.executable, "-m", "abhv_mc", *command], capture_output=True, check=True)
        report = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
    theirs = json.loads(THEIRS.read_text(encoding="utf-8"))
    rows = []
    for metric, stored in theirs.items():
        quantiles = report["metrics"]["table"][metric]["controllers"]["rocket"]["quantiles"]
        drivers = report["drivers"]["controllers"]["rocket"]["metrics"][metric]["parameters"]
        # The 95 % quantile is towards the bad side.
        ours = {share: quantiles[name] for share, name in (("0.5", "q50"), ("0.05", "q95"))}
        rows.append(
            {
                "metric": metric,
                "theirs": stored,
                "ours": {
                    share: [quantile[key] for key in ("value", "low", "high")]
                    for share, quantile in ours.items()
                },
                "drivers": [driver["parameter"] for driver in drivers if driver["driver"]],
            }
        )
    return rows


def describe(row: dict[str, Any]) -> str:
    """Return a row of the page's table."""
    cells = [row["metric"]]
    for source in (row["theirs"], row["ours"]):
        for share in ("0.5", "0.05"):
            value, low, high = source[share]
            cells.append(f"{value:.2f} ({low:.2f} .. {high:.2f})")
    shares = sorted(row["theirs"]["variance"].items(), key=lambda item: -item[1])
    cells.append(
        ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares if share >= 0.01)
    )
    cells.append(", ".join(row["drivers"]))
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=["write", "adopt"])
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    if arguments.action == "write":
        write_table(arguments.file)
        return
    rows = adopt()
    print(*map(describe, rows), sep="\n")
    if arguments.json:
        write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
