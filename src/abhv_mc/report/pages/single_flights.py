"""Files with nominal flights, and texts and figures that explain failed flights."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from abhv_mc.analysis.explain import Explanation
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import grouped_digits
from abhv_mc.report.figures.searches import FLIGHT_PANELS, plot_flights
from abhv_mc.topics.formatting import shown_value
from abhv_mc.topics.topic import Records, controller_label, make_records

_OTHERS = 10  # maximum number of listed other sets of dispersions
_IN_TITLE = 4  # maximum number of dispersions in a title
_TITLE_WIDTH = 100  # maximum number of characters per line of a title
# end of the time axis as a multiple of the last end time if all flights terminate early
_AFTER = 2.0


def explanation_records(explanation: Explanation) -> Records:
    """Return the explanation of a failed flight as records."""
    samples, causes = explanation.samples, explanation.causes
    proof = "no smaller set suffices" if explanation.smallest else "all of these are needed"
    text = (
        f"{len(causes)} of its {len(samples)} dispersions, the others nominal ({proof}; flights "
        f"tried: {grouped_digits(explanation.tried)})"
    )
    flight = f"{explanation.flight} of controller '{explanation.controller}'"
    return make_records(
        [
            ("Flight", f"{flight}: {explanation.failure.words}. {explanation.ended}"),
            ("Fails with", text if causes else "no dispersion: the nominal flight also fails"),
            *(
                ("Causes", f"{name} {shown_value(name, samples[name], explanation.known)}")
                for name in causes
            ),
            *(("Other sets", ", ".join(names)) for names in explanation.others[:_OTHERS]),
            ("Other sets", "..." * (len(explanation.others) > _OTHERS)),
        ]
    )


def explanation_numbers(explanation: Explanation) -> dict[str, Any]:
    """Return the explanation as JSON data, with values in SI units."""
    return {
        "flight": explanation.flight,
        "controller": explanation.controller,
        "failure": explanation.failure.words,
        "causes": {name: explanation.samples[name] for name in explanation.causes},
        "others": [list(names) for names in explanation.others],
        "smallest": explanation.smallest,
        "flights_tried": explanation.tried,
        "dispersions": explanation.samples,
    }


def make_explained_figure(explanation: Explanation) -> Figure:
    """Return a figure of a failed flight, a flight with its causes only, and a nominal flight."""
    names = [
        f"{name}\N{NO-BREAK SPACE}{shown_value(name, explanation.samples[name], explanation.known)}"
        for name in explanation.causes[:_IN_TITLE]
    ]
    unlisted = len(explanation.causes) - len(names)
    listed = ", ".join(names) + (f" and {unlisted} more" if unlisted else "") or "no dispersions"
    heading = (
        f"Flight {explanation.flight} of {controller_label(explanation.controller)} "
        f"{explanation.failure.words}"
    )
    title = f"{heading}\n{textwrap.fill(listed, _TITLE_WIDTH, break_long_words=False)}"
    ends = explanation.block.end_time[1:]
    early = bool((explanation.block.outcome[1:] != Outcome.OK).all())
    until = _AFTER * float(ends.max()) if early else float(ends.max())
    mask = explanation.block.times <= until
    history = explanation.block.history[:, mask].astype(np.float64)
    index = {signal.name: i for i, signal in enumerate(explanation.channels)}
    panels = {label: history[:, :, index[name]] * scale for name, label, scale in FLIGHT_PANELS}
    label = f"only {len(explanation.causes)} of {len(explanation.samples)} dispersions"
    return plot_flights(
        explanation.block.times[mask], panels, ("nominal", label, "all dispersions"), title
    )
