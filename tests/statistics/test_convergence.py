import numpy as np
import pytest

from abhv_mc.statistics.convergence import failure_trace, looks, quantile_traces
from abhv_mc.statistics.estimates import quantile


def test_looks_grow_and_end_with_all():
    counts = looks(1000)
    assert counts[0] == 20
    assert counts[-1] == 1000
    assert (np.diff(counts) > 0).all()
    assert looks(7).tolist() == [7]


def test_the_last_look_is_the_whole_campaign():
    values = np.random.default_rng(12).normal(size=300)
    (trace,) = quantile_traces(values, looks(300), (0.95,))
    whole = quantile(values, 0.95)
    assert (trace.value[-1], trace.low[-1]) == (whole.value, whole.low)
    assert trace.high[0] == np.inf  # 20 flights do not bound the 95 % quantile


def test_failure_share():
    failed = np.zeros(100, dtype=bool)
    failed[[3, 50]] = True
    trace = failure_trace(failed, np.array([20, 100]))
    assert trace.value == [pytest.approx(0.05), pytest.approx(0.02)]
    assert trace.low[1] < 0.02 < trace.high[1]
