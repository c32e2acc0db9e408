"""Rank correlations of discrete inputs, and correlations that contradict each other."""

import math
import re

import numpy as np
import pytest
import yaml
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.designs import make_copula, normal_correlation
from abhv_mc.campaign.sampling.marginals import ContinuousMarginal, DiscreteMarginal
from abhv_mc.campaign.sampling.marginals import MixtureMarginal as Mixture
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.io.messages import Refusal

NORMAL = ContinuousMarginal("norm", (0.0, 1.0))
RARE = DiscreteMarginal(np.arange(2.0), np.array([0.95, 1.0]))
LEVELS = DiscreteMarginal(np.arange(4.0), np.array([0.05, 0.45, 0.7, 1.0]))


@pytest.mark.parametrize(
    ("first", "other", "rank"),
    [
        (LEVELS, NORMAL, 0.8),
        (RARE, RARE, 0.7),
        (NORMAL, Mixture((NORMAL, LEVELS), (0.4, 0.6)), -0.7),
    ],
)
def test_samples_of_discrete_inputs_have_the_stated_rank_correlation(first, other, rank):
    copula = make_copula("ab", {("a", "b"): normal_correlation(rank, (first, other))})
    x, y = copula.apply(np.random.default_rng(1).random((20_000, 2))).T
    assert stats.spearmanr(first.ppf(x), other.ppf(y)).statistic == pytest.approx(rank, abs=0.03)


def test_bounds_of_discrete_inputs_are_named_and_continuous_inputs_retain_their_bits():
    with pytest.raises(Refusal) as refusal:
        normal_correlation(0.8, (RARE, NORMAL))
    assert "-0.377 to 0.377" in refusal.value.expected  # sqrt(3 * 0.05 * 0.95), rounded down
    for rank in (-0.9, 0.3):
        assert normal_correlation(rank, (NORMAL, NORMAL)) == 2.0 * math.sin(math.pi / 6.0 * rank)


@pytest.mark.parametrize(
    ("pairs", "count"),
    [
        ({"ab": 0.9, "ac": 0.9, "bc": 0.5}, 1),
        ({"ab": 0.9, "ac": 0.9, "bc": -0.9, "ad": 0.8}, 4),
    ],
)
def test_the_nearest_valid_correlations_are_named_and_accepted(pairs, count):
    stated = {tuple(pair): value for pair, value in pairs.items()}
    with pytest.raises(Refusal, match="positive definite") as refusal:
        make_copula("abcd", stated)
    named = re.findall(r"normal: (\S+) between '(.)' and '(.)'", refusal.value.expected)
    valid = stated | {(first, other): float(value) for value, first, other in named}
    assert len(named) == count
    make_copula("abcd", valid)
    if count == 1:
        with pytest.raises(Refusal):
            make_copula("abcd", {pair: (valid[pair] + stated[pair]) / 2 for pair in stated})


def test_a_folder_stores_the_solved_correlations_of_discrete_inputs(tmp_path):
    lift, drag, mass = "aero.lift", "aero.drag", "mass.total"
    campaign = read_campaign(
        write_campaign(
            tmp_path,
            dispersions=f"{{{lift}: {{distribution: normal, sigma: 5 %}}, "
            f"{drag}: {{distribution: normal, sigma: 5 %}}, "
            f"{mass}: {{distribution: discrete, values: [0.9, 1.1]}}}}",
            correlations=f"[{{between: [{lift}, {drag}], rank: 0.5}}, "
            f"{{between: [{lift}, {mass}], rank: 0.6}}]",
        )
    )
    first, second = collect_inputs(campaign).data["correlations"]
    assert first == {"between": [lift, drag], "rank": 0.5} and second["normal"] > 0.65
    stored = tmp_path / "stored.yaml"
    stored.write_text(yaml.safe_dump(campaign.document.data, sort_keys=False))
    rows = [study.make_samples().draw(0, 100) for study in (read_campaign(stored), campaign)]
    np.testing.assert_array_equal(*rows)
