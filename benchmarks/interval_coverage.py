"""Coverage study of intervals on each side: python benchmarks/interval_coverage.py

The intervals are those of `tighten` in widened tails, and of differences of quantiles of dependent
pairs.
"""

import sys

import numpy as np
from scipy import stats

from abhv_mc.statistics.quantile_pairs import quantile_differences
from abhv_mc.statistics.reweight import (
    effective_size,
    join_unseen,
    unseen_of_range,
    weighted_quantile,
    weighted_share,
)

CAMPAIGNS = 2000
LEVELS = 0.5, 0.95, 0.9973


FAILS = {
    "sum": lambda x: x.sum(axis=1),
    "one": lambda x: x[:, 0],
    "radius": lambda x: np.sum(x**2, axis=1),
}


def whatif(fails, inputs, scale, flights, truth, campaigns=CAMPAIGNS, widened=True, shift=0.0):
    """Return the share of answered campaigns, and their misses of share and quantile.

    Misses are on each side. With ``widened`` the unobserved probability is included, as in
    `tighten`.
    """
    draw = np.random.default_rng(7)
    old, new = stats.norm(), stats.norm(shift, scale)
    limit = np.quantile(
        FAILS[fails](shift + scale * draw.standard_normal((2_000_000, inputs))), 1.0 - truth
    )
    answered, missed = 0, np.zeros((2, 2))
    for _ in range(campaigns):
        x = draw.standard_normal((flights, inputs))
        weights = np.exp(0.5 * np.sum(x**2 - ((x - shift) / scale) ** 2, axis=1)) / scale**inputs
        parts = []
        for column in x.T:
            ends = np.array([column.min(), column.max()])
            beyond = float(new.cdf(ends[0])), float(new.sf(ends[1]))
            parts.append(unseen_of_range(beyond, tuple(new.pdf(ends) / old.pdf(ends)), flights))
        unseen = join_unseen(parts)
        if max(unseen.single, unseen.joint) > 0.01 or effective_size(weights) < max(
            100, flights / 2
        ):
            continue
        values, answered = FAILS[fails](x), answered + 1
        joint = unseen.joint if widened else 0.0
        share = weighted_share(values > limit, weights, joint)
        quantile = weighted_quantile(values, weights, 1.0 - truth, joint)
        missed[0] += share.low > truth, share.high < truth
        missed[1] += quantile.low > limit, quantile.high < limit
    return answered / campaigns, missed / max(answered, 1)


def differences(description, law, size, together, campaigns):
    """Print how often the true difference of quantiles is outside its interval on each side.

    The shares are those of the worst level.
    """
    normal = np.random.default_rng(8).standard_normal((2, campaigns, size))
    normal[1] = together * normal[0] + np.sqrt(1.0 - together**2) * normal[1]
    a, b = law(stats.norm.cdf(normal))
    b = 2.0 * b
    missed = np.zeros((2, len(LEVELS)))
    for sample, other_sample in zip(a, b, strict=True):
        for k, interval in enumerate(quantile_differences(sample, other_sample, LEVELS)):
            truth = -float(law(LEVELS[k]))
            missed[:, k] += truth < interval.low, truth > interval.high
    print(
        f"difference, {description}, {size} pairs, correlation {together:+.1f}: "
        f"{missed.max(axis=1) / campaigns}"
    )


def main():
    """Print all cases."""
    campaigns = 2 if sys.argv[1:] == ["--smoke"] else CAMPAIGNS
    for case in (
        *(("sum", 3, 1.2, 2000, truth) for truth in (3.8e-3, 1e-3, 2e-2)),
        ("one", 3, 1.2, 2000, 3.8e-3),
        ("radius", 3, 1.2, 2000, 3.8e-3),
        ("sum", 5, 1.1, 1000, 3.8e-3),
    ):
        answered, (share, quantile) = whatif(*case, campaigns)
        description = "whatif {}, {} inputs, sigma x {}, {} flights, P {:g}".format(*case)
        print(
            f"{description}: answers {answered:.2f}; truth below and above the share's {share}, "
            f"the quantile's {quantile}"
        )
    answered, (share, quantile) = whatif(
        "one", 1, 1.0, 2000, 3.8e-3, campaigns=campaigns, shift=0.8
    )
    print(
        f"whatif one input, mean + 0.8 sigma, 2000 flights, P 0.0038: answers {answered:.2f}; "
        f"truth below and above the share's {share}, the quantile's {quantile}"
    )
    laws = {"normal": stats.norm.ppf, "t3": stats.t(3).ppf, "lognormal": stats.lognorm(1.0).ppf}
    laws["discrete"] = lambda p: np.floor(2.0 * stats.lognorm(1.0).ppf(p))
    for description, law in laws.items():
        for size in (30, 100, 1000):
            for together in (-1.0, -0.5, 0.0, 0.5, 0.9, 1.0):
                differences(description, law, size, together, campaigns)


if __name__ == "__main__":
    main()
