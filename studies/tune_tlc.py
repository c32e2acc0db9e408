"""Repetition of section 6 of Zhu and Shen (2014) for TLC: docs/explanation/tuning.md and figures.

    python studies/tune_tlc.py [--vehicle FILE]

1. Damping from 0.707 upwards, for all channels of the inner loops (3 and 4), then of the outer
   loops (1 and 2), and 0.707 at the crossovers (2 damping bandwidth) of Table 1.
2. Order: inner crossovers equal to the outer ones that rely on them, and half of them; `abhv-mc
   validate` warns of each. For comparison, both are reduced by the same factor.
3. Differentiators: the bandwidth in sub-loop 3 increases from zero, and that in sub-loop 4 is 3, 4
   or 5 times as large, up to a clear oscillation, in which a surface makes MANY swings of more than
   SWING between two steps of the bank. Another flight has noise on the measured angles and rates,
   which limits the bandwidth of a differentiator.
4. Sensitivity: every bandwidth at 1/3 to 3 times Table 1, one at a time.

Numbers are means over the nominal S and the corners of the paper's dispersions.
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
    crossover_of,
    key_of,
)

from abhv_mc.io.messages import joined
from abhv_mc.topics.figure_style import write_png
from abhv_mc_vehicle.kernel.plant.actuator_step import BANDWIDTH

ORDERED = (  # outer, inner
    ("altitude", "velocity.flight_path_angle"),
    ("velocity.flight_path_angle", "attitude.angle_of_attack"),
    ("velocity.heading", "attitude.bank"),
    ("attitude.angle_of_attack", "rates.pitch_rate"),
    ("attitude.sideslip", "rates.yaw_rate"),
    ("attitude.bank", "rates.roll_rate"),
)
DAMPINGS = (0.707, 1.0, 1.4, 2.0, 2.4, 3.4, 4.8)
LISTED_DAMPINGS = {"inner": (0.707, 2.4, 3.4), "outer": (0.707, 3.4)}  # rows of the page
SLOWER = (1.0, 0.5)  # inner over outer crossover
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


LISTED = (0.0, 0.3, 8.0, 12.0, 30.0)  # rows of the page


def cells(numbers: Floats) -> str:
    """Return the numbers of a row with three digits."""
    return " | ".join(f"{number:.3g}" for number in numbers)


def damping_rows(tuning: Tuning) -> Iterator[str]:
    """Yield a row for each damping of the inner and of the outer loops."""
    for loops, channels in (("inner", INNER), ("outer", OUTER)):
        listed = LISTED_DAMPINGS[loops]
        for damping, same in (*((damping, False) for damping in listed), (listed[0], True)):
            changes = {f"{channel}.damping": damping for channel in channels}
            if same:
                changes |= {
                    key_of(channel): crossover_of(tuning, channel) / (2.0 * damping)
                    for channel in channels
                }
            label = f"{loops}, same crossover" if same else loops
            flown = tuning.fly(changes)
            if flown is None:
                yield f"| {label} | {damping:g} | a flight ends early |" + " |" * (len(SHOWN) + 1)
                continue
            yield (
                f"| {label} | {damping:g} | {tuning.overshoot(changes):.2f} | {flown[1]} | "
                f"{cells(flown[0])} |"
            )


def sensitivities(tuning: Tuning) -> dict[str, list[tuple[Floats, int] | None]]:
    """Return the flights at FACTORS times Table 1 for each bandwidth of TLC."""
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


def order_ranges(tuning: Tuning, *, both: bool) -> list[str]:
    """Return the range over pairs of the largest growth of an error, for each factor of SLOWER.

    The inner crossover is reduced, or with ``both`` the outer one by the same factor, too.
    """
    base = tuning.fly({})
    if base is None:
        raise SystemExit("Table 1 does not fly this vehicle")
    ranges = []
    for factor in SLOWER:
        largest = []
        for outer, inner in ORDERED:
            reduced = factor * crossover_of(tuning, outer) / crossover_of(tuning, inner)
            changes = {key_of(inner): reduced * bandwidth_of(tuning, inner)}
            if both:
                changes[key_of(outer)] = reduced * bandwidth_of(tuning, outer)
            known = tuning.bench.table_1.warnings()
            if not both and all(
                warning in known for warning in tuning.controller(changes).warnings()
            ):
                raise SystemExit(f"{inner} as slow as {outer}, and no warning")
            flown = tuning.fly(changes)
            if flown is None:
                raise SystemExit(f"{inner} as slow as {outer} ends a flight early")
            largest.append(float((flown[0] / base[0])[: len(ERRORS)].max()))
        ranges.append(f"{min(largest):.1f} to {max(largest):.1f} times")
    return ranges


def differentiator_rows(
    tuning: Tuning,
) -> tuple[list[str], dict[float, list[tuple[float, int]]], dict[float, float]]:
    """Return rows, (bandwidth, swings) for each ratio, and the largest stable bandwidths.

    These are the bandwidths of sub-loop 3 without an oscillation.
    """
    rows: list[str] = []
    curves: dict[float, list[tuple[float, int]]] = {}
    largest: dict[float, float] = {}
    for ratio in RATIOS:
        curves[ratio] = []
        largest[ratio] = 0.0
        calm = True
        for bandwidth in DIFFERENTIATORS:
            positive = max(bandwidth, 1e-6)  # the file requires a positive bandwidth
            changes = {
                "differentiators.attitude": positive,
                "differentiators.rates": ratio * positive,
            }
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
    """Return the head of a table: columns, then errors (rms) and surface travel."""
    names = (
        *first,
        *(
            head.rsplit(" ", 1)[0] + (" travel" if i >= len(ERRORS) else "")
            for i, head in enumerate(HEADS)
        ),
    )
    return ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]


def page(tuning: Tuning, vehicle: str) -> tuple[str, dict[str, Figure]]:
    """Return the page and its figures."""
    results = sensitivities(tuning)
    rows, curves, largest = differentiator_rows(tuning)
    worst = {
        head: max(
            (
                max(flight[0][i] / flown[FACTORS.index(1.0)][0][i] for flight in flown if flight),
                channel,
            )  # type: ignore[index]
            for channel, flown in results.items()
        )
        for i, head in enumerate(HEADS[: len(ERRORS)])
    }
    swings = joined(
        [f"{bandwidth:g} rad/s (ratio {ratio:g})" for ratio, bandwidth in largest.items()]
    )
    leads = "; ".join(
        f"{head.rsplit(' ', 1)[0]} error {ratio:.1f} times ({channel.replace('_', ' ')})"
        for head, (ratio, channel) in worst.items()
    )
    dampings = list(damping_rows(tuning))
    calmest = min(
        d
        for d in DAMPINGS
        if tuning.overshoot({f"{channel}.damping": d for channel in INNER}) <= 0.0
    )

    ordered, slowed = (order_ranges(tuning, both=both) for both in (False, True))
    surfaces = tuning.bench.vehicle.actuators[0, BANDWIDTH]
    lines = [
        "# Tuning TLC",
        "",
        f"`studies/tune_tlc.py` repeats section 6 of the paper on `{vehicle}` in the S manoeuvre. "
        "Rms errors in m, m/s and deg, and surface travels in deg, are means over the nominal "
        "flight and four corners of the paper's dispersions. Those of alpha and bank refer to the "
        "controller's own command, which the outer loops change. All other parameters are those of "
        "Table 1.",
        "",
        "## Damping, from 0.707 upwards",
        "",
        "The damping of the inner loops (3 and 4) or the outer loops (1 and 2) is changed. "
        '"Overshoot" is that of the nominal bank angle after the first step, and "swings" the most '
        f"reversals of a surface by over {SWING:g} deg between the steps; {MANY} or more are an "
        f"oscillation. The smallest inner damping without overshoot is {calmest:g}; Table 1 has "
        "3.4. Damping also multiplies the crossover, 2 damping bandwidth; two rows have the "
        "crossovers of Table 1.",
        "",
        *header(("loops", "damping", "overshoot", "swings")),
        *dampings,
        "",
        "## Outer bandwidths below inner bandwidths",
        "",
        "`abhv-mc validate` warns if an outer crossover (2 damping bandwidth) is not below the "
        f"inner one. The error that increases most becomes {ordered[0]} as large as with Table 1 "
        f"if an inner crossover is reduced to the outer one, and {ordered[1]} as large if it is "
        f"reduced to half the outer one. If both are reduced by the same factor, so that the order "
        f"is kept, it becomes {slowed[0]} and {slowed[1]} as large: the ratios also contain the "
        "effect of slower loops.",
        "",
        "## Differentiators: up to the onset of oscillation",
        "",
        "The bandwidth of the differentiators of sub-loop 3 is increased from zero, with 3, 4 or 5 "
        "times this bandwidth in sub-loop 4. The largest bandwidths without oscillation are "
        f"{swings}; that of sub-loop 4 is then near the {surfaces:g} rad/s of the actuators. The "
        "paper uses 0.3 rad/s (ratio 5). Noise limits the bandwidth more: the last column (ratio "
        f"5) is the travel of all surfaces with white noise at 100 Hz (rms {NOISE:g} deg on each "
        f"measured angle and {NOISE:g} deg/s on each body rate).",
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
        "## Sensitivity to each bandwidth",
        "",
        "Each bandwidth is varied alone, by a factor of up to 3. The largest increases of the "
        "errors relative to Table 1, with the bandwidth that causes each, are: " + leads + ".",
        "",
        "![Errors over the bandwidths](../images/tuning_sensitivity.png)",
        "",
    ]
    figures = {
        "tuning_differentiators": plot_differentiators(curves),
        "tuning_sensitivity": plot_sensitivities(results),
    }
    return "\n".join(wrapped(line) for line in lines), figures


def main() -> None:
    """Run the flights, and write the page and its figures."""
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
