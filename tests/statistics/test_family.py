"""Nine verdicts on boundary systems: the chance of any false PASS stays within the family's risk."""

import numpy as np

from abhv_mc.statistics.family import hold_family, holm, judge_family
from abhv_mc.statistics.verdicts import judge

AT = 0.9, 0.10
CAMPAIGNS = 2000


def test_holm_keeps_the_familys_risk():
    counts = np.random.default_rng(72).binomial(380, 0.1, (CAMPAIGNS, 9))
    judged = {k: judge(k, 380, *AT) for k in range(81)}
    alone = np.mean([any(judged[k].status == "PASS" for k in row) for row in counts.tolist()])
    held = [hold_family([judged[k] for k in row], 0.10) for row in counts.tolist()]
    together = np.mean([any(verdict.status == "PASS" for verdict in row) for row in held])
    assert together < alone / 3.0 and 0.0 < together <= 0.10


def test_holm_passes_more_than_bonferroni():
    good, last = judge(0, 200, *AT), judge(10, 230, *AT)
    assert 0.1 / 9 < last.p_value <= 0.1
    assert [verdict.status for verdict in hold_family([good] * 8 + [last], 0.10)] == ["PASS"] * 9
    dropped = hold_family([judge(20, 200, *AT)] * 8 + [last], 0.10)[-1]
    assert dropped.status == "NOT SHOWN" and "PASS alone" in dropped.note


def test_holm_is_the_published_procedure():
    # Holm 1979: sorted p-values against risk/m, risk/(m-1), ...; the first that fails stops all after it.
    assert holm([0.01, 0.04, 0.03, 0.005], 0.05) == [True, False, False, True]
    assert holm([0.04, 0.04], 0.05) == [False, False]
    assert holm([], 0.05) == []


def test_fail_stays_and_dependent_flights_get_no_verdict():
    failed = judge(100, 200, *AT)
    assert hold_family([failed, failed], 0.01) == [failed, failed]
    passed = [[judge(0, 5000, *AT)]]
    assert judge_family(passed, family_risk=0.01)[0][0].status == "PASS"
    assert judge_family(passed, independent=False, family_risk=0.01)[0][0].status == "ESTIMATE"
