"""Tests of whether the rows of a table are independent draws of stated distributions.

A table rounds its values, so each value represents an interval of its distribution function, and
each test uses the point of the interval that is most favourable to the table. The probability that
any test rejects a table of independent draws is about 1e-6. The test for missing extremes uses the
probability that all of n draws lie within the range of the column, and allows for a whole step of
rounding.

Sources: the exact Kolmogorov-Smirnov test (Simard & L'Ecuyer, J. Stat. Softw. 39(11), 2011) for
columns that are too far from their distributions, or closer to them than chance allows; the sum of
squared normal scores, which is chi-squared for independent draws; exact binomial tests for values
of positive probability (Clopper & Pearson, Biometrika 26, 1934); Fisher's z for rank correlations,
with the variance of Bonett & Wright (Psychometrika 65, 2000) about their mean in a Gaussian copula
(Moran, Biometrika 35, 1948); the Poisson distribution of coincidences for equal rows (Arratia,
Goldstein & Gordon, Ann. Probab. 17, 1989).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import bdtr, bdtrc, chdtr, chdtrc, ndtr, ndtri, pdtrc

from abhv_mc.array_types import Floats, Mask

RISK = 1e-6  # risk of rejecting a table of independent draws
_DIGITS = 15  # number of significant decimal digits of a double-precision number
_SOME = 1000  # number of rows whose digits are counted first
_SLACK = 1e-12  # relative rounding error of values converted from other units
_SINGLE = 1e-8  # relative error of 32-bit numbers written with 9 digits
_FEWEST_CORRELATED = 60  # minimum number of rows for Fisher's z
_MOST_CORRELATED = 20_000  # maximum number of ranked rows, enough to show correlations of 0.05
_LARGEST_CORRELATION = 0.95  # largest correlation at which the variance of Fisher's z is accurate


@dataclass(frozen=True)
class Column:
    """Input of a table with its stated distribution function F."""

    values: Floats  # values [row]
    half_step: Floats  # largest rounding error of each value [row]
    low: Floats  # F just below the smallest value that rounds to the row's value [row]
    high: Floats  # F at the largest value that rounds to the row's value [row]
    atoms: Floats  # values of positive probability [atom]
    shares: Floats  # probabilities of the atoms [atom]
    # probabilities of values below and above the column by more than one step of rounding
    tails: tuple[float, float] = (0.0, 0.0)

    @property
    def is_discrete(self) -> bool:
        """True if all values have positive probability."""
        return bool(self.shares.sum() > 1.0 - 1e-9)

    @property
    def continuous_rows(self) -> Mask:
        """Mask [row] of the rows whose values are not atoms."""
        near = np.full(len(self.values), self.is_discrete)
        for atom in self.atoms:
            near |= self._is_at(atom)
        return ~near

    def _is_at(self, atom: float) -> Mask:
        return np.abs(self.values - atom) <= self.half_step

    def count_atom(self, k: int) -> tuple[int, float]:
        """Return the number of rows at an atom, and the probability of its rounding interval."""
        rows = self._is_at(self.atoms[k])
        count = int(rows.sum())
        return count, float(self.high[rows].max() - self.low[rows].min()) if count else 0.0


@dataclass(frozen=True)
class Level:
    """Value whose frequency in a table contradicts its probability."""

    column: int
    value: float
    count: int  # number of rows
    probability: float


class PairCorrelation(NamedTuple):
    """Pair of columns whose rank correlation contradicts the stated correlation."""

    columns: tuple[int, int]
    found: float
    stated: float


class EqualRows(NamedTuple):
    """Pairs of equal rows that are more frequent than rounding explains."""

    pairs: int
    explained: float  # number of pairs that rounding explains
    example: tuple[int, int]  # indices of two equal rows


class TableFindings(NamedTuple):
    """Contradictions between a table and the claim that its rows are independent draws."""

    too_far: tuple[int, ...]  # columns that deviate too much from their distributions
    levels: tuple[Level, ...]
    correlations: tuple[PairCorrelation, ...]
    equal: EqualRows | None
    # columns that follow their distributions more closely than random draws
    too_close: tuple[int, ...]
    constant: tuple[int, ...]  # columns with a single value, which rounding may explain
    missing: tuple[tuple[int, int], ...]  # columns without small (0) or large (1) values


def half_steps(values: Floats) -> Floats:
    """Return the largest rounding error of each value of a column [row].

    The error is half the finest decimal step among values of the same power of ten, which allows
    for rounding to a fixed number of decimals or of significant digits. Zeros get the finest step
    of the column. The steps of columns of 32-bit numbers are at least those of such numbers.
    """
    size = np.abs(values)
    used = size > 0.0
    exponent = np.floor(np.log10(size[used])).astype(np.int64)
    powers, group = np.unique(exponent, return_inverse=True)
    finest = np.ones(powers.size, np.int64)
    for rows in np.split(np.arange(exponent.size), [_SOME]):
        left = rows[finest[group[rows]] < _DIGITS]  # Other powers have the finest step already.
        for k in range(_DIGITS - 1):
            finest[group[left]] = np.maximum(finest[group[left]], k + 1)
            scaled = size[used][left] * 10.0 ** (k - exponent[left])
            left = left[np.abs(scaled - np.rint(scaled)) > 1e-15 * scaled]
        finest[group[left]] = _DIGITS
    steps = 10.0 ** (powers - finest + 1)
    result = np.full(size.shape, steps.min(initial=np.inf) if powers.size else 0.0)
    result[used] = steps[group]
    single = values.astype(np.float32)
    if np.all(np.abs(single - values) <= _SINGLE * size):
        result = np.maximum(result, np.spacing(np.abs(single)))
    return np.maximum(0.5 * result, _SLACK * size)


def check_table(
    columns: Sequence[Column], correlation: Floats, risk: float = RISK
) -> TableFindings:
    """Test the claim that the rows of a table are independent draws.

    `correlation` [column, column] is the correlation matrix of the Gaussian copula. The tests of
    columns and pairs share `risk` (Bonferroni); the tests for equal rows and for missing extremes
    have an additional risk of `risk` each.
    """
    smooth = [j for j, column in enumerate(columns) if not column.is_discrete]
    levels = [(j, k) for j, column in enumerate(columns) for k in range(column.atoms.size)]
    n = len(columns[0].values) if columns else 0
    pairs = [(i, j) for j in range(len(columns)) for i in range(j) if n >= _FEWEST_CORRELATED]
    pairs = [pair for pair in pairs if abs(correlation[pair]) <= _LARGEST_CORRELATION]
    total_risk, risk = risk, risk / max(4 * len(smooth) + 2 * len(levels) + len(pairs), 1)
    far, close = [], []
    for j in smooth:
        least, most = distance_p_values(columns[j].low, columns[j].high)
        if min(least, *spread_p_values(columns[j].low, columns[j].high)) < risk:
            far.append(j)
        elif most < risk:
            close.append(j)
    constant = [
        j
        for j in smooth
        if n > 1
        and j not in far
        and np.ptp(columns[j].values) == 0.0
        and columns[j].continuous_rows.any()
    ]
    return TableFindings(
        too_far=tuple(far),
        levels=tuple(
            level for position in levels if (level := _check_level(columns, *position, risk=risk))
        ),
        correlations=tuple(_check_correlations(columns, correlation, pairs, risk)),
        equal=_check_equal(columns, correlation, total_risk) if n else None,
        too_close=tuple(close),
        constant=tuple(constant),
        missing=tuple(
            (j, side)
            for j in smooth
            for side, tail in enumerate(columns[j].tails)
            if (1.0 - tail) ** n < total_risk / (2 * len(smooth))
        ),
    )


def distance_p_values(low: Floats, high: Floats) -> tuple[float, float]:
    """Return Kolmogorov-Smirnov p-values for values too far from, or too close to, F.

    Each value is placed at the point of its interval `low` .. `high` [row] that gives the larger
    p-value.
    """
    from scipy.stats import kstwo

    n = len(low)
    low, high, rank = np.sort(low), np.sort(high), np.arange(n)
    least = max(np.max((rank + 1) / n - high), np.max(low - rank / n))
    most = max(np.max((rank + 1) / n - low), np.max(high - rank / n))
    return float(kstwo.sf(least, n)), float(kstwo.cdf(most, n))


def spread_p_values(low: Floats, high: Floats) -> tuple[float, float]:
    """Return p-values of the sum of squared normal scores being too small or too large."""
    ends = ndtri(np.clip([low, high], 0.0, 1.0)) ** 2
    n, most = len(low), float(ends.max(axis=0).sum())
    least = float(np.where((low <= 0.5) & (high >= 0.5), 0.0, ends.min(axis=0)).sum())
    return float(chdtr(n, most)), float(chdtrc(n, least))


def _check_level(columns: Sequence[Column], j: int, k: int, *, risk: float) -> Level | None:
    column, n = columns[j], len(columns[j].values)
    (count, near), share = column.count_atom(k), float(column.shares[k])
    many = count > 0 and bdtrc(count - 1, n, min(near, 1.0)) < risk
    few = count < n and bdtr(count, n, share) < risk
    return Level(j, float(column.atoms[k]), count, share) if many or few else None


def _check_correlations(
    columns: Sequence[Column], correlation: Floats, pairs: Sequence[tuple[int, int]], risk: float
) -> list[PairCorrelation]:
    """Compare rank correlations with the stated correlations; ties may be in any order."""
    # Evenly spaced rows are used, because a table may be sorted.
    values = [v[:: -(-v.size // _MOST_CORRELATED)] for v in (column.values for column in columns)]
    contradictions = []
    for i, j in pairs:
        n, normal = len(values[i]), float(correlation[i, j])
        # mean rank correlation of n pairs of normal variables (Moran 1948), and its limit for large
        # n
        mean = np.arcsin(normal) + (n - 2) * np.arcsin(0.5 * normal)
        mean, stated = 6.0 / np.pi * mean / (n + 1), 6.0 / np.pi * np.arcsin(0.5 * normal)
        least, most = (_rank_correlation(values[i], sign * values[j]) * sign for sign in (-1, 1))
        nearest = float(np.clip(mean, least, most))
        sigma = np.sqrt((1.0 + 0.5 * stated**2) / (n - 3))
        distance = abs(np.arctanh(np.clip(nearest, -1 + 1e-12, 1 - 1e-12)) - np.arctanh(mean))
        if 2.0 * ndtr(-distance / sigma) < risk:
            contradictions.append(PairCorrelation((i, j), nearest, float(stated)))
    return contradictions


def _rank_correlation(x: Floats, y: Floats) -> float:
    """Return the largest Spearman correlation over all orders of tied values."""
    n, ranks = len(x), np.empty((2, len(x)))
    for rank, keys in zip(ranks, ((y, x), (x, y)), strict=True):
        rank[np.lexsort(keys)] = np.arange(n)
    return 1.0 - 6.0 * float(np.sum((ranks[0] - ranks[1]) ** 2)) / (n * (n**2 - 1.0))


def _check_equal(columns: Sequence[Column], correlation: Floats, risk: float) -> EqualRows | None:
    """Compare the number of equal rows with the number that rounding explains.

    Rows that are at an atom in every column are not counted. The probability that two rows round to
    the same values is the product of the columns' probabilities; of correlated columns, only the
    smallest probability is a factor.
    """
    rows = np.flatnonzero(np.logical_or.reduce([column.continuous_rows for column in columns]))
    n, alike, left = len(columns[0].values), np.ones(rows.size), set(range(len(columns)))
    while left:
        group = _connected(min(left), correlation)
        alike *= np.min([(columns[j].high - columns[j].low)[rows] for j in group], axis=0)
        left -= group
    explained = 0.5 * (n - 1) * float(alike.sum())
    table = np.column_stack([column.values[rows] for column in columns])
    ordered = np.sort(table[:, 0])
    tied = np.isin(table[:, 0], ordered[1:][ordered[1:] == ordered[:-1]])
    rows, table = rows[tied], table[tied]
    order = np.lexsort(table.T)
    equal = (table[order[1:]] == table[order[:-1]]).all(axis=1)
    if not equal.any():
        return None
    sizes = np.diff(np.flatnonzero(np.concatenate([[True], ~equal, [True]])))
    pairs = int(np.sum(sizes * (sizes - 1) // 2))
    if pdtrc(pairs - 1, 2.0 * explained) >= risk:
        return None
    first, second = sorted(rows[order[int(np.argmax(equal)) :][:2]].tolist())
    return EqualRows(pairs, explained, (first, second))


def _connected(start: int, correlation: Floats) -> set[int]:
    """Return the columns connected to `start` by a chain of correlations."""
    group, new = {start}, {start}
    while new:
        neighbours = np.flatnonzero((correlation[sorted(new)] != 0.0).any(axis=0))
        new = set(neighbours.tolist()) - group
        group |= new
    return group
