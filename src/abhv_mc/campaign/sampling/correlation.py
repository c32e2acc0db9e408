"""Correlated samples by a Gaussian copula: the marginals stay what they are, flight k stays a function of k alone.

Probabilities become standard normal numbers, which the Cholesky factor of their correlation matrix mixes.
A rank correlation (Spearman's rho) belongs to the normal correlation 2 sin(pi rho / 6): Kruskal, JASA 53 (1958).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats


def normal_correlation(rank_correlation: float) -> float:
    """Correlation of the normal numbers that gives this rank correlation of the values."""
    return 2.0 * math.sin(math.pi / 6.0 * rank_correlation)


@dataclass(frozen=True)
class Copula:
    """Which columns are mixed, and the lower triangle that mixes them."""

    columns: tuple[int, ...]
    factor: Floats  # [column, column]

    def apply(self, probabilities: Floats) -> Floats:
        """Probabilities ``[flight, parameter]``, correlated; columns outside the copula keep every bit."""
        from scipy.special import ndtr, ndtri

        if not self.columns:
            return probabilities
        normal = [ndtri(probabilities[:, column]) for column in self.columns]
        mixed = probabilities.copy()
        for row, column in enumerate(self.columns):
            # Term by term, not by BLAS, whose rounding depends on how many flights are mixed at once.
            total = self.factor[row, 0] * normal[0]
            for k in range(1, row + 1):
                total += self.factor[row, k] * normal[k]
            mixed[:, column] = np.clip(ndtr(total), 2.0**-53, 1.0 - 2.0**-53)
        return mixed


def make_copula(names: Sequence[str], pairs: dict[tuple[str, str], float]) -> Copula:
    """Copula of correlations of normal numbers among columns. Raises numpy.linalg.LinAlgError where it is none."""
    columns = tuple(i for i, name in enumerate(names) if any(name in pair for pair in pairs))
    place = {names[column]: row for row, column in enumerate(columns)}
    matrix = np.eye(len(columns))
    for (one, other), value in pairs.items():
        matrix[place[one], place[other]] = matrix[place[other], place[one]] = value
    if columns and np.linalg.eigvalsh(matrix)[0] < 1e-9:
        raise np.linalg.LinAlgError("not positive definite")
    return Copula(columns, np.asarray(np.linalg.cholesky(matrix) if columns else matrix, np.float64))
