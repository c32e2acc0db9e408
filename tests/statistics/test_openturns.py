"""Exact statistics against OpenTURNS, which computes them from its own distributions."""

import warnings

import pytest

from abhv_mc.statistics import (
    consumer_risk,
    mcnemar_exact,
    quantile_upper_rank,
    runs_needed,
    success_lower_bound,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what its import says about itself on new Pythons
    ot = pytest.importorskip("openturns")
    experimental = pytest.importorskip("openturns.experimental")


@pytest.mark.parametrize("probability", [0.9, 0.99, 0.9973, 0.99865])
@pytest.mark.parametrize("failures", [0, 1, 2, 7])
def test_runs_needed_are_those_of_wilks(probability, failures):
    assert runs_needed(failures, probability, 0.10) == ot.Wilks.ComputeSampleSize(probability, 0.90, failures)


@pytest.mark.parametrize("probability", [0.5, 0.95, 0.9973, 0.99865])
@pytest.mark.parametrize("runs", [10, 100, 1000, 2000, 5000])
def test_upper_ranks(probability, runs):
    rank = experimental.QuantileConfidence(probability, 0.90).computeUnilateralRank(runs, False)  # from 0; runs: none
    assert quantile_upper_rank(runs, probability, 0.90) == (rank + 1 if rank < runs else None)


@pytest.mark.parametrize(("failures", "runs"), [(0, 1000), (2, 2000), (3, 2000), (40, 300)])
def test_bounds_and_risks_are_beta_and_binomial(failures, runs):
    beta = ot.Beta(runs - failures, failures + 1, 0.0, 1.0)
    assert success_lower_bound(failures, runs, 0.10) == pytest.approx(beta.computeScalarQuantile(0.10), abs=1e-12)
    for probability in (0.9, 0.9973):
        law = ot.Binomial(runs, 1.0 - probability)
        assert consumer_risk(failures, runs, probability) == pytest.approx(law.computeCDF(failures), rel=1e-9)


@pytest.mark.parametrize(("b", "c"), [(3, 12), (0, 5), (20, 31)])
def test_mcnemar_is_twice_the_binomial_tail(b, c):
    assert mcnemar_exact(b, c) == pytest.approx(2.0 * ot.Binomial(b + c, 0.5).computeCDF(min(b, c)), rel=1e-12)
