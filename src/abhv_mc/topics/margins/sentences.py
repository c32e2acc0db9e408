"""What a report says of a controller's loops."""

from collections.abc import Sequence

import numpy as np

from abhv_mc.topics.margins.model import LISTED, LeastMargins, Margins, least_margins
from abhv_mc.topics.names import Names
from abhv_mc.topics.words import fixed


def margin_sentences(margins: Margins, names: Names) -> Sequence[str]:
    """One of each controller whose loops are known."""
    found = {name: margin_words(margins, name) for name in names.controllers}
    return [f"{names.label(name)}: {words}." for name, words in found.items() if words]


def missing_margins(margins: Margins, names: Names) -> Sequence[str]:
    """Of the flights whose margins could not be computed."""
    said = []
    for name, flights in margins.missing.items():
        listed = ", ".join([*map(str, flights[:LISTED]), *["..."] * (len(flights) > LISTED)])
        said.append(f"margins of {names.label(name)} could not be computed in {len(flights)} flights ({listed})")
    return said


def margin_words(margins: Margins, controller: str) -> str:
    """What is said first of a controller's loops in steady flight; '' where nothing is known."""
    entry = margins.steady.controllers.get(controller)
    if entry is None:
        return ""
    if entry.fault is not None:
        return f"no margins in steady flight at the mission's start: {entry.fault}"
    together = entry.nominal[-1]
    if not together.stable:
        poles = ", ".join(_pole(*pole) for pole in together.poles if pole[0] > 0.0)
        return f"unstable in steady, level flight (poles at {poles} per second)"
    least = least_margins(margins, controller) or LeastMargins(stable=True)
    words = f"{fixed(least.gain, 1)} dB ({least.gain_loop})" if np.isfinite(least.gain) else "no limit on the gain"
    words += f" and {fixed(least.phase, 0)} deg ({least.phase_loop})" if np.isfinite(least.phase) else ""
    if least.little:
        words = f"little margin in steady, level flight: {words}, where 6 dB and 30 to 45 deg are customary"
    else:
        words = f"least margins in steady, level flight {words}"
    if entry.corners_unstable:
        tried = "corners" if margins.steady.all_corners else "corners, drawn at random,"
        words += f"; unstable at {entry.corners_unstable} of {margins.steady.corners} {tried} of the dispersions"
    return words


def _pole(real: float, imaginary: float) -> str:
    return f"+{real:.3f}" + (f" \N{PLUS-MINUS SIGN} {imaginary:.2f}j" if imaginary else "")
