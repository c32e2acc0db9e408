"""False alarms and detections of `import flights`: python benchmarks/table_checks.py [--smoke]

Valid tables contain independent draws from one of seven distributions, or from all seven with a
correlation of 0.9 for one pair, an input that has its nominal value in 95 % of the flights, and a
level of 0.1 %. The values have all digits, or are rounded to 4, 3 or 2 digits.
"""

import sys
from collections import Counter
from itertools import chain, cycle, islice, product

import numpy as np

from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    MixtureMarginal,
    SometimesMarginal,
    find_moments,
    outside,
)
from abhv_mc.execution.table_import import make_column
from abhv_mc.statistics.table_checks import RISK, check_table, half_steps

LAWS = {
    "uniform": ContinuousMarginal("uniform", (-2.0, 4.0)),
    "normal": ContinuousMarginal("norm", (20.0, 0.5)),
    "truncated normal": ContinuousMarginal("truncnorm", (-1.234, 1.511, 0.0, 1.3)),
    "triangular": ContinuousMarginal("triang", (0.3, 7.0, 3.0)),
    "lognormal": ContinuousMarginal("lognorm", (0.5, 0.0, 3.0)),
    "beta": ContinuousMarginal("beta", (2.0, 5.0, 0.0, 1.0)),
    "Weibull": ContinuousMarginal("weibull_min", (1.5, 0.0, 2.0)),
}
ATOMS = {
    "sometimes": SometimesMarginal(ContinuousMarginal("norm", (0.0, 0.1)), 0.05, 0.0),
    "levels": DiscreteMarginal(np.array([0.123456, 1.0, 2.0]), np.array([0.001, 0.501, 1.0])),
    "mixture": MixtureMarginal(
        (ContinuousMarginal("norm", (10.0, 1.0)),
            DiscreteMarginal(np.array([9.0, 12.0]), np.array([0.5, 1.0]))),
        (0.8, 0.2),
    ),
}  # fmt: skip
CORRELATED = ("normal", "lognormal")
CORRELATION = 0.9  # of the normal variables
ROWS = 60, 300, 1000
DIGITS = None, 4, 3, 2


def draw(laws, rows, random, latin=False):
    """Draw values [row, input] and the correlation of their normal variables."""
    from scipy.special import ndtr, ndtri

    uniform = random.random((rows, len(laws)))
    if latin:
        strata = random.permuted(np.tile(np.arange(rows), (len(laws), 1)), axis=1).T
        uniform = (strata + uniform) / rows
    matrix = np.eye(len(laws))
    if set(CORRELATED) <= set(laws) and not latin:
        i, j = map(list(laws).index, CORRELATED)
        matrix[i, j] = matrix[j, i] = CORRELATION
        normal = ndtri(uniform)
        uniform[:, j] = ndtr(
            CORRELATION * normal[:, i] + (1.0 - CORRELATION**2) ** 0.5 * normal[:, j]
        )
    values = [law.ppf(uniform[:, k]) for k, law in enumerate(laws.values())]
    return np.column_stack(values), matrix


def rounded(values, digits):
    """Return values rounded to a number of significant digits."""
    if digits is None:
        return values
    return np.vectorize(lambda x: float(f"{x:.{digits - 1}e}"))(values)


def judge(laws, values, matrix, risk=RISK):
    """Return the decision of `import flights`: 'rejected', 'estimate' or 'verdict'."""
    columns = []
    for law, column in zip(laws.values(), values.T, strict=True):
        half = half_steps(column)
        if outside(law, column, half).any():
            return "rejected"
        columns.append(make_column(law, column, half))
    findings = check_table(columns, matrix, risk)
    if any(
        (findings.too_far, findings.levels, findings.correlations, findings.equal, findings.missing)
    ):
        return "rejected"
    return "estimate" if findings.too_close or findings.constant else "verdict"


def honest(tables, random, risk=RISK):
    """Print the results for valid tables."""
    laws, counts = LAWS | ATOMS, Counter()
    cases = chain.from_iterable(({name: law}, laws) for name, law in laws.items())
    settings = cycle(product(cases, ROWS, DIGITS))
    for k, (case, rows, digits) in enumerate(islice(settings, tables)):
        values, matrix = draw(case, rows, random)
        counts[result := judge(case, rounded(values, digits), matrix, risk)] += 1
        if result != "verdict":
            print(f"  table {k}: {rows} rows, {digits} digits, {', '.join(case)}: {result}")
    print(f"honest tables at a risk of {risk:g}: {dict(counts)}", flush=True)


def scaled(tables, random):
    """Print the share of tables of 60 rows that are detected if their spread is wrong by 3."""
    for factor, digits in product((1 / 3, 3), ("all", "sigma/10")):
        shares = {}
        for name, law in LAWS.items():
            mean, sigma = find_moments(law)
            for case in ({name: law}, LAWS):
                caught = 0
                for _ in range(tables):
                    values, matrix = draw(case, 60, random)
                    j = list(case).index(name)
                    values[:, j] = mean + factor * (values[:, j] - mean)
                    if digits != "all":  # steps of the next decimal below a tenth of sigma
                        values[:, j] = np.round(values[:, j], int(np.ceil(1.0 - np.log10(sigma))))
                    caught += judge(case, values, matrix) != "verdict"
                shares[f"{name}, {len(case)} inputs"] = caught / tables
        least = min(shares, key=shares.get)
        print(
            f"spread x {factor:.2g}, digits {digits}: found {shares[least]:.3f} at least ({least})",
            flush=True,
        )


def designs(tables, random):
    """Print the share of Latin hypercubes and of rows repeated four times without a verdict."""
    for rows in (30, 60, 300):
        latin = pasted = 0
        for _ in range(tables):
            values, matrix = draw(LAWS, rows, random, latin=True)
            latin += judge(LAWS, values, matrix) != "verdict"
            values, matrix = draw(LAWS, rows, random)
            pasted += judge(LAWS, np.tile(rounded(values, 4), (4, 1)), matrix) != "verdict"
        print(f"{rows} rows: Latin hypercube {latin / tables}, pasted four times {pasted / tables}")


def main():
    """Print all cases."""
    smoke = "--smoke" in sys.argv[1:]
    random = np.random.default_rng(31)
    honest(30 if smoke else 2000, random)
    honest(30 if smoke else 500, random, risk=0.01)
    scaled(1 if smoke else 40, random)
    designs(1 if smoke else 20, random)


if __name__ == "__main__":
    main()
