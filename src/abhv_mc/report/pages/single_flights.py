"""Single flights: nominal ones in a folder, and an explanation of a failing one as words, JSON and a figure."""

import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from numpy.typing import NDArray

from abhv_mc.analysis.explain import Explanation
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.histories import write_nominal, write_reference
from abhv_mc.io.parquet_columns import column_values
from abhv_mc.report.figures.searches import FLIGHT_PANELS, plot_flights
from abhv_mc.simulators.make_plans import reference_of
from abhv_mc.topics.envelopes.figures import plot_flown
from abhv_mc.topics.figure_style import write_png
from abhv_mc.topics.names import controller_label
from abhv_mc.topics.words import shown_value


def write_nominal_report(
    folder: Path, plans: Mapping[str, FlightPlan], histories: Mapping[str, NDArray[np.float32]]
) -> Iterator[Path]:
    """Write nominal.parquet, reference.parquet and figures/channels.png of histories [tick, channel]; name each."""
    plan = next(iter(plans.values()))
    times = np.arange(plan.timing.ticks + 1).astype(np.float64) * plan.timing.tick
    write_nominal(folder / "nominal.parquet", times, dict(histories))
    yield folder / "nominal.parquet"
    write_reference(folder / "reference.parquet", reference_of(plan, 1))
    yield folder / "reference.parquet"
    flights = {
        name: {"time": times}
        | {channel: history[:, i].astype(np.float64) for channel, i in CHANNEL_INDEX.items()}
        for name, history in histories.items()
    }
    table = pq.ParquetFile(folder / "reference.parquet").read()
    reference = {name: column_values(table[name]) for name in table.column_names}
    picture = folder / "figures" / "channels.png"
    write_png(
        plot_flown(flights, reference, {name: controller_label(name) for name in flights}), picture
    )
    yield picture


_IN_TITLE = 4
_TITLE_WIDTH = 100
_AFTER = 2.0  # how much of the nominal flight is shown, in lengths of flights that ended early


def explanation_words(found: Explanation) -> list[str]:
    """What was found, line by line."""
    total, kept = len(found.samples), len(found.causes)
    lines = [f"flight {found.flight} of {found.controller} {found.failure.words}. {found.ended}"]
    if not kept:
        return [*lines, "The nominal flight fails, too: no dispersion is needed."]
    proof = "no smaller set does" if found.smallest else "none of them can be left out"
    lines.append(
        f"It fails with {kept} of its {total} dispersions alone ({proof}; {found.tried} flights tried):"
    )
    lines += [
        f"  {name:<36} {shown_value(name, found.samples[name], found.known):>12}"
        for name in found.causes
    ]
    if found.others:
        lines.append(f"So do {len(found.others)} other sets of {kept}:")
        lines += [f"  {' and '.join(names)}" for names in found.others[:10]]
        lines += ["  ..."] if len(found.others) > 10 else []
    return lines


def explanation_numbers(found: Explanation) -> dict[str, Any]:
    """The same as JSON holds it, values in SI."""
    return {
        "flight": found.flight,
        "controller": found.controller,
        "failure": found.failure.words,
        "causes": {name: found.samples[name] for name in found.causes},
        "others": [list(names) for names in found.others],
        "smallest": found.smallest,
        "flights_tried": found.tried,
        "dispersions": found.samples,
    }


def make_explained_figure(found: Explanation) -> Figure:
    """The flight as flown and with its causes alone, beside the nominal flight."""
    names = [
        f"{name}\N{NO-BREAK SPACE}{shown_value(name, found.samples[name], found.known)}"
        for name in found.causes[:_IN_TITLE]
    ]
    more = len(found.causes) - len(names)
    listed = ", ".join(names) + (f" and {more} more" if more else "") or "nothing dispersed"
    what = f"Flight {found.flight} of {controller_label(found.controller)} {found.failure.words}"
    title = f"{what}\n{textwrap.fill(listed, _TITLE_WIDTH, break_long_words=False)}"
    ends = found.block.end_time[1:]
    early = bool((found.block.outcome[1:] != Outcome.OK).all())
    until = _AFTER * float(ends.max()) if early else float(ends.max())
    shown = found.block.times <= until
    history = found.block.history[:, shown].astype(np.float64)
    panels = {
        label: history[:, :, CHANNEL_INDEX[name]] * scale for name, label, scale in FLIGHT_PANELS
    }
    kept = f"only {len(found.causes)} of {len(found.samples)} dispersions"
    return plot_flights(found.block.times[shown], panels, ("nominal", kept, "as flown"), title)
