"""Figures 2 to 11 of Zhu & Shen 2014 from a campaign: which channels each shows, and what it says."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.report.figures.envelopes import EnvelopePanel, EnvelopeRow, plot_envelopes
from abhv_mc.report.figures.style import controller_colors
from abhv_mc.report.numbers.results import Results

_BANDS = (
    "Bands hold at each moment by itself, over the flights that still fly then: all of them (every control tick), "
    "0.135 to 99.865 %, 5 to 95 %; line: median."
)
_SIGN = "The paper plots the mirrored sign (its first bank is positive); its time is ours plus 180 s."


@dataclass(frozen=True)
class Curve:
    """A channel as a figure shows it."""

    channel: str
    label: str
    reference: str = ""
    command: str = ""
    scale: float = 1.0
    x_range: tuple[float, float] | None = None
    note: str = ""
    off_reference: bool = False  # what is left of it without the reference


@dataclass(frozen=True)
class FigureText:
    """A figure's file name and words."""

    name: str  # of the file, without its suffix
    title: str
    caption: str
    paper: str = ""  # what the paper's single flight shows
    channel: str = ""  # whose range over all flights goes with it
    unit: str = ""


@dataclass(frozen=True)
class PaperFigure:
    """One of the paper's figures."""

    text: FigureText
    curves: tuple[Curve, ...]


def _angle_figure(number: str, title: str, caption: str, paper: str, curves: tuple[Curve, ...]) -> PaperFigure:
    """A figure of one angle, named after its channel."""
    channel = curves[0].channel
    name = f"{number}_{channel.removesuffix('_deg')}"
    return PaperFigure(FigureText(name, title, caption, paper, channel, "deg"), curves)


def _begun(curve: Curve) -> tuple[Curve, Curve]:
    """A curve, and below it its first seconds."""
    return curve, replace(curve, x_range=(0.0, 8.0), note="first 8 s")


PAPER_FIGURES: tuple[PaperFigure, ...] = (
    PaperFigure(
        FigureText(
            "fig03_altitude_speed",
            "Altitude and speed (Fig. 3)",
            f"Altitude less its reference, and speed beside its reference. {_BANDS} The altitude "
            "error has no band of all flights where the reference climbs.",
            "altitude within 50 m, speed 1400 ± 5 m/s",
            "speed_mps",
            "m/s",
        ),
        (
            Curve("altitude_m", "altitude error (m)", "altitude_reference_m", off_reference=True),
            Curve("speed_mps", "speed (m/s)", "speed_reference_mps"),
        ),
    ),
    _angle_figure(
        "fig04",
        "Heading (Fig. 4)",
        f"Heading of the velocity against its reference, clockwise from north. {_BANDS}",
        "84 to 91 deg",
        (Curve("heading_deg", "heading (deg)", "heading_reference_deg"),),
    ),
    _angle_figure(
        "fig05",
        "Angle of attack (Fig. 5)",
        f"Angle of attack beside the command of its own guidance; below, the first seconds. {_BANDS}",
        "2 to 6 deg",
        _begun(Curve("angle_of_attack_deg", "angle of attack (deg)", command="angle_of_attack_command_deg")),
    ),
    _angle_figure(
        "fig06",
        "Sideslip (Fig. 6)",
        f"Sideslip, whose command is zero; below, the first seconds. {_BANDS} {_SIGN}",
        "−0.2 to 0.7 deg",
        _begun(Curve("sideslip_deg", "sideslip (deg)")),
    ),
    _angle_figure(
        "fig07",
        "Bank angle (Fig. 7)",
        f"Bank beside the command of its own guidance; below, the first seconds. {_BANDS} {_SIGN}",
        "−55 to 55 deg",
        _begun(Curve("bank_deg", "bank (deg)", command="bank_command_deg")),
    ),
    _angle_figure(
        "fig08",
        "Aileron (Fig. 8)",
        f"Aileron deflection; below, the first seconds. {_BANDS} {_SIGN}",
        "−1.2 to 0.8 deg",
        _begun(Curve("aileron_deg", "aileron (deg)")),
    ),
    _angle_figure(
        "fig09",
        "Rudder (Fig. 9)",
        f"Rudder deflection; below, the first seconds. {_BANDS} {_SIGN}",
        "−0.4 to 0.3 deg",
        _begun(Curve("rudder_deg", "rudder (deg)")),
    ),
    _angle_figure(
        "fig10",
        "Elevator (Fig. 10)",
        f"Elevator deflection. {_BANDS}",
        "−0.5 to 2.5 deg",
        (Curve("elevator_deg", "elevator (deg)"),),
    ),
    PaperFigure(
        FigureText(
            "fig11_equivalence_ratio",
            "Fuel equivalence ratio command (Fig. 11)",
            f"Commanded fuel equivalence ratio. {_BANDS}",
            "0.8 to 1.25",
            "equivalence_ratio_command",
        ),
        (Curve("equivalence_ratio_command", "equivalence ratio (–)", "equivalence_ratio_reference"),),
    ),
)

