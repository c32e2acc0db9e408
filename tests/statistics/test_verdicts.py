"""Tests of the verdicts: published thresholds, error limits, families and planning."""

import re
from dataclasses import replace

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy import stats

from abhv_mc.statistics import judge
from abhv_mc.statistics.evidence import (
    flights_to_fail,
    flights_to_pass,
    log_fail_evidence,
    log_pass_evidence,
    most_failures,
)
from abhv_mc.statistics.family import hold_family, holm, judge_family
from abhv_mc.statistics.flights_planned import ever_chance, pass_chance, together
from abhv_mc.statistics.verdicts import (
    SET_LATER,
    UNSEARCHED,
    about,
    advice_words,
    advise,
    label_status,
    predict_pass,
    tolerance_limit,
    verdict_words,
)

AT = 0.9973, 0.10


def test_worked_thresholds():
    """Thresholds of the specification: 99.73 % at 10 %, for PASS and FAIL."""
    assert [flights_to_pass(k, *AT) for k in range(6)] == [981, 2235, 3086, 3831, 4520, 5172]
    assert [flights_to_fail(k, *AT) for k in (2, 3, 5, 10)] == [53, 145, 410, 1318]
    for failures, flights in [(0, 981), (1, 2235), (5, 5172)]:
        assert [judge(failures, flights - less, *AT).status for less in (0, 1)] == [
            "PASS",
            "NOT SHOWN",
        ]
        assert [most_failures(flights - less, *AT) for less in (0, 1)] == [failures, failures - 1]
    for failures, flights in [(2, 53), (10, 1318)]:
        assert [judge(failures, flights + added, *AT).status for added in (0, 1)] == [
            "FAIL",
            "NOT SHOWN",
        ]


@pytest.mark.parametrize(
    ("failures", "flights", "options", "status"),
    [
        (0, 0, {}, "NOT SHOWN"),
        (1, 1, {}, "NOT SHOWN"),  # fewer than two failures are no FAIL
        (10, 1318, {"producer_risk": 0.05}, "NOT SHOWN"),
        (10, 1400, {"producer_risk": 0.20}, "FAIL"),
        # Flights that were not computed are failures for a PASS, successes for a FAIL.
        (0, 1000, {"uncomputed": 148}, "NOT SHOWN"),
        (0, 2300, {"uncomputed": 1}, "PASS"),
        (10, 1000, {"uncomputed": 1}, "FAIL"),
        (9, 1318, {"uncomputed": 1}, "NOT SHOWN"),
    ],
)
def test_what_the_counts_show(failures, flights, options, status):
    assert judge(failures, flights, *AT, **options).status == status


@pytest.mark.parametrize(
    "arguments",
    [(-1, 9, 0.9), (1, 9, 0.9, 0.1, 0.1, -1), (9, 9, 0.9, 0.1, 0.1, 1), (1, 9, 1.0), (1, 9, 0.0)],
)
def test_impossible_counts_and_probabilities_are_refused(arguments):
    with pytest.raises(ValueError, match="between 0 and"):
        judge(*arguments)


def test_overwhelming_evidence_is_infinite():
    passed, failed = judge(0, 10**6, *AT), judge(10**4, 10**4, *AT)
    assert (passed.E_pass, passed.E_fail, passed.p_value) == (np.inf, 0.0, 0.0)
    assert (failed.E_fail, failed.p_value) == (np.inf, 1.0) and failed.E_pass < 1e-4
    assert verdict_words(judge(20, 40, 0.5)).endswith("more failures than the requirement allows")


def test_verdicts_are_printed_with_what_a_pass_needs():
    needed = advise([judge(0, 500, *AT)]).flights
    chance = about(predict_pass(judge(0, 500, *AT), needed))
    words = verdict_words(judge(0, 500, *AT))
    assert f"0 of 500 flights failed; {needed} " in words
    assert f"--runs {needed}), " in words and words.endswith(chance)
    assert verdict_words(judge(5, 500, *AT)).endswith("more failures than the requirement allows")
    assert (about(0.0), about(0.534), about(1.0)) == ("about 1 %", "about 53 %", "about 99 %")


def test_notes_mark_requirements_set_later_and_withhold_advice_without_a_search():
    plain = judge(0, 500, *AT)
    later, unsearched = replace(plain, note=SET_LATER), replace(plain, note=UNSEARCHED)
    assert [verdict.set_later for verdict in (plain, later, unsearched)] == [False, True, False]
    assert [verdict.label for verdict in (plain, later)] == ["NOT SHOWN", "NOT SHOWN (set later)"]
    assert (
        label_status("PASS", True) == "PASS (set later)" and label_status("FAIL", False) == "FAIL"
    )
    assert advice_words(unsearched) == "" and verdict_words(unsearched).endswith(f"; {UNSEARCHED}")
    assert SET_LATER in verdict_words(later) and advice_words(later) == advice_words(plain) != ""


