"""Time, memory and disk of ``abhv-mc run`` and ``abhv-mc report`` by number of flights.

    python -m benchmarks.growth [--flights 100 1000] [--repeats 3] [--controllers tlc] [--million]

Every command is run in new processes with one worker per core. The campaign stores the metrics of
all flights, the envelopes and the histories of the worst 20. A line is fitted to each quantity by
relative deviations. The results are written to ``benchmarks/results/growth.json``,
``docs/images/growth.png`` and a table of ``docs/explanation/performance.md``.

``--million`` measures 1e4, 1e5 and 1e6 flights of the first 2 s of the manoeuvre instead, which is
the cost of a campaign without simulation. The results are written to
``benchmarks/results/million.json`` and ``benchmarks/results/million.md``.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.document import replace_part, write_json
from benchmarks.processes import measure_disk, run_command
from benchmarks.spread import PROCESSES, Spread, describe_machine, find_spreads, read_count

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "campaigns" / "harder_vehicle.yaml"
MISSION = ROOT / "configs" / "mission" / "s_manoeuvre.yaml"
RESULTS = ROOT / "benchmarks" / "results"
FIGURE = ROOT / "docs" / "images" / "growth.png"
DOCUMENT = ROOT / "docs" / "explanation" / "performance.md"

MILLION = [10_000, 100_000, 1_000_000]
SHORT = 2  # s, duration of flights with --million
QUANTITIES = {  # name: (label, unit, unit of a thousandth)
    "run_s": ("run", "s", "ms"),
    "report_s": ("report", "s", "ms"),
    "run_memory_mb": ("peak memory of run", "MB", "kB"),
    "report_memory_mb": ("peak memory of report", "MB", "kB"),
    "disk_mb": ("disk, without the report", "MB", "kB"),
}

Series = dict[str, list[float]]  # quantity -> value of each size
Lines = dict[str, dict[str, float]]  # quantity -> intercept, slope, largest_deviation


def measure(campaign: Path, flights: int, controllers: str) -> dict[str, float]:
    """Measure a campaign of ``flights`` flights of each controller, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out")
        command = ("run", str(campaign), "--output", out, "--runs", str(flights), "--no-report")
        run = run_command(*command, "--controllers", controllers)
        disk = measure_disk(Path(out))
        report = run_command("report", out)
    return {
        "run_s": run.seconds,
        "report_s": report.seconds,
        "run_memory_mb": run.memory_mb,
        "report_memory_mb": report.memory_mb,
        "disk_mb": disk,
    }


def measure_all(
    campaign: Path, flights: list[int], controllers: str, repeats: int
) -> dict[str, list[Spread]]:
    """Return the spread of each quantity over the repeated campaigns, for each size."""
    spreads: dict[str, list[Spread]] = {name: [] for name in QUANTITIES}
    for count in flights:
        campaigns = []
        for _ in range(repeats):
            campaigns.append(measure(campaign, count, controllers))
            print(
                count,
                {name: round(value, 3) for name, value in campaigns[-1].items()},
                file=sys.stderr,
                flush=True,
            )
        for name, spread in find_spreads(campaigns).items():
            spreads[name].append(spread)
    return spreads


def write_short_campaign(folder: Path) -> Path:
    """Write the default campaign with a mission of ``SHORT`` seconds, and return its path."""
    mission = MISSION.read_text(encoding="utf-8")
    campaign = CAMPAIGN.read_text(encoding="utf-8")
    short = mission.replace("duration: 60 s", f"duration: {SHORT} s")
    if short == mission or "../configs/mission/s_manoeuvre.yaml" not in campaign:
        raise RuntimeError(
            "the default campaign or its mission has changed and cannot be shortened"
        )
    (folder / "mission.yaml").write_text(short, encoding="utf-8")
    campaign = campaign.replace("../configs/mission/s_manoeuvre.yaml", "mission.yaml")
    path = folder / "campaign.yaml"
    path.write_text(
        campaign.replace("../configs/", f"{ROOT.as_posix()}/configs/"), encoding="utf-8"
    )
    return path


def fit_line(flights: list[int], values: list[float]) -> dict[str, float]:
    """Return intercept, slope and largest deviation of a fit by relative residuals."""
    import numpy as np

    slope, intercept = np.polyfit(flights, values, 1, w=1.0 / np.asarray(values))
    worst = max(
        abs(v / (intercept + slope * n) - 1.0) for n, v in zip(flights, values, strict=True)
    )
    return {"intercept": float(intercept), "slope": float(slope), "largest_deviation": float(worst)}


def describe_slope(name: str, line: dict[str, float]) -> str:
    """Return the slope as text in the unit of a single flight."""
    return f"{1e3 * line['slope']:.3g} {QUANTITIES[name][2]} a flight"


