"""Page that compares test flights with the simulated flights of a campaign."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.analysis.place import CONFIDENCE, PlacedFlight, Placement
from abhv_mc.io.phrases import counted, joined, quoted
from abhv_mc.report.pages.page import Answer
from abhv_mc.topics.envelopes import NO_BAND
from abhv_mc.topics.figure_style import (
    BLUE,
    INK,
    label_lowest,
    legend_below,
    new_panels,
    styled,
    title_panel,
)
from abhv_mc.topics.formatting import fixed, p_equation, p_value, percent, significant
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.section import Bullets, Cell, FigureText, Item, Lead, Picture, Section, Table
from abhv_mc.topics.topic import Drawn

_LISTED = 12  # maximum number of listed metrics per flight
_COLUMNS = 2


def make_place_answer(placement: Placement, folder: Path) -> Answer:
    """Return the page content of `abhv-mc place`."""
    risk = 1.0 - CONFIDENCE
    outside = [flight for flight in placement.flights if _is_outside(flight, risk)]
    names = joined([flight.name for flight in outside])
    number = len(placement.flights)
    tested = "the test flight" if number == 1 else f"each of the {fixed(number, 0)} test flights"
    lead = f"The simulated flights cover {tested}."
    if outside:
        lead = f"The simulated flights do not cover {names}."
    because = []
    if placement.together_p_value is not None:
        verb = "are" if placement.together_p_value <= risk else "are not shown to be"
        because.append(
            f"Together, the test flights {verb} different from the simulated flights "
            f"({p_equation(placement.together_p_value)})."
        )
    items: tuple[Item, ...] = (
        Lead(lead, tuple(because)),
        Bullets((*_sentences(placement), *_remarks(placement))),
        Picture("placement"),
        *(_table(flight, placement.simulated) for flight in placement.flights),
    )
    title = f"Test flights and simulated flights of {controller_label(placement.controller)}"
    return Answer(title, f"Validation · {folder.name}", Section("Summary", items), _draw(placement))


def _is_outside(flight: PlacedFlight, risk: float) -> bool:
    """Return True if metrics or history are outliers; the two tests share ``risk`` equally."""
    p_values = [flight.joint_p_value]
    if flight.band_p_value is not None:
        p_values.append(flight.band_p_value)
    return min(p_values) * len(p_values) <= risk


def _sentences(placement: Placement) -> Iterator[str]:
    for flight in placement.flights:
        first = flight.metrics[0]
        text = (
            f"{flight.name}: the joint p-value of {counted(len(flight.metrics), 'metric')} is "
            f"{p_value(flight.joint_p_value)}; the most unusual metric is '{first.metric}', "
            f"with rank {fixed(first.rank, 0)} of {fixed(placement.simulated + 1, 0)}"
        )
        if flight.joint_p_value <= 1.0 - CONFIDENCE < first.p_value:
            text += "; only the combination of the metrics is unusual"
        if flight.leaves:
            text += (
                f"; '{flight.leaves.channel}' is the first channel to leave the simultaneous band, "
                f"at {flight.leaves.time_s:g} s"
            )
        elif flight.band_p_value is not None:
            text += "; the time histories stay within the simultaneous band"
        if flight.band_p_value is not None:
            text += f" ({p_equation(flight.band_p_value)})"
        yield f"{text}."


def _remarks(placement: Placement) -> Iterator[str]:
    yield (
        f"The test flights are compared with {counted(placement.simulated, 'random flight')}. If "
        "a test flight is a draw from the model, the probability that a p-value is at most "
        f"{percent(1.0 - CONFIDENCE)} does not exceed {percent(1.0 - CONFIDENCE)}, and the "
        "probability that the whole history stays within the simultaneous band is "
        f"{percent(CONFIDENCE)}."
    )
    if placement.sensed:
        yield (
            "Bias, scale and noise of the campaign's sensors were added to simulated channels: "
            f"{quoted(placement.sensed)}."
        )
    if placement.bands and not (placement.noise or placement.sensed):
        yield (
            "No measurement noise is declared, although instrument noise alone can move a test "
            "flight outside the band. Declare noise with `measured: {CHANNEL: SIGMA}` in the "
            "campaign or with `--measured CHANNEL=SIGMA`."
        )
    elif placement.noise:
        noise = joined([f"{sigma:g} in '{channel}'" for channel, sigma in placement.noise.items()])
        yield f"White noise was added to the simulated histories (standard deviation: {noise})."
    if placement.spread:
        yield f"{NO_BAND} {quoted(placement.spread)}."
    if placement.ignored:
        yield (
            "These columns are not compared, because the campaign lacks them: "
            f"{quoted(placement.ignored)}."
        )


def _table(flight: PlacedFlight, simulated: int) -> Table:
    rows = tuple(
        (
            Cell(rank.metric, head=True),
            Cell(significant(rank.value, 4)),
            Cell(f"{significant(rank.low, 4)} to {significant(rank.high, 4)}"),
            Cell(f"{rank.rank} of {simulated + 1}"),
            Cell(p_value(rank.p_value)),
        )
        for rank in flight.metrics[:_LISTED]
    )
    heads = ("Metric", "Test flight", "95 % of the simulated flights", "Rank", "p-value")
    return Table(f"Ranks of {flight.name}", heads, (rows,))


def _draw(placement: Placement) -> Iterator[Drawn]:
    if not placement.bands:
        return
    caption = (
        f"The wide, simultaneous band contains {percent(CONFIDENCE)} of whole histories. The dark, "
        "pointwise band contains the same share of the flights at each time. Lines are test "
        "flights."
    )
    yield (
        FigureText("placement", "Test flights and time-history envelopes", caption),
        plot_placement(placement),
    )


@styled
def plot_placement(placement: Placement) -> Figure:
    """Plot test flights and bands, one panel per channel."""
    count = len(placement.bands)
    figure, grid = new_panels(count, _COLUMNS, 1.1)
    for axes, (channel, bands) in zip(grid.flat, placement.bands.items(), strict=False):
        for edges, opacity, label in (
            (bands.simultaneous, 0.2, "simultaneous"),
            (bands.pointwise, 0.4, "pointwise"),
        ):
            axes.fill_between(
                bands.time, *edges, color=BLUE, alpha=opacity, linewidth=0, label=label
            )
        for history in bands.flights:
            axes.plot(bands.time, history, color=INK, linewidth=0.8, label="test flight")
        finite = np.isfinite(bands.simultaneous[0])
        axes.set_xlim(bands.time[finite].min(), bands.time[finite].max())
        title_panel(axes, channel)
    label_lowest(grid, count, "time (s)")
    legend_below(figure, grid.flat[0])
    return figure
