"""Tests of the texts and figures on flights of a search."""

import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.pages import search_pages as pages
from abhv_mc.report.pages.search_pages import margin_text
from abhv_mc.search.methods.surrogate import SurrogateEstimate
from abhv_mc.search.search_flights import ENDED_EARLY, DrawnFlights
from abhv_mc.shipped import find_input
from abhv_mc.topics.topic import Fold, Picture, Table
from abhv_mc_vehicle.plant.parameters import OURS


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(find_input("s_manoeuvre", "campaign"))


@pytest.mark.parametrize(
    ("worst", "margin"), [(45.0, "margin 10"), (55.0, "margin \N{MINUS SIGN}10")]
)
def test_the_margin_of_a_violated_limit_is_negative(campaign, worst, margin):
    requirement = campaign.requirements[0]  # below 50 m
    metric = campaign.metrics[requirement.metric]
    text = margin_text(requirement, metric, worst)
    assert margin in text and "50" in text
    assert "margin" not in margin_text(requirement, metric, np.inf)
    assert "margin" not in margin_text(SimpleNamespace(limits=Bounds(high=0.0)), metric, worst)


def lines(records):
    return {
        record.label: [re.sub(r"\s", " ", entry.text) for entry in record.entries]
        for record in records.records
    }


@pytest.fixture
def worst(campaign):
    """Return a search of four flights, and two random flights and one with another seed."""
    item, values = campaign.requirements[0], np.array([10.0, 45.0, 55.0, 20.0, 30.0, 15.0, 7.0])
    steps = [SimpleNamespace(stage=s, evaluations=n) for s, n in (("a", 1), ("a", 2), ("b", 4))]
    flights = SimpleNamespace(
        names=("aero.lift", "aero.drag", "seed"),
        outcome=["ok"] * 7,
        end_time=np.arange(60.0, 67.0),
        column=lambda _: values,
    )
    return SimpleNamespace(
        metric=campaign.metrics[item.metric],
        criterion=SimpleNamespace(limits=None),
        case=SimpleNamespace(
            history=steps,
            place=np.array([0.5, -1.0]),
            sensitivity=np.array([[-3.0, 2.0], [0.49 * ENDED_EARLY, ENDED_EARLY]]),
        ),
        names=("aero.lift", "aero.drag"),
        probabilities={"failure.x": 0.25},
        flights=flights,
        searched=4,
        random=2,
        worst=2,
        random_worst=4,
        severities=values[:6],
        requirements=(item,),
        sign=1.0,
        at_bounds=["aero.drag"],
        other_seeds=(9, 2, (1.0, 3.0, 2.0)),
        failed_to_run=0,
        value=lambda flight: values[flight],
    )


def test_the_records_of_a_worst_case_are_those_of_its_flights(worst):
    found = lines(pages._worst_records(worst))
    assert found["Worst flight"] == ["55 m (4 flights of the search)"]
    assert found["Random flights"] == ["30 m (worst of 2)"]
    assert re.search("55 m.* < 50 m, margin \N{MINUS SIGN}10 %", found["Margin"][0])
    assert found["At a bound"] == ["aero.drag"] and found["In every flight"] == ["failure.x (25 %)"]
    assert re.findall(r"\d+", found["Other seeds"][0]) == ["9", "2", "1", "2", "3"]
    assert "Turbulence, noise" in found and "Not counted" not in found
    worst.severities[2], worst.other_seeds = ENDED_EARLY, None
    worst.failed_to_run, worst.flights.names = 3, worst.names
    found = lines(pages._worst_records(worst))
    assert found["Worst flight"][0].startswith("terminated early, at 62 s (ok) (4")
    assert found["Not counted"] == ["3 failed to run"]
    assert not {"Margin", "Other seeds", "Turbulence, noise"} & found.keys()
    worst.other_seeds = (9, 9, None)
    assert re.findall(r"\d+", pages._other_seeds(worst)) == ["9", "9"]


def drawn(monkeypatch, name):
    """Return the list of what the function that makes a figure is given."""
    calls = []
    monkeypatch.setattr(pages, name, lambda *given, **named: calls.append((*given, named)))
    return calls