def test_a_verdict_is_printed_with_grouped_counts_and_those_not_computed():
    verdict = judge(3, 20_000, *AT, uncomputed=2)
    assert verdict_words(verdict).startswith("PASS: 5 of 20\u202f000 flights failed; 2 of these")
    assert verdict_words(judge(5, 20_000, *AT)) == "PASS: 5 of 20\u202f000 flights failed"
    assert (verdict.failures, verdict.uncomputed, verdict.flights) == (5, 2, 20_000)
    assert verdict.E_pass == pytest.approx(judge(5, 20_000, *AT).E_pass)
    assert verdict.p_value == pytest.approx(1.0 / verdict.E_pass)
    failed = judge(20, 1000, *AT, uncomputed=2)
    assert failed.E_fail == pytest.approx(judge(20, 1000, *AT).E_fail) and failed.p_value == 1.0
    risks = judge(0, 9, 0.9), judge(0, 9, 0.9, 0.2), judge(0, 9, 0.9, 0.2, 0.3)
    assert [(v.consumer_risk, v.producer_risk) for v in risks] == [
        (0.1,) * 2,
        (0.2,) * 2,
        (0.2, 0.3),
    ]


@pytest.mark.parametrize(
    ("failures", "flights", "advised"),
    [
        (0, 20, (981, 14, "")),  # ten times the flights are too few
        (0, 500, (981, 71, "(--runs 981)")),
        (9, 3334, (flights_to_pass(9, *AT), 1, "")),  # 0.0027 * 3334 = 9.002
        (9, 3333, None),  # 8.999, more than the requirement allows
    ],
)
def test_advice_is_the_number_for_a_pass_unless_too_many_failed(failures, flights, advised):
    words = advice_words(judge(failures, flights, *AT))
    assert bool(re.search(r"\d", words)) == (advised is not None)
    if advised:
        number, percent, option = advised
        assert words.startswith(f"{number} ") and words.endswith(f" {percent} %")
        assert option in words and ("--runs" in words) == (option != "")
        chance = predict_pass(judge(failures, flights, *AT), number)
        assert chance < 0.01 or chance == pytest.approx(percent / 100.0, abs=0.005)
    assert "--runs" not in advice_words(judge(failures, flights, *AT), flies=False)


def test_the_predicted_chance_is_the_mean_over_the_rates_that_the_flights_leave():
    """Beta-binomial; with today's rate of zero it was 100 %, and 53 % came true."""
    for failures, flights, longer in ((0, 900, 981), (1, 1000, 2500), (10, 5000, 12_000)):
        most = most_failures(longer, *AT) - failures
        posterior = stats.beta(failures + 0.5, flights - failures + 0.5)
        share = np.linspace(0.0, 1.0, 20_001)[1:] - 0.5 / 20_000
        truth = np.mean(stats.binom.cdf(most, longer - flights, posterior.ppf(share)))
        chance = predict_pass(judge(failures, flights, *AT), longer)
        assert chance == pytest.approx(truth, abs=1e-4) and chance < 1.0
    assert predict_pass(judge(1, 1000, *AT), 2234) == 0.0  # too few even if none fails
    assert predict_pass(judge(0, 981, *AT), 981) == 1.0
    # one more flight may fail, and one is added
    enough = flights_to_pass(1, *AT)
    assert predict_pass(judge(0, enough - 1, *AT), enough) == 1.0


def test_the_advised_number_is_the_smallest_that_is_likely_to_do_for_all():
    verdicts = [judge(0, 800, *AT), judge(1, 1200, *AT)]
    extension = advise(verdicts)
    chances = [predict_pass(verdict, extension.flights) for verdict in verdicts]
    assert extension.chance == pytest.approx(np.prod(chances)) and extension.chance >= 0.5
    assert extension.flights > advise(verdicts[:1]).flights
    needed = [flights_to_pass(k, *AT) for k in range(60)]
    for number in (n for n in needed if 1200 < n < extension.flights):
        assert np.prod([predict_pass(verdict, number) for verdict in verdicts]) < 0.5
    assert advise([judge(29, 8000, *AT)]) is None  # more than is allowed
    assert advise([judge(0, 20, *AT)]) is None  # ten times the flights are too few


@pytest.mark.parametrize("uncomputed", [0, 1, 3])
def test_pass_is_a_tolerance_limit_within_the_requirement(uncomputed):
    draw = np.random.default_rng(5)
    for flights in (500, 981, 2235, 4000):
        values = np.append(draw.exponential(1.0, flights - uncomputed - 1), np.inf)  # one was lost
        limit = tolerance_limit(values, uncomputed, *AT)
        for required in np.quantile(values[:-1], [0.9, 0.998, 0.9995, 1.0]) * (1.0 + 1e-9):
            passed = (
                judge(int(np.sum(~(values < required))), flights, *AT, uncomputed=uncomputed).status
                == "PASS"
            )
            assert passed == (limit is not None and limit < required)


