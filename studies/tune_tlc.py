"""Section 6 of Zhu and Shen (2014) repeated for TLC: writes docs/tuning.md and docs/images/tuning_*.png.

    python studies/tune_tlc.py [--vehicle FILE]

1. Damping from 0.707 upwards, all channels of the inner loops (3 and 4), then of the outer ones (1 and 2).
2. Bandwidths: every loop at 1/3 to 3 times Table 1, one at a time: how much the results depend on each. Outer
   bandwidths stay below inner ones, as `abhv-mc validate` demands with a warning.
3. Differentiators: that of sub-loop 3 from zero upwards, that of sub-loop 4 at 3, 4 and 5 times it, until a clear
   oscillation is seen: a surface that makes MANY swings of more than SWING between one step of the bank and the next.

Flights are the nominal S and the corners of the paper's dispersions; numbers are means over them.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ERRORS, ROOT, Bench, Floats, columns, corner_parameters, wrapped
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.control.controller_file import TlcController
from abhv_mc.control.profile import step_times
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.signals import CHANNEL_INDEX
from abhv_mc.report.figures.style import CYCLE, new_figure, styled, write_png

INNER = tuple(f"attitude.{name}" for name in ("angle_of_attack", "sideslip", "bank")) + tuple(
    f"rates.{name}" for name in ("roll_rate", "pitch_rate", "yaw_rate")
)
OUTER = ("altitude", *(f"velocity.{name}" for name in ("flight_path_angle", "heading", "speed")))
ORDERED = (  # outer, inner
    ("altitude", "velocity.flight_path_angle"),
    ("velocity.flight_path_angle", "attitude.angle_of_attack"),
    ("velocity.heading", "attitude.bank"),
    ("attitude.angle_of_attack", "rates.pitch_rate"),
    ("attitude.sideslip", "rates.yaw_rate"),
    ("attitude.bank", "rates.roll_rate"),
)
DAMPINGS = (0.707, 1.0, 1.4, 2.0, 2.4, 3.4, 4.8)
FACTORS = (1.0 / 3.0, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
RATIOS = (3.0, 4.0, 5.0)
DIFFERENTIATORS = (
    0.0,
    0.1,
    0.2,
    0.3,
    0.5,
    0.8,
    1.2,
    2.0,
    3.0,
    5.0,
    8.0,
    12.0,
    16.0,
    20.0,
    30.0,
)  # rad/s, of sub-loop 3
SWING, MANY = 0.5, 6  # deg; Table 1 makes 5 on the nominal vehicle: the step itself, and the way back
SURFACES = ("aileron", "rudder", "elevator")
SHOWN = (*ERRORS, "aileron_travel_deg", "rudder_travel_deg", "elevator_travel_deg")
HEADS = ("altitude m", "speed m/s", "heading deg", "alpha deg", "bank deg", "beta deg", "aileron", "rudder", "elevator")


class Tuning:
    """Flights of TLC with gains that change from Table 1's."""

    def __init__(self, vehicle: Path) -> None:
        mission = ROOT / "configs/mission/s_manoeuvre.yaml"
        self.bench, self.parameters = Bench(vehicle, mission), corner_parameters()
        self.steps = step_times(self.bench.mission)

    def controller(self, changes: dict[str, float]) -> TlcController:
        """Table 1 with other numbers: 'attitude.bank.damping', 'differentiators.rates', ..."""
        data: dict[str, Any] = self.bench.table_1.model_dump(mode="json")
        for path, value in changes.items():
            *parts, last = path.split(".")
            place = data
            for part in parts:
                place = place[part]
            place[last] = value if last == "damping" else f"{value!r} rad/s"
        return TlcController.model_validate_json(json.dumps(data))

    def fly(self, changes: dict[str, float]) -> tuple[Floats, int] | None:
        """Means of SHOWN, and the most swings of a surface between two steps; None where a flight ends early."""
        block = self.bench.fly_tlc(self.controller(changes), self.parameters, record_every=2)
        if (block.outcome != Outcome.OK).any():
            return None
        first, second = (np.searchsorted(block.times, step - 1e-9) for step in self.steps)
        surfaces = [CHANNEL_INDEX[f"{surface}_deg"] for surface in SURFACES]
        most = max(count_swings(values) for flight in block.history[:, first:second, surfaces] for values in flight.T)
        return columns(block, SHOWN).mean(axis=0), most

    def overshoot(self, changes: dict[str, float]) -> float:
        """By how much the nominal bank passes its own command's extreme after the first step, deg."""
        block = self.bench.fly_tlc(self.controller(changes), self.parameters[:1], record_every=1)
        early = block.times < 8.0
        bank, command = (
            block.history[0, early, CHANNEL_INDEX[name]].astype(np.float64) for name in ("bank_deg", "bank_command_deg")
        )
        return float(np.abs(bank).max() - np.abs(command).max())


