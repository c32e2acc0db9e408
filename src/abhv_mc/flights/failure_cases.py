"""Failure cases of flights, used to group verdicts and envelopes."""

from collections.abc import Sequence

import numpy as np

from abhv_mc.array_types import Floats

NO_FAILURE = "none"
ENGINE_FAILED = "engine_failed_s"  # metric: time for which an engine has failed
UNSTART = "engine unstart"  # failure case of an engine that failed because its inlet unstarted
_ENGINE = "failure.engine"  # prefix of the names of engine failures
_KINDS = {"time": "failed", "stuck_time": "stuck", "loss_time": "loss", "slow_time": "slow"}


def is_failure_time(name: str) -> bool:
    """Return whether a parameter is the time of a failure."""
    return name.startswith("failure.") and name.rpartition(".")[2] in _KINDS


def describe_failure(name: str) -> str:
    """Return a phrase such as 'elevator stuck' for 'failure.elevator.stuck_time'."""
    parts = name.split(".")
    what = parts[-2].replace("_", " ")
    if parts[1] == "sensor":
        return f"{what} sensor"
    return f"{what} {_KINDS[parts[-1]]}"


def failure_cases(
    names: Sequence[str], samples: Floats, end_time: Floats, engine_failed: Floats
) -> list[str]:
    """Return the failure case of each flight: failures joined by ' + ', or ``none``.

    Failures after ``end_time`` [flight], the end of the mission in s, do not count. Failures after
    an early termination count, so that all controllers have the same flights in each case. If
    ``engine_failed`` [flight] (s) is positive without a drawn engine failure, the inlet unstarted.
    """
    cases: dict[int, list[str]] = {}
    timed = np.zeros(len(end_time), dtype=bool)
    for i, name in enumerate(names):
        if is_failure_time(name):
            came = samples[:, i] < end_time
            timed |= came if name.startswith(_ENGINE) else False
            for flight in np.flatnonzero(came).tolist():
                cases.setdefault(flight, []).append(describe_failure(name))
    for flight in np.flatnonzero((engine_failed > 0.0) & ~timed).tolist():
        cases.setdefault(flight, []).append(UNSTART)
    return [
        " + ".join(cases[flight]) if flight in cases else NO_FAILURE
        for flight in range(len(end_time))
    ]


def failure_times(names: Sequence[str], samples: Floats) -> Floats:
    """Return the time (s) of each flight's first drawn failure, infinite without failures."""
    columns = [i for i, name in enumerate(names) if is_failure_time(name)]
    return samples[:, columns].min(axis=1, initial=np.inf)
