"""Rank correlations of discrete inputs, and correlations that contradict each other."""

import math
import re

import numpy as np
import pytest
import yaml
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.correlations import normal_correlation
from abhv_mc.campaign.sampling.designs import make_copula
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    MixtureMarginal,
)
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.io.documents import Refusal
from abhv_mc.io.input_error import InputError

NORMAL = ContinuousMarginal("norm", (0.0, 1.0))
RARE = DiscreteMarginal(np.array([0.0, 1.0]), np.array([0.95, 1.0]))
LEVELS = DiscreteMarginal(np.arange(4.0), np.array([0.05, 0.45, 0.7, 1.0]))
MIXTURE = MixtureMarginal((NORMAL, DiscreteMarginal(np.array([0.0]), np.ones(1))), (0.4, 0.6))


@pytest.mark.parametrize(
    ("pair", "rank"),
    [
        ((LEVELS, NORMAL), 0.8),
        ((LEVELS, LEVELS), -0.6),
        ((MIXTURE, LEVELS), 0.5),
        ((RARE, NORMAL), 0.3),
        ((RARE, RARE), 0.7),
        ((NORMAL, MIXTURE), -0.7),
    ],
)
def test_samples_of_discrete_inputs_have_the_stated_rank_correlation(pair, rank):
    copula = make_copula("ab", {("a", "b"): normal_correlation(rank, pair)})
    uniform = copula.apply(np.random.default_rng(1).random((20_000, 2)))
    values = [marginal.ppf(column) for marginal, column in zip(pair, uniform.T, strict=True)]
    assert stats.spearmanr(*values).statistic == pytest.approx(rank, abs=0.03)


def test_bounds_of_discrete_inputs_are_named_and_continuous_inputs_retain_their_bits():
    with pytest.raises(Refusal) as refusal:
        normal_correlation(0.8, (RARE, NORMAL))
    bound = 3.0**0.5 * (0.05 * 0.95) ** 0.5
    assert f"-{bound:.3f} to {bound:.3f}" in refusal.value.expected
    for rank in (-0.9, 0.0, 0.3):
        assert normal_correlation(rank, (NORMAL, NORMAL)) == 2.0 * math.sin(math.pi / 6.0 * rank)


NAMES = ("aero.lift", "aero.drag", "mass.total", "atmosphere.density")
LAWS = [{"distribution": "normal", "sigma": "5 %"}] * 3
LAWS += [{"distribution": "discrete", "values": [0.9, 1.0, 1.1]}]


def campaign(folder, *ranks):
    """Write a campaign with correlations (first, second, rank) of the parameters in NAMES."""
    entries = [{"between": [NAMES[i], NAMES[j]], "rank": rank} for i, j, rank in ranks]
    dispersions = dict(zip(NAMES, LAWS, strict=True))
    return write_campaign(
        folder, dispersions=yaml.safe_dump(dispersions, default_flow_style=True),
        correlations=yaml.safe_dump(entries, default_flow_style=True),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("ranks", "count"),
    [
        ([(0, 1, 0.9), (0, 2, 0.9), (1, 2, 0.5)], 1),
        ([(0, 1, 0.7), (1, 3, 0.7), (0, 3, -0.4)], 1),
        ([(0, 1, 0.9), (0, 2, 0.9), (1, 2, -0.9), (0, 3, 0.8)], 4),
    ],
)
def test_the_nearest_valid_correlations_are_named_and_accepted(tmp_path, ranks, count):
    with pytest.raises(InputError, match=r":\d+:\d+: .*positive definite") as error:
        read_campaign(campaign(tmp_path / "a", *ranks))
    named = re.findall(r"rank: (\S+) between '(\S+)' and '(\S+)'", str(error.value))
    assert len(named) == count
    changed = {(NAMES.index(first), NAMES.index(other)): value for value, first, other in named}
    valid = [(i, j, float(changed.get((i, j), rank))) for i, j, rank in ranks]
    read_campaign(campaign(tmp_path / "b", *valid))
    if count == 1:  # Half of the change is not enough.
        half = [
            (i, j, (rank + old) / 2.0) for (i, j, rank), (*_, old) in zip(valid, ranks, strict=True)
        ]
        with pytest.raises(InputError, match="positive definite"):
            read_campaign(campaign(tmp_path / "c", *half))


def test_a_folder_stores_the_solved_correlations_of_discrete_inputs(tmp_path):
    stated = read_campaign(campaign(tmp_path / "a", (0, 1, 0.5), (0, 3, 0.6)))
    inputs = collect_inputs(stated)
    continuous, discrete = inputs.data["correlations"]
    assert continuous == stated.document.entries["correlations"][0]
    assert discrete.keys() == {"between", "normal"} and discrete["normal"] > 0.62
    document = yaml.safe_load(stated.document.path.read_text())
    stored = tmp_path / "a" / "stored.yaml"
    stored.write_text(yaml.safe_dump(document | {"correlations": inputs.data["correlations"]}))
    rows = read_campaign(stored).make_samples().draw(0, 100)
    np.testing.assert_array_equal(rows, stated.make_samples().draw(0, 100))
