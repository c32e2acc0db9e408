"""Rank correlations of parameters, and the correlations of normal variables that yield them.

The ranks of equal values are averaged. For continuous marginals, the normal correlation of a rank
correlation rho is 2 sin(pi rho / 6) (Kruskal, JASA 53, 1958). For discrete values it is the root of
the rank correlation over Sobol points (NORTA: Cario & Nelson 1997).
"""

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import Marginal, find_atoms
from abhv_mc.io.documents import Refusal

_LARGEST = 1.0 - 1e-6  # largest normal correlation of discrete values
_POINTS = 14  # binary logarithm of the number of Sobol points
_STEP = 1e-3  # resolution of valid correlations, and smallest eigenvalue of their matrix
_PROJECTIONS = 500

Pair = tuple[str, str]


def is_discrete(marginals: Sequence[Marginal]) -> bool:
    """Return whether any of the marginals has values with positive probability."""
    return any(find_atoms(marginal).size for marginal in marginals)


def rank_correlation(normal: float, marginals: Sequence[Marginal]) -> float:
    """Return Spearman's rank correlation of two parameters with a given normal correlation."""
    from scipy.special import ndtr

    if not is_discrete(marginals):
        return 6.0 / math.pi * math.asin(0.5 * normal)
    first, second = _normal_points()
    mixed = normal * first + math.sqrt(1.0 - normal**2) * second
    ranks = map(_mid_ranks, marginals, (ndtr(first), ndtr(mixed)))
    return float(np.corrcoef([*ranks])[0, 1])


def normal_correlation(rank: float, marginals: Sequence[Marginal]) -> float:
    """Return the normal correlation that yields a rank correlation of two parameters.

    Raise Refusal if the discrete values do not permit the rank correlation.
    """
    from scipy.optimize import brentq

    if not rank or not is_discrete(marginals):
        return 2.0 * math.sin(math.pi / 6.0 * rank)
    low, high = (rank_correlation(end, marginals) for end in (-_LARGEST, _LARGEST))
    if not low < rank < high:
        bounds = f"{math.ceil(low / _STEP) * _STEP:.3f} to {math.floor(high / _STEP) * _STEP:.3f}"
        problem = f"the discrete values do not permit the rank correlation {rank:g}"
        raise Refusal(problem, f"a rank correlation from {bounds}", ("rank",))
    root = brentq(lambda r: rank_correlation(r, marginals) - rank, -_LARGEST, _LARGEST, xtol=1e-8)
    return round(root, 6)


def find_valid(pairs: Mapping[Pair, float]) -> dict[Pair, float]:
    """Return the nearest normal correlations whose matrix is positive definite.

    The result contains only one pair if a change of its correlation suffices; otherwise, it
    contains all pairs of the nearest matrix (Frobenius norm; Higham, IMA J. Numer. Anal. 22, 2002).
    """
    names = sorted({name for pair in pairs for name in pair})
    matrix, stated = np.eye(len(names)), np.zeros((len(names), len(names)), np.bool_)
    where = {pair: (names.index(pair[0]), names.index(pair[1])) for pair in pairs}
    for pair, (i, j) in where.items():
        matrix[i, j] = matrix[j, i] = pairs[pair]
        stated[i, j] = stated[j, i] = True
    values = np.arange(_STEP - 1.0, 1.0, _STEP)
    changes: list[tuple[float, Pair, float]] = []
    for pair, (i, j) in where.items():
        changed = np.repeat(matrix[None], len(values), axis=0)
        changed[:, i, j] = changed[:, j, i] = values
        valid = values[np.linalg.eigvalsh(changed)[:, 0] > _STEP]
        if valid.size:
            nearest = float(valid[np.argmin(np.abs(valid - pairs[pair]))])
            changes.append((abs(nearest - pairs[pair]), pair, nearest))
    if changes:
        _, pair, value = min(changes)
        return {pair: value}
    projected, correction = matrix, np.zeros_like(matrix)
    for _ in range(_PROJECTIONS):  # Dykstra's alternating projections
        shifted = projected - correction
        eigenvalues, vectors = np.linalg.eigh(shifted)
        positive = (vectors * np.maximum(eigenvalues, _STEP * len(names))) @ vectors.T
        correction, projected = positive - shifted, np.where(stated, positive, matrix)
    return {pair: float(projected[index]) for pair, index in where.items()}


@functools.cache
def _normal_points() -> tuple[Floats, Floats]:
    """Return Sobol points of two independent normal variables."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    first, second = ndtri(qmc.Sobol(2, rng=np.random.default_rng(0)).random_base2(_POINTS).T)
    return first, second


def _mid_ranks(marginal: Marginal, probability: Floats) -> Floats:
    """Return the mean probability of all values equal to the quantile at `probability`."""
    atoms = find_atoms(marginal)
    if not atoms.size:
        return probability
    low, high = marginal.cdf(np.nextafter(atoms, -np.inf)), marginal.cdf(atoms)
    index = np.minimum(np.searchsorted(high, probability), len(atoms) - 1)
    is_atom = (low[index] < probability) & (probability <= high[index])
    return np.where(is_atom, 0.5 * (low + high)[index], probability)
