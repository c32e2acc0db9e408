"""Moments, possible values and atoms of distributions."""

import numpy as np
import pytest

from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    MixtureMarginal,
    SometimesMarginal,
    find_atoms,
    find_moments,
    outside,
)

UNIFORM = ContinuousMarginal("uniform", (2.0, 4.0))
LEVELS = DiscreteMarginal(np.array([0.0, 3.0, 8.0]), np.array([0.25, 0.75, 1.0]))
MIXTURE = MixtureMarginal((UNIFORM, LEVELS), (0.4, 0.6))


@pytest.mark.parametrize("marginal", [
    UNIFORM, ContinuousMarginal("norm", (1.0, 3.0)), ContinuousMarginal("gamma", (3.0, 1.0)),
    LEVELS, MIXTURE, SometimesMarginal(MIXTURE, 0.2, -5.0),
])  # fmt: skip
def test_moments_are_those_of_the_quantiles(marginal):
    values = marginal.ppf((np.arange(50_000) + 0.5) / 50_000)
    assert find_moments(marginal) == pytest.approx((values.mean(), values.std()), rel=2e-3)


def test_impossible_values_are_outside_and_positive_probabilities_are_atoms():
    values = np.array([1.9, 2.0 - 3e-9, 2.0, 3.1, 6.1, 8.0, -5.0, 0.0])
    sometimes = SometimesMarginal(MIXTURE, 0.2, -5.0)
    for marginal, expected in (
        (UNIFORM, [1, 0, 0, 0, 1, 1, 1, 1]),
        (LEVELS, [1, 1, 1, 1, 1, 0, 1, 0]),
        (MIXTURE, [1, 0, 0, 0, 1, 0, 1, 0]),
        (sometimes, [1, 0, 0, 0, 1, 0, 0, 0]),
    ):
        assert outside(marginal, values).tolist() == [bool(flag) for flag in expected]
    assert not outside(sometimes, values, 0.11).any()
    assert find_atoms(sometimes).tolist() == [-5.0, 0.0, 3.0, 8.0] and not find_atoms(UNIFORM).size
