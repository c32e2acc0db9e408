"""Results that are kept for equal arguments, and for no others."""

import numpy as np

from abhv_mc.control.design.kept import kept


def test_equal_contents_share_a_result_and_others_do_not():
    calls = []

    @kept
    def total(values, *, scale=1.0):
        calls.append(scale)
        return scale * values.sum()

    assert total(np.arange(3.0)) == total(np.arange(3.0)) == 3.0
    assert len(calls) == 1
    assert total(np.arange(3.0), scale=2.0) == 6.0
    assert total(np.arange(4.0)) == 6.0
    values = np.arange(3.0)
    values[0] = 5.0
    assert total(values) == 8.0
    assert len(calls) == 4
