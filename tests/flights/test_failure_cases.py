"""Failure cases of flights."""

import numpy as np

from abhv_mc.flights.failure_cases import failure_cases, failure_times

NAMES = (
    "failure.left_elevon.stuck_time",
    "aero.lift",
    "failure.engine.time",
    "failure.sensor.pitch_rate.time",
    "failure.aileron.loss_time",
)


def test_failures_before_the_end_of_the_mission_are_named():
    never = np.inf
    samples = np.array([
        [3.0, 1.0, never, never, 9.9],
        [10.0, 1.0, 4.0, never, never],  # The elevon would be stuck at the end.
        [never, 1.0, never, 2.0, never],
        [never, 1.0, never, never, never],
        [never, 1.0, 10.0, never, never],
    ])  # fmt: skip
    cases = failure_cases(NAMES, samples, np.full(5, 10.0), np.array([0.0, 6.0, 0.5, 0.0, 0.5]))
    assert cases == [
        "left elevon stuck + aileron loss",
        "engine failed",
        "pitch rate sensor + engine unstart",
        "none",
        "engine unstart",
    ]
    assert failure_times(NAMES, samples).tolist() == [3.0, 4.0, 2.0, never, 10.0]
    assert failure_times(NAMES[1:2], samples[:, 1:2]).tolist() == [never] * 5
