"""Quantiles of metrics: what is worst of them."""

import numpy as np
import pytest

from abhv_mc.topics.metrics import compute_metrics


@pytest.fixture(scope="module")
def table(failing):
    return compute_metrics(failing).table


def test_quantiles_count_failed_flights_as_worst(failing, table):
    found = {name: each.quantiles for name, each in table["altitude_error_max_m"].controllers.items()}
    values = failing.flights["tlc"].metrics["altitude_error_max_m"]
    assert found["tlc"]["q95"].value == pytest.approx(np.quantile(values, 0.95))
    assert np.isinf(found["lqr"]["q95"].value)  # 12 of 100 failed
    assert np.isfinite(found["lqr"]["q50"].value)


def test_small_is_bad_for_the_least_angle_of_attack(failing, table):
    values = failing.flights["tlc"].metrics["angle_of_attack_min_deg"]
    found = table["angle_of_attack_min_deg"].controllers["tlc"]
    tail = found.quantiles["q95"]
    assert found.worst == values.min()
    assert tail.value == pytest.approx(np.quantile(values, 0.05))
    assert tail.low <= tail.value <= tail.high
