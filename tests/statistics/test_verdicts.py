"""The rule for verdicts: its published thresholds, its limits of error, its words; and the e-values that it takes."""

import numpy as np
import pytest
from mpmath import mp, mpf

from abhv_mc.statistics import judge
from abhv_mc.statistics.evidence import (
    flights_to_fail,
    flights_to_pass,
    log_fail_evidence,
    log_pass_evidence,
    most_failures,
)
from abhv_mc.statistics.verdicts import advise, tolerance_limit
from benchmarks import verdict_errors

AT = 0.9973, 0.10


def test_worked_thresholds():
    """Of the specification: 99.73 % at 10 %. PASS from a number of flights on, FAIL up to one."""
    assert [flights_to_pass(k, *AT) for k in range(6)] == [981, 2235, 3086, 3831, 4520, 5172]
    assert [flights_to_fail(k, *AT) for k in (2, 3, 5, 10)] == [53, 145, 410, 1318]
    for failures, flights in [(0, 981), (1, 2235), (5, 5172)]:
        assert [judge(failures, flights - less, *AT).status for less in (0, 1)] == ["PASS", "NOT SHOWN"]
        assert [most_failures(flights - less, *AT) for less in (0, 1)] == [failures, failures - 1]
    for failures, flights in [(2, 53), (10, 1318)]:
        assert [judge(failures, flights + more, *AT).status for more in (0, 1)] == ["FAIL", "NOT SHOWN"]


def test_one_failure_shows_nothing_and_no_flight_neither():
    assert judge(1, 1, *AT).status == "NOT SHOWN" and judge(0, 0, *AT).status == "NOT SHOWN"
    assert judge(0, 0, *AT).E_pass == pytest.approx(1.0)


def test_the_producers_risk_is_its_own():
    assert judge(10, 1318, 0.9973, 0.10, producer_risk=0.05).status == "NOT SHOWN"
    assert judge(10, 1400, 0.9973, 0.10, producer_risk=0.20).status == "FAIL"


def test_flights_that_were_not_computed_pass_as_failures_and_fail_as_successes():
    assert judge(0, 1000, *AT, uncomputed=148).status == "NOT SHOWN"
    assert judge(0, 2300, *AT, uncomputed=1).status == "PASS"
    assert judge(10, 1000, *AT, uncomputed=1).status == "FAIL" and judge(9, 1318, *AT, uncomputed=1).status != "FAIL"


def test_the_advice_passes_and_says_how_likely():
    found = advise(judge(1, 1000, *AT))
    assert (found.flights, found.failures) == (2235, 0)
    assert found.chance == pytest.approx(0.999**1235)
    close = advise(judge(10, 5000, *AT))  # none of the added flights failing has a chance of 0.4 %
    assert close.failures > 0 and close.chance >= 0.25
    assert judge(10 + close.failures, close.flights, *AT).status == "PASS"
    assert advise(judge(29, 8000, *AT)) is None and advise(judge(0, 981, *AT)) is None  # more than is allowed; PASS


@pytest.mark.parametrize("uncomputed", [0, 1, 3])
def test_pass_is_a_tolerance_limit_within_the_requirement(uncomputed):
    draw = np.random.default_rng(5)
    for flights in (500, 981, 2235, 4000):
        values = np.append(draw.exponential(1.0, flights - uncomputed - 1), np.inf)  # one was lost
        limit = tolerance_limit(values, uncomputed, *AT)
        for required in np.quantile(values[:-1], [0.9, 0.998, 0.9995, 1.0]) * (1.0 + 1e-9):
            passed = judge(int(np.sum(~(values < required))), flights, *AT, uncomputed=uncomputed).status == "PASS"
            assert passed == (limit is not None and limit < required)


def test_at_the_limit_hardly_any_system_ever_passes_or_fails():
    """Along 100,000 flights; the full version, with 20,000 systems, is benchmarks/verdict_errors.py."""
    passed, failed = 0, 0
    systems = 1500
    draw = np.random.default_rng(16)
    needed = np.array([flights_to_pass(k, *AT) for k in range(300)])
    enough = np.array([flights_to_fail(k, *AT) for k in range(1, 400)])
    for _ in range(systems):
        fails_at = np.cumsum(draw.geometric(1.0 - AT[0], 400))  # number of the flight of each failure
        passed += bool(np.any((fails_at[:300] > needed) & (needed <= 100_000)))
        failed += bool(np.any((fails_at[:399] <= enough) & (fails_at[:399] <= 100_000)))
    assert 0.07 < passed / systems <= 0.105 + 0.02 and 0.03 < failed / systems <= 0.105


@pytest.mark.thorough
@pytest.mark.parametrize("user", ["extend", "new_seed", "follow"])
def test_impatient_users_pass_hardly_more_bad_systems(user):
    """Ten rounds each; 24.9 % by extensions and 34.6 % by advised new campaigns were brought to a PASS."""
    assert verdict_errors.persuade(getattr(verdict_errors, user), 1000) <= 0.11


def log_integral(failures, flights, a, allowed, low, high):
    """Logarithm of the integral of q^(a-1) (1-q)^(n-k) over low..high, divided by q0^k (1-q0)^(n-k)."""

    def height(q):
        return (a - 1) * mp.log(q) + (flights - failures) * mp.log1p(-q)

    peak = min(max(mpf(failures) / flights, low), high)
    width = mp.sqrt(peak * (1 - peak) / flights) or mpf(1) / flights
    slope = abs((a - 1) / peak - (flights - failures) / (1 - peak)) + 1 / width
    steps = [mpf(i) * width for i in range(-40, 41)]
    steps += [mpf(d * i) / slope for i in (0.5, 1, 2, 4, 8, 16, 32, 64, 128) for d in (-1, 1)]
    points = sorted({low, high, *(min(max(peak + step, low), high) for step in steps)})
    top = height(peak)
    area = mp.quad(lambda q: mp.exp(height(q) - top), points)
    return top + mp.log(area) - failures * mp.log(allowed) - (flights - failures) * mp.log1p(-allowed)


@pytest.mark.parametrize(
    ("failures", "flights", "probability"),
    [
        (2, 53, 0.9973),
        (49, 50, 0.5),
        (20, 10**7, 0.9999),
        (99_000, 10**7, 0.99),
        (100_000, 10**7, 0.9973),  # far on the side of FAIL
        (100_000, 10**7, 0.7),  # far on the side of PASS
    ],
)
def test_evidence_is_the_integral(failures, flights, probability):
    with mp.workdps(30):
        allowed = mpf(1.0 - probability)
        quarter = mpf(1) / 4
        met = log_integral(failures, flights, failures + quarter, allowed, mpf(0), allowed)
        met -= quarter * mp.log(allowed) + mp.log(4)
        missed = log_integral(failures, flights, failures - quarter, allowed, allowed, mpf(1))
        missed -= mp.log(4 * (allowed**-quarter - 1))
        assert log_pass_evidence(failures, flights, probability) == pytest.approx(float(met), abs=1e-7)
        assert log_fail_evidence(failures, flights, probability) == pytest.approx(float(missed), abs=1e-7)
