"""Report topic: time-history envelopes over all flights, and the range of each channel."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.folder import envelope_states
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.formatting import fixed
from abhv_mc.topics.topic import (
    Fold,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    Widget,
    figures_of,
    make_records,
    make_row,
)

_SIGN = ", sign open"
NO_BAND = "No band where flights spread over the circle"  # resultant length below 0.6


@dataclass(frozen=True)
class Curve:
    """Display settings of one channel on a sheet of time histories."""

    channel: str
    label: str
    reference: str = ""
    off_reference: bool = False  # whether to subtract the reference from the channel
    needles: bool = False  # whether an inset shows the short response to a command step
    # number of the corresponding figure in the paper, and the range of the channel in this figure
    paper: tuple[int, str] | None = None


CURVES = (
    Curve(
        "altitude_m",
        "altitude error (m)",
        "altitude_reference_m",
        off_reference=True,
        paper=(3, "within 50 m"),
    ),
    Curve("speed_mps", "speed (m/s)", "speed_reference_mps", paper=(3, "1400 ± 5 m/s")),
    Curve("heading_deg", "heading (deg)", "heading_reference_deg", paper=(4, "84 to 91 deg")),
    Curve(
        "angle_of_attack_deg",
        "angle of attack (deg)",
        "angle_of_attack_reference_deg",
        paper=(5, "2 to 6 deg"),
    ),
    Curve("sideslip_deg", "sideslip (deg)", needles=True, paper=(6, f"−0.2 to 0.7 deg{_SIGN}")),
    Curve(
        "bank_deg",
        "bank (deg)",
        "bank_reference_deg",
        paper=(7, "−50 to 55 deg with TLC, to 60 with LQR"),
    ),
    Curve("aileron_deg", "aileron (deg)", needles=True, paper=(8, f"−1.2 to 0.8 deg{_SIGN}")),
    Curve("rudder_deg", "rudder (deg)", needles=True, paper=(9, f"−0.4 to 0.3 deg{_SIGN}")),
    Curve("elevator_deg", "elevator (deg)", needles=True, paper=(10, f"−0.5 to 2.5 deg{_SIGN}")),
    Curve(
        "equivalence_ratio_command",
        "throttle (–)",
        "equivalence_ratio_reference",
        paper=(11, "0.8 to 1.25"),
    ),
)


def curves_of(campaign: Experiment) -> tuple[Curve, ...]:
    """Return the curves to draw on the sheet of a campaign's channels.

    A custom simulator has one curve for each channel.
    """
    return (
        CURVES
        if campaign.simulator.mission
        else tuple(Curve(channel.name, channel.axis) for channel in campaign.channels)
    )


@dataclass(frozen=True)
class Envelopes:
    """Smallest and largest value of each channel over flights and time."""

    # smallest and largest value of each channel, by controller and channel
    ranges: Mapping[str, Mapping[str, tuple[float, float]]]
    step_s: float | None  # time between two samples of the bands
    flights: int  # number of flights of each controller, counted from flight 0


def compute_envelopes(results: FlownCampaign) -> Envelopes:
    """Return the range of every computed channel."""
    ranges: dict[str, dict[str, tuple[float, float]]] = {}
    for (controller, channel), envelope in results.envelopes.items():
        low, high = envelope.bands["min"], envelope.bands["max"]
        if not np.isnan(low).all():
            ranges.setdefault(controller, {})[channel] = (
                float(np.nanmin(low)),
                float(np.nanmax(high)),
            )
    times = next(
        (envelope.time for envelope in results.envelopes.values() if envelope.time.size > 1), None
    )
    flown = max(
        (
            int(controller_flights.flight.max(initial=-1)) + 1
            for controller_flights in results.flights.values()
        ),
        default=0,
    )
    flights = min(flown, envelope_states.ENVELOPE_FLIGHTS)
    return Envelopes(ranges, None if times is None else float(times[1] - times[0]), flights)


def envelope_section(model: Envelopes, names: Names) -> Section | None:
    """Return the section on the envelopes of all channels; None if no histories are stored."""
    campaign = names.campaign
    if not campaign.channels:
        return None
    if not campaign.has_bands:
        text = (
            "No envelopes are stored. To store envelopes, add `keep: {envelopes: {rate: 5 Hz}}` to "
            "the campaign file."
        )
        return Section("Time histories", (Text(text),))
    texts = []
    if model.step_s is not None:
        flown = max(flights.flight.size for flights in names.results.flights.values())
        among = "" if model.flights >= flown else f", flights 0 to {model.flights - 1}"
        spacing = f"{model.step_s:.4g} s apart"
        who, ends = "flights still airborne", "at control ticks (of angles, at samples)"
        if campaign.simulator.mission is None:
            who, ends = "flights with a history at that time", "over all returned samples"
            spacing += ", interpolated linearly"
        texts += [
            ("Bands", f"pointwise quantiles over the {who}{among}; single flights may cross them"),
            ("All flights", f"smallest and largest value {ends}; other bands: values {spacing}"),
        ]
        spread = dict.fromkeys(
            channel
            for (_, channel), envelope in names.results.envelopes.items()
            if np.isnan(envelope.median[envelope.count > 0]).any()
        )
        points = len(campaign.unknowns.points)
        unknowns = (
            f"each band extends from the smallest to the largest quantile over {points} points, "
            f"with {model.flights // points} flights at each; the true median lies between the two "
            "median lines; a command is drawn midway between them"
        )
        texts += [(NO_BAND, ", ".join(spread)), ("Unknowns", unknowns if points > 1 else "")]
    of_paper = getattr(campaign.model, "figures", None) == "paper"
    rows = (_row(model, names, curve, of_paper) for curve in curves_of(campaign))
    heads = (
        "Channel",
        *names.controllers.values(),
        *(["Figure", "The paper's single flight"] if of_paper else []),
    )
    table = Table("Smallest and largest value of each channel", heads, (tuple(filter(None, rows)),))
    sheet = Fold("All channels", (table, Picture("channels")))
    return Section("Time histories", (make_records(texts), Widget("bands"), sheet))


def _row(envelopes: Envelopes, names: Names, curve: Curve, of_paper: bool) -> Row:
    """Return a row of a channel's ranges by controller, or () if no range was recorded."""
    ranges = [envelopes.ranges.get(name, {}).get(curve.channel) for name in names.controllers]
    if not any(ranges):
        return ()
    range_texts = [_ends(*ends) if ends else "" for ends in ranges]
    paper = [f"Fig. {curve.paper[0]}", curve.paper[1]] if of_paper and curve.paper else []
    return make_row(curve.label.replace("altitude error", "altitude"), *range_texts, *paper)


def _ends(low: float, high: float) -> str:
    """Return the lower and upper bounds of a range as text, with at most four digits."""
    spread = high - low
    decimals = 2 if spread <= 0.0 else max(0, 2 - len(str(int(spread)))) if spread >= 1.0 else 3
    return f"{fixed(low, decimals)} to {fixed(high, decimals)}"


ENVELOPES = Topic(
    "envelopes", Envelopes, compute_envelopes, envelope_section, figures=figures_of(__name__)
)
