"""Convergence of estimates with the number of flights."""

from dataclasses import replace
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
from abhv_mc.topics.convergence.figures import plot_convergence
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


@pytest.mark.parametrize("bad", ["high", "low"])
def test_estimates_include_all_flights_up_to_a_number(flown, bad):
    """Early terminations are the worst, and quantiles of small values are counted from below."""
    results, metric = flown(200), "sideslip_max_deg"
    tlc = results.flights["tlc"]
    values = np.random.default_rng(4).permutation(np.arange(200.0))
    lost = np.isin(np.arange(200), [3, 90, 150])
    records = {**tlc.records, metric: replace(tlc.records[metric], bad=bad)}
    flights = replace(
        tlc, outcome=3 * lost, metrics={**tlc.metrics, metric: values}, records=records
    )
    ((name, found),) = compute_convergence(
        replace(results, flights={"tlc": flights})
    ).controllers.items()
    assert name == "tlc" and found.flights[-1] == 200 and len(found.flights) > 5
    sign = 1.0 if bad == "high" else -1.0
    severity = np.where(lost, np.inf, sign * values)
    for level, share in (("q50", 0.5), ("q95", 0.95)):
        trace = found.metrics[metric][level]
        for count, value, low, high in zip(
            found.flights, trace.value, trace.low, trace.high, strict=True
        ):
            first = np.sort(severity[:count])
            between = first[[int(share * (count - 1)), -int(-share * (count - 1) // 1)]]
            assert between[0] <= sign * value <= between[1]
            assert low <= value <= high and (low < high or value == sign * np.inf)
    missed = (values >= 0.7) | lost  # the limit of the third requirement
    shares = [missed[:count].mean() for count in found.flights]
    assert found.requirements[2].value == pytest.approx(shares)


def test_curves_of_convergence_have_their_intervals(flown):
    """A quantile that is not reached by all flights is replaced by the median."""
    metric = SimpleNamespace(label_with_unit="M (m)")
    names = SimpleNamespace(
        asked=("m", "n"), metrics={"m": metric, "n": metric}, controllers={"a": "A", "b": "B"}
    )
    inf = np.inf
    flights = (20, 50, 100, 200)
    reached = Settling((5.0, 4.0, 3.5, 3.0), (-inf, 2.0, 2.5, 2.8), (inf, 6.0, inf, 3.2))
    lost = Settling((1.0, 2.0, 1.5, inf), (0.5, 0.5, 0.5, 0.5), (inf, inf, inf, inf))
    middle = Settling((1.0, 1.1, 1.2, 1.3), (0.5, 0.6, 0.7, 0.8), (2.0, 2.0, 2.0, 2.0))

    def of(q95):
        return {"q50": middle, "q95": q95}

    found = Convergence(
        {
            "a": ControllerSettling(flights, {"m": of(reached), "n": of(lost)}, ()),
            "b": ControllerSettling(flights, {"m": of(reached), "n": of(reached)}, ()),
        }
    )
    ((text, figure),) = CONVERGENCE.figures(found, names)
    assert text.name == "convergence"
    first, second = figure.axes
    titles = [axes.texts[-1].get_text().replace("\n", " ") for axes in figure.axes]
    assert "95\xa0%\xa0quantile" in titles[0] and titles[1].split(", ")[1] == "median"
    for axes, settled in ((first, reached), (second, middle)):
        for label, line in zip("AB", axes.lines, strict=True):
            assert line.get_label() == label
            assert line.get_xdata().tolist() == [*flights]
            assert line.get_ydata().tolist() == [*settled.value]
        assert axes.get_xscale() == "log" and axes.get_yscale() == "linear"
        assert axes.get_xticks().tolist() == [20, 50, 100, 200]
    corners = np.concatenate([path.vertices for path in second.collections[0].get_paths()])
    assert {*zip(flights, middle.low, strict=True)} <= {*map(tuple, corners)}
    assert {*zip(flights, middle.high, strict=True)} <= {*map(tuple, corners)}
    assert list(CONVERGENCE.figures(replace(found, controllers={}), names)) == []
    few = replace(found, controllers={"a": replace(found.controllers["a"], flights=(20, 50))})
    assert list(CONVERGENCE.figures(few, names)) == []


@pytest.mark.parametrize(
    ("ends", "ticks"),
    [((7, 60), [10, 20, 50]), ((20, 3000), [100, 1000]), ((1, 100), [1, 10, 100])],
)
def test_ticks_are_round_numbers_of_flights(ends, ticks):
    series = {"a": np.ones((3, 2))}
    figure = plot_convergence({"a": np.array(ends, float)}, [("t", series)], {"a": "A"})
    assert figure.axes[0].get_xticks().tolist() == ticks