def test_the_convergence_is_the_worst_value_so_far(worst, monkeypatch):
    calls = drawn(monkeypatch, "plot_convergence")
    pages._convergence(worst)
    _, searched, random, stages, limits, _ = calls[0]
    assert searched.tolist() == [10.0, 45.0, 55.0, 55.0] and random.tolist() == [30.0, 30.0]
    assert (stages, limits) == ([(0, "a"), (2, "b")], [50.0])
    worst.severities[1], worst.criterion.limits = ENDED_EARLY, Bounds(-50.0, 50.0)
    worst.sign = -1.0
    pages._convergence(worst)
    np.testing.assert_equal(calls[1][1], [-10.0, np.nan, np.nan, np.nan])
    assert calls[1][4] == [0.0]


def test_sensitivities_have_the_sign_of_the_metric_or_of_the_end_time(worst, monkeypatch):
    calls = drawn(monkeypatch, "plot_worst_point")
    worst.sign = -1.0
    pages._place(worst)
    worst.severities[2] = ENDED_EARLY
    worst.case.sensitivity[0] = -4.0, 1.0
    worst.sign = 1.0
    pages._place(worst)
    (names, place, change, label, _), (*_, early, ends, _) = calls
    assert (names, place.tolist()) == (worst.names, [0.5, -1.0])
    np.testing.assert_equal(change, [[3.0, -2.0], [-0.49 * ENDED_EARLY, np.nan]])
    np.testing.assert_equal(early, [[4.0, -1.0], [-0.49 * ENDED_EARLY, np.nan]])
    assert label == worst.metric.label_with_unit and ends == "end time (s)"


@pytest.fixture
def rare(campaign, worst):
    levels = [
        SimpleNamespace(threshold=excess, probability=0.1) for excess in (-20.0, -5.0, ENDED_EARLY)
    ]
    estimate = SimpleNamespace(
        refusal=None,
        probability=0.2,
        low=0.1,
        high=0.4,
        flights=4000,
        repetitions=[SimpleNamespace(levels=levels)] * 2,
        unwarned_high=None,
        check=object(),
    )
    return SimpleNamespace(
        metric=worst.metric,
        flights=worst.flights,
        requirement=campaign.requirements[0],
        estimate=estimate,
        strata=(),
        space=SimpleNamespace(names=worst.names),
        severities=worst.severities - 50.0,
        failed_to_run=0,
        noise_share=None,
        includes_unwarned=False,
        unwarned="",
        second_opinion="",
        failures=12,
    )


def test_the_records_of_a_rare_event_are_the_estimate_and_its_price(rare):
    found = lines(pages._rare_records(rare))
    assert re.findall(r"\d\.\de[-+]\d+", found["P(violation)"][0]) == [
        "2.0e-01", "1.0e-01", "4.0e-01", "2.7e-03"]  # fmt: skip
    assert re.findall(r"\d+", found["Basis"][0].replace(" ", "")) == ["4000", "95", "2"]
    # A share p of n flights has a standard deviation of log(p) of sqrt((1 - p) / (p n)).
    plain = 0.8 / 0.2 * (1.96 / (0.5 * np.log(4.0))) ** 2
    assert re.sub(r"\D", "", found["Plain Monte Carlo"][0]) == f"{plain:.0f}"
    assert "Separate regions" in found and "Counted as failures" not in found
    assert found["Worst flight"][0].startswith("55 m") and "Assumption" not in found
    rare.includes_unwarned, rare.estimate.unwarned_high, rare.failed_to_run = True, 0.4, 5
    rare.noise_share, rare.strata, rare.space.names = 0.25, (1,), ("x",) * 99
    found = lines(pages._rare_records(rare))
    assert found["Counted as failures"] == ["5 failed to run"]
    assert found["Noise"][0].startswith("25 %") and "repetitions" not in found["Basis"][0]
    assert not {"Plain Monte Carlo", "Separate regions"} & found.keys()
    rare.estimate.unwarned_high = 1e-3
    assert "Plain Monte Carlo" in lines(pages._rare_records(rare))
    rare.estimate.refusal = "no"
    assert "P(violation)" not in (found := lines(pages._rare_records(rare)))
    assert found["No trustworthy estimate"] == ["no"]


def test_levels_are_values_of_the_metric_with_products_of_probabilities(rare, monkeypatch):
    calls = drawn(monkeypatch, "plot_levels")
    pages._levels(rare)
    rare.requirement = SimpleNamespace(limits=Bounds(low=-50.0))
    pages._levels(rare)
    for (label, limit, curves, _), sign in zip(calls, (1.0, -1.0), strict=True):
        assert (label, limit) == (rare.metric.label_with_unit, sign * 50.0)
        assert len(curves) == 2
        np.testing.assert_equal(curves[0][0], [sign * 30.0, sign * 45.0, np.nan])
        assert curves[0][1] == pytest.approx([0.1, 0.01, 0.001])