def count_swings(values: NDArray[np.float32]) -> int:
    """How often a curve turns back by more than SWING."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values)))) + 1
    count, way = 0, 0
    low = high = float(values[0])
    for value in [*values[turns].tolist(), float(values[-1])]:
        low, high = min(low, value), max(high, value)
        if (way >= 0 and high - value > SWING) or (way <= 0 and value - low > SWING):
            way = -1 if high - value > SWING and way >= 0 else 1
            low = high = value
            count += 1
    return count


def cells(numbers: Floats) -> str:
    """A row's numbers to three digits."""
    return " | ".join(f"{number:.3g}" for number in numbers)


def damping_rows(tuning: Tuning) -> Iterator[str]:
    """A row for each damping of the inner and of the outer loops."""
    for words, channels in (("inner, 3 and 4", INNER), ("outer, 1 and 2", OUTER)):
        for damping in DAMPINGS:
            changes = {f"{channel}.damping": damping for channel in channels}
            flown = tuning.fly(changes)
            if flown is None:
                yield f"| {words} | {damping:g} | a flight ends early |" + " |" * (len(SHOWN) + 1)
                continue
            yield f"| {words} | {damping:g} | {tuning.overshoot(changes):.2f} | {flown[1]} | {cells(flown[0])} |"


def bandwidth_of(tuning: Tuning, channel: str) -> float:
    """Table 1's bandwidth, or that of a differentiator, rad/s."""
    value: Any = tuning.bench.table_1
    for part in channel.split("."):
        value = getattr(value, part)
    return float(value if channel.startswith("differentiators") else value.bandwidth)


def key_of(channel: str) -> str:
    """The place of a bandwidth in the controller file."""
    return channel if channel.startswith("differentiators") else f"{channel}.bandwidth"


def sensitivities(tuning: Tuning) -> dict[str, list[tuple[Floats, int] | None]]:
    """For each bandwidth of TLC, the flights at FACTORS times Table 1."""
    channels = (*OUTER, *INNER, "differentiators.attitude", "differentiators.rates")
    return {
        channel: [
            tuning.fly({key_of(channel): factor * bandwidth_of(tuning, channel)}) if factor != 1.0 else tuning.fly({})
            for factor in FACTORS
        ]
        for channel in channels
    }


def sensitivity_rows(tuning: Tuning, found: dict[str, list[tuple[Floats, int] | None]]) -> Iterator[str]:
    """Each bandwidth's row: the errors at half and at twice the bandwidth over those of Table 1."""
    half, twice, one = FACTORS.index(0.5), FACTORS.index(2.0), FACTORS.index(1.0)
    for channel, flown in found.items():
        base = flown[one]
        if base is None:
            raise SystemExit("Table 1 does not fly this vehicle")
        texts = []
        for i in range(len(SHOWN)):
            pair = [
                f"{flight[0][i] / base[0][i]:.2f}" if flight else "ends early" for flight in (flown[half], flown[twice])
            ]
            texts.append(" / ".join(pair))
        yield f"| {channel.replace('_', ' ')} | {bandwidth_of(tuning, channel):g} | {' | '.join(texts)} |"


def order_rows(tuning: Tuning) -> Iterator[str]:
    """A row for each pair of an outer and an inner channel, the inner one slowed to the outer one's bandwidth."""
    for outer, inner in ORDERED:
        changes = {key_of(inner): bandwidth_of(tuning, outer)}
        if len(tuning.controller(changes).warnings()) <= len(tuning.bench.table_1.warnings()):
            raise SystemExit(f"{inner} as slow as {outer}, and no warning")
        flown = tuning.fly(changes)
        names = f"{inner} = {outer}".replace("_", " ")
        start = f"| {names} | {bandwidth_of(tuning, outer):g} |"
        yield (
            f"{start} {flown[1]} | {cells(flown[0])} |"
            if flown
            else f"{start} a flight ends early |" + " |" * len(SHOWN)
        )


