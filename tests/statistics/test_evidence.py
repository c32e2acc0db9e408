"""The e-values against integrals in 30 digits, to ten million flights."""

import pytest
from mpmath import mp, mpf

from abhv_mc.statistics.evidence import log_fail_evidence, log_pass_evidence


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
