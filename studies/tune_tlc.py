"""Section 6 of Zhu and Shen (2014) repeated for TLC: writes docs/explanation/tuning.md and docs/images/tuning_*.png.

    python studies/tune_tlc.py [--vehicle FILE]

1. Damping from 0.707 upwards, all channels of the inner loops (3 and 4), then of the outer ones (1 and 2).
2. Order: inner bandwidths as slow as the outer ones that rely on them, and half as slow again; `abhv-mc validate` warns
   of each.
3. Differentiators: that of sub-loop 3 from zero upwards, that of sub-loop 4 at 3, 4 and 5 times it, until a clear
   oscillation is seen: a surface that makes MANY swings of more than SWING between one step of the bank and the next.
   One more flight has noise on the measured angles and rates: what a differentiator is kept slow for.
4. Sensitivity: every bandwidth at 1/3 to 3 times Table 1, one at a time.

Flights are the nominal S and the corners of the paper's dispersions; numbers are means over them.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from experiment import ERRORS, ROOT, Floats, wrapped
from matplotlib.figure import Figure
from tuning_figures import plot_differentiators, plot_sensitivities
from tuning_flights import (
    FACTORS,
    HEADS,
    INNER,
    MANY,
    NOISE,
    OUTER,
    SHOWN,
    SWING,
    Tuning,
    bandwidth_of,
    key_of,
)

from abhv_mc.kernel.plant.actuator_step import BANDWIDTH
from abhv_mc.topics.figure_style import write_png

ORDERED = (  # outer, inner
    ("altitude", "velocity.flight_path_angle"),
    ("velocity.flight_path_angle", "attitude.angle_of_attack"),
    ("velocity.heading", "attitude.bank"),
    ("attitude.angle_of_attack", "rates.pitch_rate"),
    ("attitude.sideslip", "rates.yaw_rate"),
    ("attitude.bank", "rates.roll_rate"),
)
DAMPINGS = (0.707, 1.0, 1.4, 2.0, 2.4, 3.4, 4.8)
SLOWER = (1.0, 0.5)  # inner over outer bandwidth
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


LISTED = (0.0, 0.1, 0.3, 0.8, 2.0, 5.0, 8.0, 12.0, 20.0, 30.0)  # rows of the page


def cells(numbers: Floats) -> str:
    """A row's numbers to three digits."""
    return " | ".join(f"{number:.3g}" for number in numbers)


def damping_rows(tuning: Tuning) -> Iterator[str]:
    """A row for each damping of the inner and of the outer loops."""
    for words, channels in (("inner", INNER), ("outer", OUTER)):
        for damping in DAMPINGS:
            changes = {f"{channel}.damping": damping for channel in channels}
            flown = tuning.fly(changes)
            if flown is None:
                yield f"| {words} | {damping:g} | a flight ends early |" + " |" * (len(SHOWN) + 1)
                continue
            yield f"| {words} | {damping:g} | {tuning.overshoot(changes):.2f} | {flown[1]} | {cells(flown[0])} |"


def sensitivities(tuning: Tuning) -> dict[str, list[tuple[Floats, int] | None]]:
    """For each bandwidth of TLC, the flights at FACTORS times Table 1."""
    channels = (*OUTER, *INNER, "differentiators.attitude", "differentiators.rates")
    return {
        channel: [
            tuning.fly({key_of(channel): factor * bandwidth_of(tuning, channel)})
            if factor != 1.0
            else tuning.fly({})
            for factor in FACTORS
        ]
        for channel in channels
    }


def sensitivity_rows(
    tuning: Tuning, found: dict[str, list[tuple[Floats, int] | None]]
) -> Iterator[str]:
    """Each bandwidth's row: the errors at half/twice the bandwidth over Table 1's; empty if both are within 1 %."""
    half, twice, one = FACTORS.index(0.5), FACTORS.index(2.0), FACTORS.index(1.0)
    for channel, flown in found.items():
        base = flown[one]
        if base is None:
            raise SystemExit("Table 1 does not fly this vehicle")
        texts = []
        for i in range(len(SHOWN)):
            pair = [
                f"{flight[0][i] / base[0][i]:.2f}" if flight else "ends early"
                for flight in (flown[half], flown[twice])
            ]
            texts.append(
                "/".join(pair) if any(text not in ("0.99", "1.00", "1.01") for text in pair) else ""
            )
        yield f"| {channel.replace('_', ' ')} | {bandwidth_of(tuning, channel):g} | {' | '.join(texts)} |"


