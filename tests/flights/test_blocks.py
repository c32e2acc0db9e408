"""Joined blocks of flights, and names of metrics."""

import numpy as np

from abhv_mc.flights.blocks import FlightBlock, join_blocks
from abhv_mc.flights.metrics import default_bad, is_never_negative, label_of, unit_of
from abhv_mc.flights.statistic import Statistic


def test_joined_blocks_keep_reasons_extremes_and_events():
    blocks = [
        FlightBlock(
            np.arange(count), np.ones(count), np.ones((count, 1)), np.ones((count, 1, 1)),
            low=np.full((1, 1), low), high=np.full((1, 1), -low),
            reasons={count - 1: str(count)}, events={"surplus": count},
        )
        for count, low in ((2, -1.0), (3, -5.0), (1, np.nan))
    ]  # fmt: skip
    joined = join_blocks(blocks)
    assert joined.outcome.tolist() == [0, 1, 0, 1, 2, 0] and joined.events == {"surplus": 6}
    assert joined.reason_texts == ("", "2", "", "", "3", "1")
    assert (joined.low.item(), joined.high.item()) == (-5.0, 5.0)


def test_names_of_metrics_state_units_and_statistics_the_worse_values():
    units = {"q_pa": "Pa", "heat_j_m2": "J/m2", "v_mps": "m/s", "p_dps": "deg/s", "count": "-"}
    assert {name: unit_of(name) for name in units} == units
    assert label_of("bank_error_deg", "deg") == "Bank error" and label_of("n", "-") == "N"
    assert [default_bad(kind) for kind in (Statistic.MIN, Statistic.MAX)] == ["low", "high"]
    kinds = (Statistic.RMS, False), (Statistic.MIN, True), (Statistic.MIN, False)
    assert [is_never_negative(*kind) for kind in kinds] == [True, True, False]
