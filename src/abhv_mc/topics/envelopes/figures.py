"""The channels of a campaign over all flights: which of them each figure shows, and what it says.

A campaign of the paper's experiment (``figures: paper``) has the numbers and the words of Figures 2 to 11 of Zhu & Shen
2014 beside them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.array_types import Floats
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.envelopes.model import Envelopes, range_words
from abhv_mc.topics.figure_bands import EnvelopePanel, EnvelopeRow, off_reference, plot_envelopes, shown_bands
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import FigureText

_SIGN = "The paper does not say which sign is positive; its time is ours plus 180 s."


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
    begins: bool = False  # whether the paper shows its first seconds, too


@dataclass(frozen=True)
class InPaper:
    """A figure of Zhu & Shen 2014."""

    number: int
    shows: str  # what its single flight shows
    mirrored: bool = False  # whether its sign is open


@dataclass(frozen=True)
class ChannelFigure:
    """The bands of one channel, or of two that belong together."""

    name: str
    title: str
    caption: str
    curves: tuple[Curve, ...]
    unit: str
    paper: InPaper

    def text(self, of_paper: bool, here: str = "") -> FigureText:
        """Its words, with the range of its channel ``here``; in the paper's set with what is seen there."""
        name, title, caption = self.name, self.title, self.caption
        if of_paper:
            name, title = f"fig{self.paper.number:02d}_{name}", f"{title} (Fig. {self.paper.number})"
            caption += f"{' ' + _SIGN if self.paper.mirrored else ''} The paper's single flight: {self.paper.shows}."
        text = FigureText(name, title, caption, gallery=True)
        return replace(text, caption=f"{caption} Here: {here}.", alt=f"{here}.") if here else text

    def rows(self, of_paper: bool) -> Iterator[Curve]:
        """Its curves; in the paper's set an angle at its own command also in its first seconds, as there."""
        for curve in self.curves:
            yield curve
            if of_paper and curve.begins:
                yield replace(curve, x_range=(0.0, 8.0), note="first 8 s")


CHANNEL_FIGURES: tuple[ChannelFigure, ...] = (
    ChannelFigure(
        "altitude_speed",
        "Altitude and speed",
        "Altitude less its reference, and speed beside its reference. The altitude error has no band of all flights "
        "where the reference climbs.",
        (
            Curve("altitude_m", "altitude error (m)", "altitude_reference_m", off_reference=True),
            Curve("speed_mps", "speed (m/s)", "speed_reference_mps"),
        ),
        "m/s",
        InPaper(3, "altitude within 50 m, speed 1400 ± 5 m/s"),
    ),
    ChannelFigure(
        "heading",
        "Heading",
        "Heading of the velocity against its reference, clockwise from north.",
        (Curve("heading_deg", "heading (deg)", "heading_reference_deg"),),
        "deg",
        InPaper(4, "84 to 91 deg"),
    ),
    ChannelFigure(
        "angle_of_attack",
        "Angle of attack",
        "Angle of attack beside the command of its own guidance.",
        (Curve("angle_of_attack_deg", "angle of attack (deg)", command="angle_of_attack_command_deg", begins=True),),
        "deg",
        InPaper(5, "2 to 6 deg"),
    ),
    ChannelFigure(
        "sideslip",
        "Sideslip",
        "Sideslip, whose command is zero.",
        (Curve("sideslip_deg", "sideslip (deg)", begins=True),),
        "deg",
        InPaper(6, "−0.2 to 0.7 deg", mirrored=True),
    ),
    ChannelFigure(
        "bank",
        "Bank angle",
        "Bank beside the command of its own guidance.",
        (Curve("bank_deg", "bank (deg)", command="bank_command_deg", begins=True),),
        "deg",
        InPaper(7, "−50 to 55 deg with TLC, to 60 with LQR"),
    ),
    ChannelFigure(
        "aileron",
        "Aileron",
        "Aileron deflection.",
        (Curve("aileron_deg", "aileron (deg)", begins=True),),
        "deg",
        InPaper(8, "−1.2 to 0.8 deg", mirrored=True),
    ),
    ChannelFigure(
        "rudder",
        "Rudder",
        "Rudder deflection.",
        (Curve("rudder_deg", "rudder (deg)", begins=True),),
        "deg",
        InPaper(9, "−0.4 to 0.3 deg", mirrored=True),
    ),
    ChannelFigure(
        "elevator",
        "Elevator",
        "Elevator deflection.",
        (Curve("elevator_deg", "elevator (deg)"),),
        "deg",
        InPaper(10, "−0.5 to 2.5 deg", mirrored=True),
    ),
    ChannelFigure(
        "equivalence_ratio",
        "Throttle command",
        "Commanded throttle; of a scramjet its fuel equivalence ratio.",
        (Curve("equivalence_ratio_command", "throttle (–)", "equivalence_ratio_reference"),),
        "",
        InPaper(11, "0.8 to 1.25"),
    ),
)

GROUND_TRACK = ChannelFigure(
    "ground_track",
    "Ground track",
    "Northward against eastward displacement, and below what is left of it without the reference. The bands at each "
    "moment are drawn at the median displacement east of that moment. Below there is no band of all flights: it spans "
    "what a flight passes in a tenth of a second.",
    (Curve("north_m", "north (km)", "north_reference_m", scale=1e-3),),
    "",
    InPaper(2, "5 km offset"),
)


def _panel(results: FlownCampaign, controller: str, curve: Curve) -> EnvelopePanel | None:
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
        command=scaled(command.time, command.median) if command else None,
    )


def _ground_track(results: FlownCampaign, controller: str) -> tuple[EnvelopePanel, EnvelopePanel] | None:
    """North, and north minus its reference, both against east."""
    north, east = (results.envelopes.get((controller, f"{way}_m")) for way in ("north", "east"))
    if north is None or east is None:
        return None
    flown, reference = results.nominal.get(controller), results.reference
    x = east.median / 1e3

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


def channel_figures(found: Envelopes, labels: Names) -> Iterator[tuple[FigureText, Figure]]:
    """The figures of channels, as far as the envelopes hold them."""
    results, titles = found.source, list(labels.controllers.values())
    names, of_paper = results.controllers, results.campaign.figures == "paper"
    colors = list(controller_colors(names).values())
    tracks = [_ground_track(results, name) for name in names]
    kept = [track for track in tracks if track is not None]
    if len(kept) == len(names):
        rows = [
            EnvelopeRow("north (km)", [track for track, _ in kept], "east (km)"),
            EnvelopeRow("north minus reference (m)", [deviation for _, deviation in kept], "east (km)"),
        ]
        yield GROUND_TRACK.text(of_paper), plot_envelopes(rows, titles, colors)
    for figure in CHANNEL_FIGURES:
        rows = []
        for curve in figure.rows(of_paper):
            panels = [panel for name in names if (panel := _panel(results, name, curve)) is not None]
            if len(panels) == len(names) and np.any([np.isfinite(p.bands["q50"]).any() for p in panels]):
                rows.append(EnvelopeRow(curve.label, panels, x_range=curve.x_range, note=curve.note))
        if rows:
            here = range_words(found, labels, figure.curves[-1].channel, figure.unit)
            yield figure.text(of_paper, here), plot_envelopes(rows, titles, colors)