def order_rows(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """Each row and its warning, for each pair of an outer and an inner channel, the inner one slowed."""
    base = tuning.fly({})
    if base is None:
        raise SystemExit("Table 1 does not fly this vehicle")
    for outer, inner in ORDERED:
        for factor in SLOWER:
            changes = {key_of(inner): factor * bandwidth_of(tuning, outer)}
            warnings = [
                w
                for w in tuning.controller(changes).warnings()
                if w not in tuning.bench.table_1.warnings()
            ]
            if not warnings:
                raise SystemExit(f"{inner} as slow as {outer}, and no warning")
            flown = tuning.fly(changes)
            start = f"| {inner} | {outer} | {factor:g} |".replace("_", " ")
            if flown is None:
                yield f"{start} a flight ends early | |", warnings[0]
                continue
            ratios = (flown[0] / base[0])[: len(ERRORS)]
            most = f"{HEADS[int(ratios.argmax())].rsplit(' ', 1)[0]}, {ratios.max():.1f} times"
            yield f"{start} {flown[1]} | {most} |", warnings[0]


def differentiator_rows(
    tuning: Tuning,
) -> tuple[list[str], dict[float, list[tuple[float, int]]], dict[float, float]]:
    """Rows, (bandwidth, swings) for each ratio, and the largest bandwidth of sub-loop 3 without an oscillation."""
    rows: list[str] = []
    curves: dict[float, list[tuple[float, int]]] = {}
    largest: dict[float, float] = {}
    for ratio in RATIOS:
        curves[ratio] = []
        largest[ratio] = 0.0
        calm = True
        for bandwidth in DIFFERENTIATORS:
            at = max(bandwidth, 1e-6)  # the file wants a positive one
            changes = {"differentiators.attitude": at, "differentiators.rates": ratio * at}
            flown = tuning.fly(changes)
            start = f"| {bandwidth:g} |"
            if flown is None:
                rows.append(f"{start} a flight ends early |" + " |" * (len(SHOWN) + 1))
                calm = False
                continue
            calm = calm and flown[1] < MANY
            if calm:
                largest[ratio] = bandwidth
            curves[ratio].append((bandwidth, flown[1]))
            if ratio == RATIOS[-1] and bandwidth in LISTED:  # the figure has the others
                rows.append(
                    f"{start} {flown[1]} | {cells(flown[0])} | {tuning.noisy_travel(changes):.0f} |"
                )
    return rows, curves, largest


def header(first: Sequence[str]) -> list[str]:
    """A table's head: columns, then errors (rms) and surface travel."""
    names = (
        *first,
        *(
            head.rsplit(" ", 1)[0] + (" travel" if i >= len(ERRORS) else "")
            for i, head in enumerate(HEADS)
        ),
    )
    return ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]