def plot_growth(path: Path, flights: list[int], medians: Series, lines: Lines) -> None:
    """Plot time, memory and disk in three panels, with measured points and fitted lines."""
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from abhv_mc.topics.figure_style import CYCLE, DPI, MARKERS, WIDTH, styled

    @styled
    def plot() -> Figure:
        figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
        FigureCanvasAgg(figure)
        panels: dict[str, tuple[str, ...]] = {
            "time, s": ("run_s", "report_s"),
            "peak memory, MB": ("run_memory_mb", "report_memory_mb"),
            "disk, MB": ("disk_mb",),
        }
        dense = np.geomspace(min(flights), max(flights), 200)
        for axes, (title, names) in zip(figure.subplots(1, 3), panels.items(), strict=True):
            for i, name in enumerate(names):
                line = lines[name]
                what, unit, _ = QUANTITIES[name]
                label = f"{what}:\n{line['intercept']:.3g} {unit} + {describe_slope(name, line)}"
                axes.plot(
                    flights, medians[name], MARKERS[i], color=CYCLE[i], markersize=4, label=label
                )
                axes.plot(dense, line["intercept"] + line["slope"] * dense, color=CYCLE[i])
            axes.set(xscale="log", xlabel="flights", ylabel=title)
            if "memory" in title:
                axes.set_ylim(0.0, 1.6 * axes.get_ylim()[1])  # room for the legend
            else:
                axes.set_yscale("log")
                low, high = axes.get_ylim()
                axes.set_ylim(low / 1.5, high * 8.0)
            axes.legend(loc="upper left", fontsize=6.5)
        return figure

    path.parent.mkdir(parents=True, exist_ok=True)
    plot().savefig(path, dpi=DPI // 2)


def show(value: float) -> str:
    """Return a number with three digits, or as an integer."""
    return f"{value:.3g}" if value < 1e3 else f"{value:,.0f}"


def make_table(flights: list[int], medians: Series, lines: Lines, note: str) -> str:
    """Return the table as Markdown."""
    heads = [f"{what}, {unit}" for what, unit, _ in QUANTITIES.values()]
    table = [note, "", f"| flights | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for i, count in enumerate(flights):
        table.append(f"| {count:,} | {' | '.join(show(medians[name][i]) for name in QUANTITIES)} |")
    fits = [
        f"{lines[name]['intercept']:.3g} + {describe_slope(name, lines[name])}"
        for name in QUANTITIES
    ]
    off = [f"{100.0 * lines[name]['largest_deviation']:.0f} %" for name in QUANTITIES]
    return "\n".join(
        [
            *table,
            f"| fitted line | {' | '.join(fits)} |",
            f"| largest deviation | {' | '.join(off)} |",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", nargs="+", type=int, help="default: 100 1000 10000 100000")
    parser.add_argument(
        "--repeats", type=read_count, default=PROCESSES, help=f"of each size; default: {PROCESSES}"
    )
    parser.add_argument("--controllers", default="tlc")
    parser.add_argument(
        "--million", action="store_true", help=f"flights of {SHORT} s, up to a million"
    )
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    if options.smoke:
        options.flights, options.repeats = [2, 4], 1
    name = "million" if options.million else "growth"
    flights = sorted(
        set(options.flights or (MILLION if options.million else [100, 1000, 10_000, 100_000]))
    )
    load = os.getloadavg()[0]
    run_command(
        "fly", "s_manoeuvre", "--controllers", options.controllers.split(",", maxsplit=1)[0]
    )  # compiles
    with tempfile.TemporaryDirectory() as folder:
        campaign = write_short_campaign(Path(folder)) if options.million else CAMPAIGN
        spreads = measure_all(campaign, flights, options.controllers, options.repeats)
    medians, lowest, highest = (
        {
            quantity: [getattr(spread, end) for spread in sizes]
            for quantity, sizes in spreads.items()
        }
        for end in Spread._fields
    )
    lines = {quantity: fit_line(flights, values) for quantity, values in medians.items()}
    if options.smoke:
        print(lines)
        return

    machine = describe_machine(load)
    seconds = SHORT if options.million else 60
    record: dict[str, Any] = {
        "machine": machine,
        "controllers": options.controllers,
        "flight_s": seconds,
    }
    record |= {"repeats": options.repeats, "flights": flights, "medians": medians, "lines": lines}
    record |= {"lowest": lowest, "highest": highest}
    write_json(RESULTS / f"{name}.json", record)
    if not options.million:
        plot_growth(FIGURE, flights, medians, lines)
    note = (
        f"Flights of {seconds} s. {machine['processor']}, {machine['cores']} cores, load "
        f"{load:.1f} before the start; controllers {options.controllers}; "
        + (
            "one campaign of each size."
            if options.repeats == 1
            else f"medians of {options.repeats} campaigns of each size."
        )
    )
    document = ROOT / "benchmarks/results/million.md" if options.million else DOCUMENT
    replace_part(document, name, make_table(flights, medians, lines, note))


if __name__ == "__main__":
    main()