def histories(campaign):
    """Return a nominal flight and two others, in which channel k is 1000 (k + 1) + the flight."""
    channels = len(campaign.channels)
    history = 1e3 * np.ones((3, 4, 1)) * np.arange(1, channels + 1) + np.arange(3.0)[:, None, None]
    return DrawnFlights((7, 2), np.arange(4.0), history.astype(np.float32), campaign)


@pytest.mark.parametrize(
    ("metric", "of", "first", "levels"),
    [
        ("sideslip_max_deg", "sideslip_deg", "sideslip (deg)", [-2.0, 2.0, 3.0, -3.0]),
        ("altitude_error_max_m", "altitude_m", "altitude (km)", [2e-3, -2e-3, -3e-3, 3e-3]),
        ("load_factor_max_g", "load_factor_g", "load factor", [-2.0, 3.0]),
        ("altitude_error_rms_m", "altitude_error_m", "altitude error", []),
        ("fuel_used_kg", "fuel_used_kg", None, []),
    ],
)
def test_the_first_panel_of_flights_shows_the_metric_and_its_limits(
    campaign, monkeypatch, metric, of, first, levels
):
    calls = drawn(monkeypatch, "plot_flights")
    items = [SimpleNamespace(limits=Bounds(-2.0, 3.0))]
    searched = replace(campaign.metrics[metric], of=of)
    ((text, _),) = pages.flight_figures(histories(campaign), searched, items)
    ((times, panels, labels, named),) = calls
    assert (text.name, times.tolist()) == ("flights", [0.0, 1.0, 2.0, 3.0])
    assert " 10 % " in text.caption
    assert labels == ["nominal", "flight 7", "flight 2"]
    assert sorted(named["limits"]) == pytest.approx(sorted(levels))
    usual = ["altitude (km)", "speed (m/s)", "angle of attack (deg)", "sideslip (deg)"]
    usual += ["bank (deg)", "elevator (deg)"]
    names = list(panels)
    assert len(names) == 6 and (first is None or names[0].startswith(first))
    others = [name for name in usual if name != first]
    assert names[first is not None :] == others[: len(names) - (first is not None)]
    numbers = {signal.name: k for k, signal in enumerate(campaign.channels, 1)}
    expected = {names[0]: of, "altitude (km)": "altitude_m", "bank (deg)": "bank_deg"}
    for label in panels.keys() & expected.keys() if first else ():
        scale = 1e-3 if "km" in label else 1.0
        values = scale * (1e3 * numbers[expected[label]] + np.arange(3.0))
        np.testing.assert_allclose(panels[label], np.tile(values[:, None], 4), rtol=1e-6)
    assert list(pages.flight_figures(None, searched, items)) == []


def cells(table):
    return [[re.sub(r"\s", " ", cell) for cell in row] for row in table.plain_rows()]


@pytest.fixture
def listed(worst):
    """Return the search of four flights with samples, of which flights 1 and 2 are alike."""
    worst.flights.samples = np.array(
        [[0.9, 1.0, 5.0], [1.1, 1.0, 6.0], [1.1, 1.05, 7.0], [1.0, 1.2, 8.0], *3 * [[2.0, 2.0, 9]]]
    )
    worst.known, worst.controller, worst.drawn = OURS, "tlc", None
    worst.bounds = np.array([[0.8, 1.1], [0.9, 1.3]])
    worst.request = SimpleNamespace(box=3.0)
    return worst


