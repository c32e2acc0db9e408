"""Page of `abhv-mc place`, and printed results of `abhv-mc identify`, for test flights."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from abhv_mc.io.messages import counted
from abhv_mc.report.pages.page import Answer
from abhv_mc.search.identify import FIT_RISK, Identification
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
    """Return the page content of `abhv-mc place`."""
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
        first = flight.metrics[0]
        rank = f"{fixed(first.rank, 0)} of {fixed(placement.simulated + 1, 0)}"
        yield (
            flight.name,
            f"{p_equation(flight.p_value)} for {len(flight.metrics)} metrics jointly; least "
            f"{p_equation(first.p_value)}, {first.metric}, rank {rank}",
        )
        if flight.covers is not None:
            exit_text = (
                f"left first by {flight.leaves.channel} at {flight.leaves.time_s:g} s"
                if flight.leaves
                else "not left"
            )
            yield flight.name, f"simultaneous band {exit_text}"
            start, end = flight.covers
            yield (
                flight.name,
                f"record from {start:g} to {end:g} s, clock offset {flight.offset_s:.3g} s",
            )
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
        edges = bands.low, bands.high
        axes.fill_between(placement.times, *edges, color=BLUE, alpha=0.3, linewidth=0, label="band")
        for history in bands.flights:
            axes.plot(placement.times, history, color=INK, linewidth=0.8, label="test flight")
        title_panel(axes, channel)
    label_lowest(grid, count, "time (s)")
    legend_below(figure, grid.flat[0])
    return figure


def make_identify_section(answer: Identification) -> Section:
    """Return the estimates, residuals and fit of an identification."""
    return Section("Summary", (make_records(_identify_texts(answer)),))


def _identify_texts(answer: Identification) -> Iterator[tuple[str, str]]:
    fit = f"{p_equation(answer.p_value)}, rejected below {percent(FIT_RISK)}"
    if answer.converged:
        yield "Model fits" if answer.fits else "Model does not fit", fit
    else:
        yield "Not converged", "the estimates are not the best fit; the fit is not judged"
    for entry in answer.parameters:
        spread = "unknown" if entry.spread is None else significant(entry.spread, 3)
        yield (
            f"{entry.name} ({entry.unit})",
            f"{significant(entry.mean, 4)} (standard error {significant(entry.mean_error, 2)}), "
            f"spread {spread}",
        )
        for unit, value in entry.values.items():
            error = significant(1.96 * entry.errors[unit], 2)
            yield f"{entry.name}, {unit}", f"{significant(value, 4)} +- {error} (95 %)"
    for group, correlation in answer.inseparable:
        yield "Not separable", f"{', '.join(group)} (correlation {correlation:.2f})"
    yield "Nuisances", ", ".join(answer.nuisances)
    yield "Noise (sigma)", _list(answer.noise)
    for flight, residuals in answer.residuals.items():
        offset = f", clock offset {answer.offsets[flight]:.3g} s"
        yield flight, f"residuals (rms, sigmas) {_list(residuals)}{offset}"
    yield "Simulations", f"{answer.simulations} of each flight"


def _list(numbers: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {significant(value, 3)}" for name, value in numbers.items())
