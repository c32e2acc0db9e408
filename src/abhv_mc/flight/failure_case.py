"""What failed in a flight, in words: the case that verdicts and envelopes are shown for."""

from collections.abc import Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.kernel.plant.parameter_names import FAILURE_TIMES

NO_FAILURE = "none"
UNSTART = "engine unstart"  # by the vehicle's own condition, at no drawn time
_ENGINE = "failure.engine"  # begins the names of an engine's failure
_KINDS = {"time": "failed", "stuck_time": "stuck", "loss_time": "loss", "slow_time": "slow"}


def failure_words(name: str) -> str:
    """'elevator stuck' for the parameter 'failure.elevator.stuck_time'."""
    parts = name.split(".")
    what = parts[-2].replace("_", " ")
    if parts[1] == "sensor":
        return f"{what} sensor"
    return f"{what} {_KINDS[parts[-1]]}"


def failure_cases(
    names: Sequence[str], samples: Floats, end_time: Floats, engine_failed: Floats
) -> list[str]:
    """The case of each flight: every failure before the mission's end (s, [flight]), joined by ' + ', or ``none``.

    A failure that was to come after the flight was lost counts too, so that all controllers have the same flights in
    each case. An engine that failed, for ``engine_failed`` s, at no drawn time did so by the vehicle's own condition.
    """
    cases: dict[int, list[str]] = {}
    timed = np.zeros(len(end_time), dtype=np.bool_)
    for i, name in enumerate(names):
        if name in FAILURE_TIMES:
            came = samples[:, i] < end_time
            timed |= came if name.startswith(_ENGINE) else False
            for flight in np.flatnonzero(came).tolist():
                cases.setdefault(flight, []).append(failure_words(name))
    for flight in np.flatnonzero((engine_failed > 0.0) & ~timed).tolist():
        cases.setdefault(flight, []).append(UNSTART)
    return [
        " + ".join(cases[flight]) if flight in cases else NO_FAILURE
        for flight in range(len(end_time))
    ]


def failure_times(names: Sequence[str], samples: Floats) -> Floats:
    """Time of the first drawn failure of each flight, s; infinite without one."""
    columns = [i for i, name in enumerate(names) if name in FAILURE_TIMES]
    return samples[:, columns].min(axis=1, initial=np.inf)