def page(tuning: Tuning, vehicle: str) -> tuple[str, dict[str, Figure]]:
    """The page and its figures."""
    found = sensitivities(tuning)
    rows, curves, largest = differentiator_rows(tuning)
    worst = {
        head: max(
            (
                max(flight[0][i] / flown[FACTORS.index(1.0)][0][i] for flight in flown if flight),
                channel,
            )  # type: ignore[index]
            for channel, flown in found.items()
        )
        for i, head in enumerate(HEADS[: len(ERRORS)])
    }
    swings = ", ".join(
        f"{bandwidth:g} rad/s at ratio {ratio:g}" for ratio, bandwidth in largest.items()
    )
    leads = "; ".join(
        f"{head.rsplit(' ', 1)[0]} on {channel.replace('_', ' ')} ({ratio:.1f} times)"
        for head, (ratio, channel) in worst.items()
    )
    dampings = list(damping_rows(tuning))
    calmest = min(
        d
        for d in DAMPINGS
        if tuning.overshoot({f"{channel}.damping": d for channel in INNER}) <= 0.0
    )

    ordered = list(order_rows(tuning))
    surfaces = tuning.bench.vehicle.actuators[0, BANDWIDTH]
    lines = [
        "# Tuning TLC",
        "",
        f"Section 6 of the paper repeated by `studies/tune_tlc.py` on `{vehicle}`: the S, nominal and at four corners "
        "of the paper's dispersions. Errors are rms in m, m/s and deg, travels in deg, both means over the five "
        "flights. What is not named is Table 1's.",
        "",
        "## Damping, from 0.707 upwards",
        "",
        "The damping of all channels of the inner loops (3 and 4) or of the outer ones (1 and 2). Overshoot: by how "
        "much the nominal bank passes its command after the first step. Swings: how often, at most, a surface turns "
        f"back by more than {SWING:g} deg between the two steps; {MANY} or more count as an oscillation. Of the inner "
        f"dampings tried, {calmest:g} is the smallest without overshoot; Table 1 has 3.4.",
        "",
        *header(("loops", "damping", "overshoot", "swings")),
        *dampings,
        "",
        "## Outer bandwidths below inner ones",
        "",
        "`abhv-mc validate` warns where an outer bandwidth is not below the inner one that it relies on. Table 1 gets "
        f"{len(tuning.bench.table_1.warnings()) or 'no'} warnings. Each row makes one inner bandwidth as slow as the "
        "outer one, or half of it, and is warned of, such as:",
        "",
        f"> {ordered[0][1]}",
        "",
        "| inner | outer | inner / outer | swings | error that grows most, over Table 1's |",
        "|---|---|---|---|---|",
        *(row for row, _ in ordered),
        "",
        "## Differentiators: up to the onset of oscillation",
        "",
        "The bandwidth of sub-loop 3's from zero upwards, sub-loop 4's at 3, 4 and 5 times it. The largest without an "
        f"oscillation among those tried: {swings}; sub-loop 4's is then near the {surfaces:g} rad/s of the surfaces. "
        "The paper's 0.3 at ratio 5 is far below. What speaks against a large bandwidth first is noise: the last "
        f"column is the travel of all surfaces in the nominal flight with white noise of {NOISE:g} deg and deg/s rms "
        "on each measured angle and body rate at 100 Hz. Table at ratio 5:",
        "",
        *(
            line + tail
            for line, tail in zip(
                header(("sub-loop 3, rad/s", "swings")),
                (" with noise |", "---|"),
                strict=True,
            )
        ),
        *rows,
        "",
        "![Swings over the differentiator's bandwidth](../images/tuning_differentiators.png)",
        "",
        "## How much depends on each bandwidth",
        "",
        "One bandwidth at a time: errors and travel at half/twice the bandwidth, over Table 1's; empty where both are "
        "within 1 %. Where a factor of 3 either way makes an error largest: " + leads + ".",
        "",
        *header(("bandwidth", "rad/s")),
        *sensitivity_rows(tuning, found),
        "",
        "![Errors over the bandwidths](../images/tuning_sensitivity.png)",
        "",
    ]
    figures = {
        "tuning_differentiators": plot_differentiators(curves),
        "tuning_sensitivity": plot_sensitivities(found),
    }
    return "\n".join(wrapped(line) for line in lines), figures


def main() -> None:
    """Fly and write."""
    parser = argparse.ArgumentParser(description="Repeat section 6 of the paper.")
    parser.add_argument("--vehicle", type=Path, default=ROOT / "configs/vehicle/ghame_x.yaml")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        print(Tuning(arguments.vehicle).fly({}))
        return
    text, figures = page(Tuning(arguments.vehicle), arguments.vehicle.stem)
    folder = ROOT / "docs/images"
    folder.mkdir(exist_ok=True)
    for name, figure in figures.items():
        write_png(figure, folder / f"{name}.png")
    (ROOT / "docs/explanation/tuning.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
