"""Convergence of estimates with the number of flights."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.topics.convergence import (
    CONVERGENCE,
    ControllerSettling,
    Convergence,
    Settling,
    compute_convergence,
    settled_level,
)
from abhv_mc.topics.topic import Models


def settling(flights, *q95):
    """Return a controller's convergence; its medians are the numbers of flights."""
    curves = {"q50": Settling(flights, flights, flights), "q95": Settling(q95, q95, q95)}
    return ControllerSettling(flights, {"m": curves}, ())


@pytest.mark.parametrize(("ends", "level"), [((1.0, 2.0), "q95"), ((1.0, np.inf), "q50")])
def test_a_quantile_must_be_reached_by_all_flights_of_every_controller(ends, level):
    flown = {str(end): settling((10, 99), np.inf, end) for end in ends}
    assert settled_level(Convergence(flown), "m")[0] == level
    assert not Convergence(flown).is_drawn
    assert Convergence({**flown, "more": settling((10, 100), 1.0, 1.0)}).is_drawn


def test_rows_are_of_a_quarter_a_half_and_all_flights(flown):
    flights = (8, 24, 27, 52, 100)
    found = Convergence({"tlc": settling(flights, *5 * (np.inf,)), "lqr": settling(())})
    metric = SimpleNamespace(label_with_unit="M")
    names = SimpleNamespace(asked=("m",), metrics={"m": metric}, kind="C", label=str)
    (table,) = CONVERGENCE.section(found, names).tables()
    assert [row[:2] + [cell.split()[0] for cell in row[2:]] for row in table.plain_rows()] == [
        ["M, median", "tlc", "24.0", "52.0", "100"]
    ]
    results = flown(80)
    found = compute_convergence(results).controllers["lqr"]
    assert found.flights[-1] == 80 and len(Models(results).names.asked) == len(found.metrics)
    values = results.flights["lqr"].metrics["sideslip_max_deg"]
    last = found.metrics["sideslip_max_deg"]["q50"]
    assert last.low[-1] < last.value[-1] < last.high[-1]
    assert last.value[-1] == pytest.approx(np.median(values))
    assert found.requirements[2].value[-1] == np.mean(values >= 0.7)
