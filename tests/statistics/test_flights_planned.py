"""What a campaign can show, against counting, the verdicts themselves and published powers."""

import numpy as np
import pytest

from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.flights_planned import ever_chance, pass_chance, together

AT = 0.9973, 0.10


@pytest.mark.parametrize(
    ("rate", "status", "runs", "ever", "at"),
    [
        (0.2, "PASS", 1000, 0.589, None),
        (0.2, "PASS", 4000, 0.90, 0.82),
        (1 / 3, "PASS", 4000, 0.69, 0.51),
        (0.5, "PASS", 4000, 0.42, 0.21),
        (2.0, "FAIL", 4000, 0.64, None),
        (1.0, "PASS", 100_000, 0.096, None),
        (1.0, "FAIL", 100_000, 0.043, None),
    ],
)
def test_powers_of_the_specification(rate, status, runs, ever, at):
    rates = np.array([rate * 0.0027])
    assert ever_chance(runs, *AT, rates, status)[0] == pytest.approx(ever, abs=0.01)
    if at is not None:
        assert pass_chance(runs, *AT, rates)[0] == pytest.approx(at, abs=0.01)


def test_chances_are_those_of_flown_campaigns():
    draw = np.random.default_rng(81)
    failures = np.cumsum(draw.random((4000, 1500)) < 0.002, axis=1)
    needed = np.array([flights_to_pass(k, 0.99, 0.10) for k in range(30)])
    reached = [any(row[n - 1] <= k for k, n in enumerate(needed) if n <= 1500) for row in failures]
    rates = np.array([0.002])
    assert ever_chance(1500, 0.99, 0.10, rates)[0] == pytest.approx(np.mean(reached), abs=0.02)
    at = failures[:, -1] <= np.sum(needed <= 1500) - 1
    assert pass_chance(1500, 0.99, 0.10, rates)[0] == pytest.approx(np.mean(at), abs=0.02)
    assert pass_chance(400, 0.9999, 0.10, rates).tolist() == ever_chance(400, 0.9999, 0.10, rates).tolist() == [0.0]


def test_all_together_lies_between_the_bounds():
    one, other = np.array([0.9, 0.3]), np.array([0.8, 0.2])
    low, high = together([one, other])
    assert low == pytest.approx([0.7, 0.0]) and high == pytest.approx([0.8, 0.2])
    assert np.all(low <= one * other) and np.all(one * other <= high)