def test_a_worst_case_lists_distinct_flights_of_the_search_and_its_box(listed, monkeypatch):
    monkeypatch.setattr(pages, "DRAWN_APART", 0.2)
    answer = pages.make_worst_answer(listed, Path("a folder"))
    items = answer.section.items
    pictures = [item.name for item in items if isinstance(item, Picture)]
    assert pictures == ["convergence", "place", "flights"]
    (box,) = (item for item in items if isinstance(item, Table))
    assert cells(box) == [
        ["aero.lift", "\N{MINUS SIGN}20.0 %", "+10.0 %", "+10.0 %"],
        ["aero.drag", "\N{MINUS SIGN}10.0 %", "+5.0 %", "+30.0 %"],
    ]
    (fold,) = (item for item in items if isinstance(item, Fold))
    (table,) = fold.items
    rows = cells(table)
    assert [row[:3] for row in rows] == [
        ["2", "55", "ok, 62 s"], ["3", "20", "ok, 63 s"], ["0", "10", "ok, 60 s"]]  # fmt: skip
    assert rows[0][3] == "aero.lift +10.0 %, aero.drag +5.0 %"
    assert [shlex.split(row[4].strip("`")) for row in rows] == [
        ["abhv-mc", "replay", "a folder", "--controller", "tlc", "--flight", k] for k in "230"
    ]
    assert table.heads[1] == listed.metric.label_with_unit
    assert [text.name for text, _ in answer.figures] == ["convergence", "place"]


def test_a_rare_event_lists_its_flights_and_combinations(rare, listed, monkeypatch):
    rare.known, rare.controller, rare.drawn, rare.flights = OURS, "tlc", None, listed.flights
    answer = pages.make_rare_answer(rare, Path("folder"))
    assert not any(isinstance(item, Table) for item in answer.section.items)
    (table,) = answer.section.items[-1].items
    assert [row[0] for row in table.plain_rows()] == list("2430")
    stratum = SimpleNamespace(weight=0.02, probability=0.3, low=0.1, high=0.5, flights=1200)
    rare.strata, rare.words = (stratum,), lambda _: "engine"
    *_, combinations, _ = pages.make_rare_answer(rare, Path("folder")).section.items
    assert cells(combinations) == [
        ["engine", "2.00e-02", "3.00e-01 (1.0e-01 .. 5.0e-01)", "6.00e-03", "1200"]
    ]
    points = np.array([[0.0, 1.0]])
    calls = {name: drawn(monkeypatch, f"plot_{name}") for name in ("levels", "failures")}
    monkeypatch.setattr(pages, "_mixing", lambda _: (SimpleNamespace(name="mixing"), None))
    for repetitions, failures, names in (
        (rare.estimate.repetitions, points, ["levels", "mixing", "failures"]),
        ((), points[:0], []),
    ):
        rare.estimate.repetitions, rare.estimate.failures = repetitions, failures
        assert [text.name for text, _ in pages._draw_rare(rare)] == names
    assert calls["failures"] == [(rare.space.names, points, {})]


def test_mixing_omits_the_first_level_which_has_no_moves(rare, monkeypatch):
    calls = drawn(monkeypatch, "plot_mixing")
    levels = [SimpleNamespace(acceptance=0.1 * k, spread=1.0 * k) for k in range(4)]
    rare.estimate.repetitions = [SimpleNamespace(levels=levels[:n]) for n in (4, 3)]
    pages._mixing(rare)
    rates, sizes, target, _ = calls[0]
    assert [curve.tolist() for curve in sizes] == [[1.0, 2.0, 3.0], [1.0, 2.0]]
    assert [curve.tolist() for curve in rates] == [[0.1 * k for k in (1, 2, 3)], [0.1, 0.2]]
    assert target == pytest.approx(0.44)


def test_a_surrogate_is_drawn_with_its_steps(rare, monkeypatch):
    calls = drawn(monkeypatch, "plot_learning")
    steps = tuple(
        SimpleNamespace(runs=n, probabilities=(0.1 * n, 0.2 * n), low=0.01 * n, high=0.3 * n)
        for n in (1, 2)
    )
    rare.drawn, rare.requirement = None, SimpleNamespace(limits=Bounds(-2.0, 3.0))
    rare.estimate = SurrogateEstimate(
        0.2, 0.1, 0.4, 0.1, 90, (), None, None, steps, np.empty((0, 2)), 1
    )
    ((text, _),) = pages._draw_rare(rare)
    ((label, limits, rows, values, _),) = calls
    assert (text.name, label) == ("learning", rare.metric.label_with_unit)
    assert limits == [-2.0, 3.0] and values.tolist() == rare.flights.column("").tolist()
    np.testing.assert_allclose(rows, [[1, 0.1, 0.2, 0.01, 0.3], [2, 0.2, 0.4, 0.02, 0.6]])
    rare.requirement = SimpleNamespace(limits=Bounds(high=50.0), probability=0.9)
    found = lines(pages._rare_records(rare))
    assert "12 failed" in found["Basis"][0] and found["Assumption"] == ["smooth metric"]
