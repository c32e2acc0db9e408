"""Comparison of `abhv-mc rare` with plain sampling of a failure that is not too rare.

    abhv-mc run benchmarks/rare_tail.yaml -o DIR/plain --no-report
    abhv-mc rare benchmarks/rare_tail.yaml --requirement altitude_error_max_m --seed 5 -o DIR/rare
    python benchmarks/rare_against_plain.py DIR/plain DIR/rare [--json FILE] [--figure FILE.png]

The first command runs 200,000 flights. This script compares the share of plain flights that violate
the requirement, with its 95 % interval by Clopper and Pearson, with the estimate and its interval.
It prints their distance in standard deviations of the logarithm of their ratio; the exit code is 1
above 2.58 (1 %). The figure shows the share of flights beyond each limit, and the levels of each
repetition.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from matplotlib.figure import Figure

from abhv_mc.folder.manifest import read_manifest
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.topics.figure_style import (
    BLUE,
    INK,
    MARKERS,
    SKY,
    VERMILION,
    new_figure,
    styled,
    write_png,
)
from abhv_mc_vehicle.flight.metrics import BUILT_IN

_TOO_FAR = 2.58


@styled
def plot_tails(label: str, plain: np.ndarray, result: dict, limit: float) -> Figure:
    """Plot the shares of flights beyond each limit, with intervals, levels and the estimate."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    limits = np.linspace(np.quantile(plain, 0.9), plain.max(), 200)
    beyond = len(plain) - np.searchsorted(np.sort(plain), limits)
    low, high = np.array([clopper_pearson(int(count), len(plain)) for count in beyond]).T
    axes.fill_between(
        limits, low, high, color=SKY, alpha=0.4, linewidth=0.0, label="plain flights, 95 % interval"
    )
    axes.semilogy(limits, beyond / len(plain), color=BLUE, label=f"{len(plain)} plain flights")
    numbers = sorted({level["repetition"] for level in result["levels"]})
    for number in numbers:
        levels = [level for level in result["levels"] if level["repetition"] == number]
        probabilities = np.cumprod([level["probability"] for level in levels])
        label_of_levels = f"levels of {len(numbers)} repetitions" if number == numbers[0] else None
        marker = MARKERS[number % len(MARKERS)]
        axes.plot(
            [limit + level["limit"] for level in levels],
            probabilities,
            marker,
            color=INK,
            markersize=3,
            label=label_of_levels,
        )
    estimate, ends = (
        result["probability"],
        [[result["probability"] - result["low"]], [result["high"] - result["probability"]]],
    )
    axes.errorbar(
        limit, estimate, ends, fmt="o", color=VERMILION, capsize=3, label="rare, 95 % interval"
    )
    axes.set_ylim(bottom=0.2 / len(plain))
    axes.set_xlabel(label)
    axes.set_ylabel("share of flights beyond")
    figure.legend(loc="outside right upper")
    return figure


def fly_both(plain: Path, rare: Path) -> None:
    """Run a few plain flights and a search for rare failures."""
    campaign, program = (
        Path(__file__).with_name("rare_tail.yaml"),
        [sys.executable, "-m", "abhv_mc"],
    )
    run = ["run", str(campaign), "--runs", "64", "-o", str(plain), "--no-report"]
    search = ["rare", str(campaign), "--requirement", "altitude_error_max_m", "-o", str(rare)]
    for arguments in (run, search):
        subprocess.run([*program, *arguments], check=arguments is search)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plain", type=Path, nargs="?")
    parser.add_argument("rare", type=Path, nargs="?")
    parser.add_argument(
        "--smoke", action="store_true", help="both from 64 plain flights, in new folders here"
    )
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.plain, arguments.rare = Path("plain"), Path("rare")
        fly_both(arguments.plain, arguments.rare)
    manifest = read_manifest(arguments.rare / "manifest.json")
    result = manifest.result
    if result["refusal"]:
        raise SystemExit(f"no trustworthy estimate: {result['refusal']}")
    metric, limit = result["requirement"], result["below"]
    blocks = sorted((arguments.plain / "flights").glob("*.parquet"))
    table = [pq.read_table(block, columns=["outcome", metric]) for block in blocks]
    outcomes = np.concatenate(
        [block_table["outcome"].to_numpy(zero_copy_only=False) for block_table in table]
    )
    values = np.concatenate([block_table[metric].to_numpy() for block_table in table])
    values = np.where(outcomes == "ok", values, np.inf)
    failures = int((values >= limit).sum())
    low, high = clopper_pearson(failures, len(values))
    share = failures / len(values)
    spread = np.hypot(
        np.sqrt((1.0 - share) / max(failures, 1)), np.log(result["high"] / result["low"]) / 3.92
    )
    distance = (
        abs(float(np.log(result["probability"] / share))) / float(spread) if failures else np.inf
    )
    numbers = {
        "metric": metric,
        "limit": limit,
        "plain": {
            "flights": len(values),
            "failures": failures,
            "share": share,
            "low": low,
            "high": high,
        },
        "rare": {key: result[key] for key in ("probability", "low", "high", "flights", "failures")},
        "apart": distance,
    }
    print(
        f"plain: {failures} of {len(values)} flights, {share:.3g}, 95 % interval {low:.3g} .. "
        f"{high:.3g}"
    )
    print(
        f"rare:  {result['probability']:.3g}, 95 % interval {result['low']:.3g} .. "
        f"{result['high']:.3g}, {result['flights']} flights"
    )
    print(f"apart by {distance:.2f} standard deviations")
    if arguments.json:
        arguments.json.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    if arguments.figure:
        finite = values[np.isfinite(values)]
        write_png(
            plot_tails(BUILT_IN[metric].label_with_unit, finite, result, limit), arguments.figure
        )
    sys.exit(distance > _TOO_FAR and not arguments.smoke)


if __name__ == "__main__":
    main()