def test_at_the_limit_hardly_any_system_ever_passes_or_fails():
    """Check the error rates along 100,000 flights.

    The full version, with 20,000 systems, is benchmarks/verdict_errors.py.
    """
    passed, failed = 0, 0
    systems = 1500
    draw = np.random.default_rng(16)
    needed = np.array([flights_to_pass(k, *AT) for k in range(300)])
    enough = np.array([flights_to_fail(k, *AT) for k in range(1, 400)])
    for _ in range(systems):
        fails_at = np.cumsum(
            draw.geometric(1.0 - AT[0], 400)
        )  # number of the flight of each failure
        passed += bool(np.any((fails_at[:300] > needed) & (needed <= 100_000)))
        failed += bool(np.any((fails_at[:399] <= enough) & (fails_at[:399] <= 100_000)))
    assert 0.07 < passed / systems <= 0.105 + 0.02 and 0.03 < failed / systems <= 0.105


def log_integral(failures, flights, a, allowed, low, high):
    """Return the logarithm of a likelihood ratio.

    It is the integral of q^(a-1) (1-q)^(n-k) over low..high, divided by q0^k (1-q0)^(n-k).
    """

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
    return (
        top + mp.log(area) - failures * mp.log(allowed) - (flights - failures) * mp.log1p(-allowed)
    )


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
        assert log_pass_evidence(failures, flights, probability) == pytest.approx(
            float(met), abs=1e-7
        )
        assert log_fail_evidence(failures, flights, probability) == pytest.approx(
            float(missed), abs=1e-7
        )


def test_holm_passes_more_than_bonferroni():
    good, last = judge(0, 200, 0.9, 0.10), judge(10, 230, 0.9, 0.10)
    assert 0.1 / 9 < last.p_value <= 0.1
    assert [verdict.status for verdict in hold_family([good] * 8 + [last], 0.10)] == ["PASS"] * 9
    dropped = hold_family([judge(20, 200, 0.9, 0.10)] * 8 + [last], 0.10)[-1]
    assert dropped.consumer_risk == 0.1 / 9
    assert dropped.status == "NOT SHOWN" and re.search(r"PASS .* 10 %.* 9 ", dropped.note)


def test_holm_is_the_published_procedure():
    # Holm 1979: sorted p-values against risk/m, risk/(m-1), ...; the first that fails stops all
    # after it.
    assert holm([0.01, 0.04, 0.03, 0.005], 0.05) == [True, False, False, True]
    assert holm([0.04, 0.04], 0.05) == [False, False]
    assert holm([], 0.05) == []


def test_fail_stays_and_dependent_flights_get_no_verdict():
    failed = judge(100, 200, 0.9, 0.10)
    assert hold_family([failed, failed], 0.01) == [failed, failed]
    passed = [[judge(0, 5000, 0.9, 0.10)]]
    assert judge_family(passed, family_risk=0.01)[0][0].status == "PASS"
    assert judge_family(passed, independent=False, family_risk=0.01)[0][0].status == "ESTIMATE"


@pytest.mark.parametrize(
    ("rate", "status", "runs", "ever", "at_runs"),
    [
        (0.2, "PASS", 4000, 0.90, 0.82),
        (0.5, "PASS", 4000, 0.42, 0.21),
        (2.0, "FAIL", 4000, 0.64, None),
        (1.0, "PASS", 100_000, 0.096, None),
        (1.0, "FAIL", 100_000, 0.043, None),
    ],
)
def test_powers_of_the_specification(rate, status, runs, ever, at_runs):
    rates = np.array([rate * 0.0027])
    assert ever_chance(runs, *AT, rates, status)[0] == pytest.approx(ever, abs=0.01)
    if at_runs is not None:
        assert pass_chance(runs, *AT, rates)[0] == pytest.approx(at_runs, abs=0.01)


@pytest.mark.parametrize("status", ["PASS", "FAIL"])
def test_the_chance_of_a_verdict_at_any_flight_is_the_sum_over_all_counts(status):
    reached = [[judge(k, n, 0.9, 0.2).status == status for k in range(n + 1)] for n in range(1, 91)]
    for rate in (0.02, 0.12, 0.3):
        chance, shares = 0.0, np.ones(1)
        for ends in reached:
            shares = np.convolve(shares, [1.0 - rate, rate])
            chance += shares[ends].sum()
            shares[ends] = 0.0
        assert ever_chance(90, 0.9, 0.2, np.array([rate]), status) == pytest.approx(chance)


@pytest.mark.parametrize(("status", "rate"), [("PASS", 0.092), ("FAIL", 0.11)])
def test_the_chance_from_400_of_all_counts_is_a_close_lower_bound(monkeypatch, status, rate):
    arguments = 6000, 0.9, 0.2, np.array([rate]), status
    bound = ever_chance(*arguments)[0]
    monkeypatch.setattr("abhv_mc.statistics.flights_planned._MOST_LOOKS", 10**6)
    exact = ever_chance(*arguments)[0]
    assert exact - 0.02 <= bound < exact < 0.6


def test_all_together_lies_between_the_bounds():
    chance_a, chance_b = np.array([0.9, 0.3]), np.array([0.8, 0.2])
    low, high = together([chance_a, chance_b])
    assert low == pytest.approx([0.7, 0.0]) and high == pytest.approx([0.8, 0.2])
    assert np.all(low <= chance_a * chance_b) and np.all(chance_a * chance_b <= high)
