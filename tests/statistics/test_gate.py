"""The gate of `compare --fail-if-worse`; `benchmarks/gate.py` simulates more systems."""

import numpy as np
import pytest
from scipy.stats import beta

from abhv_mc.statistics.gate import judge_change
from benchmarks.gate import CHANGES, count_stopped

NONE = np.zeros(1000, dtype=bool)
flight = np.arange(1000)


def judge(a, b, margin=0.05, lost=(NONE, NONE), missed=()):
    lost = tuple(mask[: a.size] for mask in lost)
    return judge_change(a, b, lost, missed, margin)


@pytest.mark.parametrize("flights", [300, 1000])
@pytest.mark.parametrize("name", CHANGES)
def test_what_is_much_worse_is_stopped_and_the_same_law_passes(name, flights):
    """Check that regressions on a share of the flights fail the gate.

    Ten times worse on 45 % of them passed 94 of 100 builds, a hundred times on 2 % all.
    """
    stopped = count_stopped(CHANGES[name], flights, 20)
    assert stopped <= 1 if name == "identical" or "noise" in name else stopped >= 19
    if flights == 1000:
        assert count_stopped(CHANGES[name], flights, 5, required=False) in (
            range(2) if stopped <= 1 else range(4, 6)
        )


def test_a_little_worse_is_not_worse_by_more():
    draw = np.random.default_rng(66)
    a = draw.lognormal(size=1000)
    b = 1.03 * a * draw.lognormal(0.0, 0.02, 1000)
    assert judge(a, b).shown
    assert not judge(a, b, 0.01).shown
    assert judge(-a, -a, 0.0).shown  # metrics below zero have no ratio, but an order
    assert judge(np.zeros(1000), np.zeros(1000)).shown


def test_just_too_much_worse_on_most_flights_is_let_through_as_seldom_as_promised():
    draw = np.random.default_rng(67)
    passed = 0
    for _ in range(1000):
        a = draw.lognormal(size=100)
        passed += judge(a, 1.05 * a * draw.lognormal(0.0, 0.1, 100)).shown
    assert 10 <= passed <= 50 + 21


def test_the_worst_flight_that_is_not_lost():
    a, outlier = np.linspace(1.0, 2.0, 1000), flight == 500
    assert judge(a, np.where(outlier, 3.9, a)).shown
    gate = judge(a, np.where(outlier, 4.1, a))
    assert gate.worst_doubled and not gate.shown and not gate.worse_tails
    assert judge(
        a, np.where(outlier, np.inf, a), lost=(NONE, outlier)
    ).shown  # one lost flight shows nothing
    assert judge(
        -a[::-1], np.where(outlier, 0.1, -a[::-1])
    ).worst_doubled  # at least -1 before: small is bad


@pytest.mark.parametrize(("only_b", "second"), [(4, ()), (5, (1,))])
def test_requirements_missed_more_often(only_b, second):
    """Check the one-sided exact McNemar test: 5 of 5 have a chance of 1/32."""
    a, sure = np.ones(1000), flight < 40
    missed = [(NONE, NONE), (NONE, flight < only_b)]
    assert judge(a, a, missed=missed[1:]).misses_more == (second and (0,))
    assert judge(a, a, missed=missed).misses_more == ()  # Holm: two requirements share the risk
    assert judge(a, a, missed=[(NONE, sure), missed[1]]).misses_more == (0, *second)
    assert judge(a, a, missed=[(sure, NONE)]).shown


def test_lost_flights_are_worse():
    a = np.ones(1000)
    many, some = flight < 600, flight < 30
    assert not judge(a, np.where(many, np.inf, 0.5), lost=(NONE, many)).shown
    gate = judge(a, np.where(some, np.inf, 0.5), lost=(NONE, some))
    assert gate.within == 970 and gate.loses_more and not gate.shown
    assert gate.within_low == pytest.approx(beta.ppf(0.05, 970, 31))  # one-sided
    assert judge(np.where(many, np.inf, a), a, 0.0, lost=(many, NONE)).shown
    assert judge(np.full(1000, np.inf), np.full(1000, np.inf), lost=(~NONE, ~NONE)).shown


@pytest.mark.parametrize(("more", "loses"), [(0, False), (4, False), (5, True)])
def test_flights_lost_under_both_do_not_count(more, loses):
    a, both, own = np.ones(1000), flight < 40, flight < 40 + more
    gate = judge(np.where(both, np.inf, a), np.where(own, np.inf, a), lost=(both, own))
    assert gate.loses_more is loses
    assert judge(a, a, missed=[(both, own)]).misses_more == (0,) * loses