def differentiator_rows(tuning: Tuning) -> tuple[list[str], dict[float, list[tuple[float, int]]], dict[float, float]]:
    """Rows, (bandwidth, swing) for each ratio, and the largest bandwidth of sub-loop 3 without an oscillation."""
    rows: list[str] = []
    curves: dict[float, list[tuple[float, int]]] = {}
    largest: dict[float, float] = {}
    for ratio in RATIOS:
        curves[ratio] = []
        largest[ratio] = 0.0
        calm = True
        for bandwidth in DIFFERENTIATORS:
            at = max(bandwidth, 1e-6)  # the file wants a positive one
            flown = tuning.fly({"differentiators.attitude": at, "differentiators.rates": ratio * at})
            if flown is None:
                rows.append(
                    f"| {ratio:g} | {bandwidth:g} | {ratio * bandwidth:g} | a flight ends early |" + " |" * len(SHOWN)
                )
                calm = False
                continue
            calm = calm and flown[1] < MANY
            if calm:
                largest[ratio] = bandwidth
            curves[ratio].append((bandwidth, flown[1]))
            rows.append(f"| {ratio:g} | {bandwidth:g} | {ratio * bandwidth:g} | {flown[1]} | {cells(flown[0])} |")
    return rows, curves, largest


@styled
def plot_sensitivities(found: dict[str, list[tuple[Floats, int] | None]]) -> Figure:
    """Errors over the factor on each bandwidth."""
    figure = new_figure(5.2)
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    for i, (axes, head) in enumerate(zip(grid.ravel(), HEADS, strict=False)):
        for j, (channel, flown) in enumerate(found.items()):
            base = flown[FACTORS.index(1.0)]
            ratios = [flight[0][i] / base[0][i] if flight and base else np.nan for flight in flown]
            style = ("-", "--")[j // len(CYCLE) % 2]
            axes.plot(FACTORS, ratios, style, color=CYCLE[j % len(CYCLE)], label=channel.replace("_", " "))
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(FACTORS, [f"{factor:.2g}" for factor in FACTORS])
        axes.set_yticks((0.25, 0.5, 1.0, 2.0, 4.0), ("0.25", "0.5", "1", "2", "4"))
        axes.minorticks_off()
        axes.set_title(f"{head.rsplit(' ', 1)[0]} error")
    for axes in grid[-1]:
        axes.set_xlabel("bandwidth over Table 1's")
    for axes in grid[:, 0]:
        axes.set_ylabel("rms over Table 1's")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=6.5)
    return figure


@styled
def plot_differentiators(curves: dict[float, list[tuple[float, int]]]) -> Figure:
    """Swings over the bandwidth of sub-loop 3's differentiator."""
    figure = new_figure(2.4, 5.0)
    axes = figure.subplots()
    for color, (ratio, points) in zip(CYCLE, curves.items(), strict=False):
        x, y = np.array([point for point in points if point[0] > 0.0]).T
        axes.plot(x, y, "o-", color=color, markersize=3.0, label=f"sub-loop 4 at {ratio:g} times")
    axes.axhline(MANY, color="black", linewidth=0.7, linestyle=":")
    axes.axvline(0.3, color="black", linewidth=0.7, linestyle="--")
    axes.set_xscale("log")
    axes.margins(0.05, 0.1)
    axes.set_xlabel("differentiator of sub-loop 3 (rad/s); dashed: the paper's")
    axes.set_ylabel(f"swings over {SWING:g} deg")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def header(first: Sequence[str], units: bool = True) -> list[str]:
    """A table's head: columns, then errors (rms) and surface travel; without units where they are ratios."""
    errors, travels = HEADS[: len(ERRORS)], [f"{name} travel deg" for name in HEADS[len(ERRORS) :]]
    names = (*first, *((*errors, *travels) if units else (name.rsplit(" ", 1)[0] for name in (*errors, *travels))))
    return ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]


