"""RocketPy's exported Monte Carlo as a table for `abhv-mc import flights`; its numbers beside the folder's.

    python -m benchmarks.others.rocketpy_table write FILE    # FILE.inputs.txt, FILE.outputs.txt, as RocketPy has them
    python -m benchmarks.others.rocketpy_table adopt [--json FILE]

The first writes `tests/reference/rocketpy/monte_carlo.csv`, a row a flight; nested inputs, such as a motor's, are found
by their names in `rocketpy.yaml`. The second adopts that table and compares.
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
THEIRS = (
    Path(__file__).parents[1] / "results" / "others_rocketpy_theirs.json"
)  # by benchmarks.others.rocketpy_monte_carlo


def read_lines(path: Path) -> list[dict[str, Any]]:
    """RocketPy's lines of JSON, in the order of their index: its workers write as they are done."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return sorted(lines, key=lambda line: line["index"])


def find_values(held: Any) -> Iterator[tuple[str, Any]]:
    """Every number in a line by its own name, at any depth, the outermost first."""
    if isinstance(held, dict):
        yield from held.items()
        for value in held.values():
            yield from find_values(value)
    elif isinstance(held, list):
        for value in held:
            yield from find_values(value)


def write_table(base: Path) -> None:
    """A row for each flight: the inputs and metrics of the campaign."""
    model = read_campaign(CAMPAIGN).model
    inputs, outputs = (
        read_lines(base.with_name(f"{base.name}.{kind}.txt")) for kind in ("inputs", "outputs")
    )
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["flight", *model.inputs, *model.metrics])
        for number, (given, returned) in enumerate(zip(inputs, outputs, strict=True)):
            known = dict(reversed([*find_values(given)])) | returned
            writer.writerow(
                [number, *(f"{known[name]:.12g}" for name in (*model.inputs, *model.metrics))]
            )


def adopt() -> list[dict[str, Any]]:
    """Adopt the table; for each required metric what RocketPy says of it (stored numbers), and what the report says."""
    with tempfile.TemporaryDirectory() as place:
        words = ["import", "flights", str(TABLE), "--campaign", str(CAMPAIGN), "-o", place]
        subprocess.run([sys.executable, "-m", "abhv_mc", *words], capture_output=True, check=True)
        report = json.loads((Path(place) / "report.json").read_text(encoding="utf-8"))
    theirs = json.loads(THEIRS.read_text(encoding="utf-8"))
    rows = []
    for metric, said in theirs.items():
        quantiles = report["metrics"]["table"][metric]["controllers"]["rocket"]["quantiles"]
        drivers = report["drivers"]["controllers"]["rocket"]["metrics"][metric]["parameters"]
        ours = {
            share: quantiles[name] for share, name in (("0.5", "q50"), ("0.05", "q95"))
        }  # the 95 % towards bad
        rows.append(
            {
                "metric": metric,
                "theirs": said,
                "ours": {
                    share: [one[key] for key in ("value", "low", "high")]
                    for share, one in ours.items()
                },
                "drivers": [one["parameter"] for one in drivers if one["driver"]],
            }
        )
    return rows


def describe(row: dict[str, Any]) -> str:
    """A row of the page's table."""
    words = [row["metric"]]
    for said in (row["theirs"], row["ours"]):
        for share in ("0.5", "0.05"):
            value, low, high = said[share]
            words.append(f"{value:.2f} ({low:.2f} .. {high:.2f})")
    shares = sorted(row["theirs"]["variance"].items(), key=lambda one: -one[1])
    words.append(
        ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares if share >= 0.01)
    )
    words.append(", ".join(row["drivers"]))
    return f"| {' | '.join(words)} |"


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
