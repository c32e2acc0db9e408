"""Page of `abhv-mc compare` for test flights."""

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from abhv_mc.io.messages import counted
from abhv_mc.report.pages.page import Answer
from abhv_mc.search.place import PlacedFlight, Placement
from abhv_mc.statistics.placement import CONFIDENCE
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
from abhv_mc.topics.topic import (
    Drawn,
    FigureText,
    Item,
    Picture,
    Section,
    Table,
    controller_label,
    make_records,
    make_row,
)

_LISTED = 12  # maximum number of listed metrics per flight
_COLUMNS = 2


def make_place_answer(placement: Placement, folder: Path) -> Answer:
    """Return the page content of `abhv-mc compare` for test flights."""
    items: tuple[Item, ...] = (
        make_records(_texts(placement)),
        Picture("placement"),
        *(_table(flight, placement.simulated) for flight in placement.flights),
    )
    title = f"Test flights and simulated flights of {controller_label(placement.controller)}"
    return Answer(title, f"Validation · {folder.name}", Section("Summary", items), _draw(placement))


def _texts(placement: Placement) -> Iterator[tuple[str, str]]:
    """Yield the labelled results of the tests, and the basis of the comparison."""
    risk, together = 1.0 - CONFIDENCE, placement.together_p_value
    outside = [flight.name for flight in placement.flights if flight.p_value <= risk]
    yield "Covered", ", ".join(f.name for f in placement.flights if f.name not in outside)
    yield "Not covered", ", ".join(outside)
    yield "All test flights", "" if together is None else p_equation(together)
    for flight in placement.flights:
        first, leaves = flight.metrics[0], flight.leaves
        yield (
            flight.name,
            f"{p_equation(flight.p_value)} for {len(flight.metrics)} metrics jointly; least "
            f"{p_equation(first.p_value)}, {first.metric}, rank {first.rank} of "
            f"{placement.simulated + 1}",
        )
        if flight.covers is not None:
            exit_text = f"left first by {leaves.channel} at {leaves.time_s:g} s" if leaves else ""
            yield flight.name, f"simultaneous band {exit_text or 'not left'}"
            record = "record from {:g} to {:g} s".format(*flight.covers)
            yield flight.name, f"{record}, clock offset {flight.offset_s:.3g} s"
    yield NO_BAND, ", ".join(placement.spread)
    yield "Simulated sets", fixed(placement.simulated, 0)
    vehicles = counted(placement.vehicles, "vehicle")
    yield "Test flights", f"{counted(len(placement.flights), 'flight')} of {vehicles}"
    yield "Vary by vehicle", ", ".join(placement.by_vehicle)
    yield "Measured inputs", ", ".join(placement.measured)
    yield "Not covered if", f"p <= {percent(risk)}, corrected for the number of flights"
    yield "Sensor errors added", ", ".join(placement.sensed)
    noise = ", ".join(f"{name} {sigma:g}" for name, sigma in placement.noise.items())
    if not (noise or placement.sensed):
        noise = "none; `--measured NAME=SIGMA` declares it"
    yield "Noise added (sigma)", noise
    yield "Columns ignored", ", ".join(placement.ignored)


def _table(flight: PlacedFlight, simulated: int) -> Table:
    rows = tuple(
        make_row(
            rank.metric,
            significant(rank.value, 4),
            f"{significant(rank.low, 4)} to {significant(rank.high, 4)}",
            f"{rank.rank} of {simulated + 1}",
            p_value(rank.p_value),
        )
        for rank in flight.metrics[:_LISTED]
    )
    heads = ("Metric", "Test flight", "95 % of the simulated flights", "Rank", "p-value")
    return Table(f"Ranks of {flight.name}", heads, (rows,))


def _draw(placement: Placement) -> Iterator[Drawn]:
    if not placement.bands:
        return
    caption = f"The band contains whole histories with a probability of {percent(CONFIDENCE)}."
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
        *edges, flights = bands
        axes.fill_between(placement.times, *edges, color=BLUE, alpha=0.3, linewidth=0, label="band")
        for history in flights:
            axes.plot(placement.times, history, color=INK, linewidth=0.8, label="test flight")
        title_panel(axes, channel)
    label_lowest(grid, count, "time (s)")
    legend_below(figure, grid.flat[0])
    return figure