def page(tuning: Tuning, vehicle: str) -> tuple[str, dict[str, Figure]]:
    """The page and its figures."""
    found = sensitivities(tuning)
    rows, curves, largest = differentiator_rows(tuning)
    worst = {
        head: max(
            (max(flight[0][i] / flown[FACTORS.index(1.0)][0][i] for flight in flown if flight), channel)  # type: ignore[index]
            for channel, flown in found.items()
        )
        for i, head in enumerate(HEADS[: len(ERRORS)])
    }
    swings = ", ".join(f"{bandwidth:g} rad/s at ratio {ratio:g}" for ratio, bandwidth in largest.items())
    leads = "; ".join(
        f"{head.rsplit(' ', 1)[0]} on {channel.replace('_', ' ')} ({ratio:.1f} times)"
        for head, (ratio, channel) in worst.items()
    )
    dampings = list(damping_rows(tuning))
    calmest = min(d for d in DAMPINGS if tuning.overshoot({f"{channel}.damping": d for channel in INNER}) <= 0.0)

    def change(high: float, low: float, column: int) -> str:
        """By how much a mean of SHOWN changes between two bandwidths of sub-loop 3's differentiator, percent."""
        ends = [
            tuning.fly({"differentiators.attitude": max(at, 1e-6), "differentiators.rates": max(5.0 * at, 1e-6)})
            for at in (low, high)
        ]
        if ends[0] is None or ends[1] is None:
            return "an early end"
        return f"{100.0 * (ends[1][0][column] / ends[0][0][column] - 1.0):+.0f} %".replace("-", "\N{MINUS SIGN}")

    surfaces = tuning.bench.vehicle.constants.surface_bandwidth
    lines = [
        "# Tuning TLC",
        "",
        f"Made by `studies/tune_tlc.py`: section 6 of the paper repeated on `{vehicle}`, the S, nominal and four "
        "corners of the paper's dispersions; errors are rms, means over the five flights. The rest is Table 1.",
        "",
        "## Damping, from 0.707 upwards",
        "",
        "All channels of the loops named. Overshoot: by how much the nominal bank passes its command's extreme after "
        f"the first step. Swings: how often, at most, a surface turns back by more than {SWING:g} deg between the two "
        f"steps; from {MANY} on it is called an oscillation. Of the inner dampings tried, {calmest:g} is the smallest "
        "whose bank does not pass its command; Table 1 has 3.4.",
        "",
        *header(("loops", "damping", "overshoot deg", "swings")),
        *dampings,
        "",
        "## Outer bandwidths below inner ones",
        "",
        "`abhv-mc validate` warns where an outer bandwidth is not below the inner one that it relies on. Table 1 gets "
        f"{len(tuning.bench.table_1.warnings()) or 'no'} warnings. Each row makes one inner bandwidth equal to the "
        "outer one and is warned of:",
        "",
        *header(("inner = outer", "rad/s", "swings")),
        *order_rows(tuning),
        "",
        "## Differentiators: up to the onset of oscillation",
        "",
        "The bandwidth of sub-loop 3's from zero, that of sub-loop 4's at 3, 4 and 5 times it, as the paper raises "
        f"them. The largest of sub-loop 3's without an oscillation among those tried: {swings}; sub-loop 4's is then "
        f"near the {surfaces:g} rad/s of the surfaces. The paper's choice, 0.3 at ratio 5, is far below. At "
        f"ratio 5, 2 rad/s instead of zero changes the angle-of-attack error by {change(2.0, 0.0, 3)}, the bank error "
        f"by {change(2.0, 0.0, 4)} and the elevator's travel by {change(2.0, 0.0, 8)}; 8 instead of 2 rad/s changes "
        f"them by {change(8.0, 2.0, 3)}, {change(8.0, 2.0, 4)} and {change(8.0, 2.0, 8)}. These flights have no sensor "
        "noise, which speaks against a large bandwidth first.",
        "",
        *header(("ratio", "sub-loop 3 rad/s", "sub-loop 4 rad/s", "swings")),
        *rows,
        "",
        "![Swings over the differentiator's bandwidth](images/tuning_differentiators.png)",
        "",
        "## How much depends on each bandwidth",
        "",
        "One bandwidth at a time, half / twice Table 1's: the errors and the travel over those of Table 1. Where a "
        "factor of 3 either way makes an error largest: " + leads + ".",
        "",
        *header(("bandwidth", "Table 1 rad/s"), units=False),
        *sensitivity_rows(tuning, found),
        "",
        "![Errors over the bandwidths](images/tuning_sensitivity.png)",
        "",
    ]
    figures = {"tuning_differentiators": plot_differentiators(curves), "tuning_sensitivity": plot_sensitivities(found)}
    return "\n".join(wrapped(line) for line in lines), figures


def main() -> None:
    """Fly and write."""
    parser = argparse.ArgumentParser(description="Repeat section 6 of the paper.")
    parser.add_argument("--vehicle", type=Path, default=ROOT / "configs/vehicle/ghame_x.yaml")
    arguments = parser.parse_args()
    text, figures = page(Tuning(arguments.vehicle), arguments.vehicle.stem)
    folder = ROOT / "docs/images"
    folder.mkdir(exist_ok=True)
    for name, figure in figures.items():
        write_png(figure, folder / f"{name}.png")
    (ROOT / "docs/tuning.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
