"""Tests of the texts and figures on flights of a search."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.pages import search_pages as pages
from abhv_mc.report.pages.search_pages import margin_text
from abhv_mc.search.search_flights import ENDED_EARLY
from abhv_mc.shipped import find_input


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