GROUND_TRACK = FigureText(
    "fig02_ground_track",
    "Ground track (Fig. 2)",
    "Northward against eastward displacement, and below what is left of it without the reference. The bands at each "
    "moment are drawn at the median displacement east of that moment. " + _BANDS + " Below there is no band of all "
    "flights: it spans what a flight passes in a tenth of a second.",
    "5 km offset",
)


def off_reference(x: Floats, y: Floats, time: Floats, reference: Floats | None) -> Floats:
    """A channel [x] s less its reference [time]; as it is without one."""
    return y if reference is None else y - np.interp(x, time, reference)


def shown_bands(bands: Mapping[str, Floats], reference: Floats | None) -> dict[str, Floats]:
    """The bands of a channel that mean something less its reference.

    Minimum and maximum are those of all control ticks between two samples: less a reference that moves meanwhile, they
    would show its way and not the flights' error.
    """
    moves = reference is not None and float(np.ptp(reference)) > 0.0
    return {name: band for name, band in bands.items() if not (moves and name in ("min", "max"))}


def _panel(results: Results, controller: str, curve: Curve) -> EnvelopePanel | None:
    envelope = results.envelopes.get((controller, curve.channel))
    if envelope is None:
        return None
    flown = results.nominal.get(controller)
    command = results.envelopes.get((controller, curve.command)) if curve.command else None

    time = results.reference["time"]
    given = results.reference[curve.reference] if curve.reference else None
    less = given if curve.off_reference else None

    def scaled(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return x, off_reference(x, y, time, less) * curve.scale

    return EnvelopePanel(
        x=envelope.time,
        bands={name: scaled(envelope.time, band)[1] for name, band in shown_bands(envelope.bands, less).items()},
        nominal=scaled(flown["time"], flown[curve.channel]) if flown and curve.channel in flown else None,
        reference=scaled(time, given) if given is not None else None,
        command=scaled(command.time, command.bands["q50"]) if command else None,
    )


def _ground_track(results: Results, controller: str) -> tuple[EnvelopePanel, EnvelopePanel] | None:
    """North, and north minus its reference, both against east."""
    north, east = (results.envelopes.get((controller, f"{way}_m")) for way in ("north", "east"))
    if north is None or east is None:
        return None
    flown, reference = results.nominal.get(controller), results.reference
    x = east.bands["q50"] / 1e3

    given = reference["north_reference_m"]

    def off(time: Floats, metres: Floats) -> Floats:
        return off_reference(time, metres, reference["time"], given)

    track = EnvelopePanel(
        x=x,
        bands={name: band / 1e3 for name, band in north.bands.items()},
        nominal=(flown["east_m"] / 1e3, flown["north_m"] / 1e3) if flown else None,
        reference=(reference["east_reference_m"] / 1e3, reference["north_reference_m"] / 1e3),
    )
    deviation = EnvelopePanel(
        x=x,
        bands={name: off(north.time, band) for name, band in shown_bands(north.bands, given).items()},
        nominal=(flown["east_m"] / 1e3, off(flown["time"], flown["north_m"])) if flown else None,
        reference=(x, np.zeros_like(x)),
    )
    return track, deviation


def paper_figures(results: Results, titles: list[str]) -> Iterator[tuple[FigureText, Figure]]:
    """Figures 2 to 11, as far as the envelopes hold their channels."""
    names = results.controllers
    colors = list(controller_colors(names).values())
    tracks = [_ground_track(results, name) for name in names]
    kept = [track for track in tracks if track is not None]
    if len(kept) == len(names):
        rows = [
            EnvelopeRow("north (km)", [track for track, _ in kept], "east (km)"),
            EnvelopeRow("north minus reference (m)", [deviation for _, deviation in kept], "east (km)"),
        ]
        yield GROUND_TRACK, plot_envelopes(rows, titles, colors)
    for figure in PAPER_FIGURES:
        rows = []
        for curve in figure.curves:
            panels = [panel for name in names if (panel := _panel(results, name, curve)) is not None]
            if len(panels) == len(names) and np.any([np.isfinite(p.bands["q50"]).any() for p in panels]):
                rows.append(EnvelopeRow(curve.label, panels, x_range=curve.x_range, note=curve.note))
        if rows:
            yield figure.text, plot_envelopes(rows, titles, colors)
