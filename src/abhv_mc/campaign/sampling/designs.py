"""Uniform random numbers for the flights: random streams, sampling designs and copulas.

A random number depends only on a seed, a parameter name and a flight number. The seed and the name
are the key of a counter-based Philox generator, and the flight number is its counter (Salmon et
al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011). The numbers of flight k therefore do
not depend on the number or order of flights, on other parameters or on neighbouring seeds.

A design assigns a probability in [0, 1] to each flight and parameter, which the inverse of the
parameter's distribution converts to a value. With ``random``, ``sobol`` and ``halton``, flight k
has the same numbers for any number of flights. With the other designs, the numbers depend on the
number of flights; for ``corners``, ``grid`` and ``one_at_a_time``, the parameters determine this
number.

A Gaussian copula correlates samples and preserves the marginals: the Cholesky factor of the
correlation matrix combines the standard normal variables of a flight. Correlations of normal
variables yield the stated rank correlations of parameters.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import Marginal, clip_probabilities, find_atoms
from abhv_mc.flights.parameters import Parameters
from abhv_mc.io.messages import Refusal, quoted

_LARGEST = 1.0 - 1e-6  # largest normal correlation of discrete values
_POINTS = 14  # binary logarithm of the number of Sobol points
_STEP = 1e-3  # resolution of valid correlations, and smallest eigenvalue of their matrix
_PROJECTIONS = 500


def is_discrete(marginals: Sequence[Marginal]) -> bool:
    """Return whether any of the marginals has values with positive probability."""
    return any(find_atoms(marginal).size for marginal in marginals)


def normal_correlation(rank: float, marginals: Sequence[Marginal]) -> float:
    """Return the normal correlation that yields a rank correlation of two parameters.

    The ranks of equal values are averaged. For continuous marginals, the normal correlation of a
    rank correlation rho is 2 sin(pi rho / 6) (Kruskal, JASA 53, 1958). For discrete values it is
    the root of the rank correlation over Sobol points (NORTA: Cario & Nelson 1997).
    Raise Refusal if the discrete values do not permit the rank correlation.
    """
    if not rank or not is_discrete(marginals):
        return 2.0 * math.sin(math.pi / 6.0 * rank)
    from scipy.optimize import brentq
    from scipy.special import ndtr, ndtri
    from scipy.stats import qmc, spearmanr

    first, second = ndtri(qmc.Sobol(2, rng=np.random.default_rng(0)).random_base2(_POINTS).T)
    values = marginals[0].ppf(ndtr(first))

    def error(normal: float) -> float:
        mixed = normal * first + math.sqrt(1.0 - normal**2) * second
        return float(spearmanr(values, marginals[1].ppf(ndtr(mixed))).statistic) - rank

    ends = error(-_LARGEST), error(_LARGEST)
    if not ends[0] < 0.0 < ends[1]:
        low, high = (f"{end + rank - math.copysign(5e-4, end + rank):.3f}" for end in ends)
        problem = f"the discrete values do not permit the rank correlation {rank:g}"
        raise Refusal(problem, f"a rank correlation from {low} to {high}", ("rank",))
    return round(brentq(error, -_LARGEST, _LARGEST, xtol=1e-8), 6)


def nearest_valid(names: Sequence[str], matrix: Floats) -> str:
    """Return the nearest correlations for which `matrix` [name, name] is positive definite.

    The result names one pair if a change of its correlation suffices; otherwise it lists the
    nearest matrix with the same zeros (Frobenius norm; N. Higham, IMA Journal of Numerical Analysis
    22, 2002).
    """
    pairs, values = np.argwhere(np.triu(matrix, 1)).tolist(), np.arange(_STEP - 1.0, 1.0, _STEP)
    changes = []
    for i, j in pairs:
        changed = np.repeat(matrix[None], len(values), axis=0)
        changed[:, i, j] = changed[:, j, i] = values
        for value in values[np.linalg.eigvalsh(changed)[:, 0] > _STEP]:
            changes.append((abs(value - matrix[i, j]), i, j, value))
    entries = [min(changes)[1:]] if changes else []
    if not entries:
        nearest, correction = matrix, np.zeros_like(matrix)
        for _ in range(_PROJECTIONS):  # Dykstra's alternating projections
            eigenvalues, vectors = np.linalg.eigh(nearest - correction)
            positive = (vectors * np.maximum(eigenvalues, _STEP * len(names))) @ vectors.T
            correction += positive - nearest
            nearest = np.where(matrix * (1.0 - np.eye(len(names))), positive, matrix)
        entries = [(i, j, nearest[i, j]) for i, j in pairs]
    return "; ".join(
        f"normal: {value:.3f} between {quoted((names[i], names[j]))}" for i, j, value in entries
    )


INDEPENDENT = "random"  # design whose flights are independent, as binomial statistics require
EXTENSIBLE = frozenset(
    {"random", "sobol", "halton", "file"}
)  # designs in which additional flights do not change the samples of earlier flights
FACTORIAL = frozenset({"corners", "grid", "one_at_a_time"})

_BITS = 30  # number of bits of a Sobol point, which limits designs to 2**30 flights
_PIECE = 4096  # number of points drawn together; Sobol sequences require a power of two
NOMINAL = -1.0  # marks a nominal value in a factorial design
_WORDS = 4  # number of 64-bit words of one Philox4x64 counter value


def stream_key(seed: int, name: str, purpose: str = "sample") -> int:
    """Return the 128-bit key of a random stream."""
    text = f"abhv-mc stream 1|{purpose}|{seed}|{name}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "little")


def draw_uniforms(key: int, first: int, count: int) -> Floats:
    """Draw numbers [flight] in (0, 1) for flights ``first`` to ``first + count - 1``."""
    generator = np.random.Philox(key=key)
    generator.advance(first)
    raw_numbers = generator.random_raw(_WORDS * count)[::_WORDS]
    return (raw_numbers >> np.uint64(12)).astype(np.float64) * 2.0**-52 + 2.0**-53


def make_generator(seed: int, name: str, purpose: str) -> np.random.Generator:
    """Return the random generator for the scrambling and permutations of a design."""
    return np.random.Generator(
        np.random.Philox(np.random.SeedSequence(stream_key(seed, name, purpose)))
    )


@dataclass(frozen=True)
class Design:
    """Sampling design for named parameters."""

    kind: str
    seed: int
    names: tuple[str, ...]
    flights: int
    levels: int = 2  # number of values per parameter; ``one_at_a_time`` adds a nominal flight
    # parameters whose order determines the dimensions of the designs 'sobol' and 'halton'
    parameters: Parameters = field(default_factory=lambda: Parameters(()))

    def draw(self, first: int, stop: int) -> Floats:
        """Return probabilities [flight, parameter] for the flights ``first`` to ``stop - 1``."""
        flights, number = np.arange(first, stop), len(self.names)
        levels = 2 if self.kind == "corners" else self.levels
        if self.kind == "one_at_a_time":
            # One parameter at a time varies; flight 0 is nominal. Entries are shares of the range.
            rows = np.full((len(flights), number), NOMINAL)
            (moved,) = np.nonzero(flights)
            which, level = np.divmod(flights[moved] - 1, levels)
            rows[moved, which] = level / (levels - 1)
            return rows
        if self.kind in FACTORIAL:  # In a full factorial design, the last parameter varies fastest.
            powers = levels ** np.arange(number - 1, -1, -1)
            return flights[:, None] // powers % levels / (levels - 1)
        columns = [self._column(name, first, stop) for name in self.names]
        return np.column_stack(columns) if columns else np.empty((stop - first, 0))

    def _column(self, name: str, first: int, stop: int) -> Floats:
        """Return the probabilities [flight] of one parameter."""
        if self.kind == INDEPENDENT:
            return draw_uniforms(stream_key(self.seed, name), first, stop - first)
        from scipy.stats import qmc

        if self.kind == "lhs":  # Latin hypercube (McKay, Beckman & Conover 1979)
            rng = make_generator(self.seed, name, "latin hypercube")
            return clip_probabilities(
                qmc.LatinHypercube(d=1, rng=rng).random(self.flights)[first:stop, 0]
            )
        # The dimension of the sequence is the parameter's index in the table of parameters, and the
        # scrambling depends on the seed and the parameter's name. The column therefore does not
        # depend on other parameters of the campaign. Only the sampler's last dimension is used.
        dimension = self.parameters.dispersible.index(name) + 1
        rng = make_generator(self.seed, name, self.kind)
        if self.kind == "sobol":  # Sobol sequence (Joe & Kuo 2008), scrambled (Matousek 1998)
            sampler = qmc.Sobol(d=dimension, bits=_BITS, rng=rng)
            return _slice(sampler, first, stop) + 0.5 ** (_BITS + 1)
        # Halton sequence with digit permutations (Owen 2017)
        return clip_probabilities(_slice(qmc.Halton(d=dimension, rng=rng), first, stop))


def count_flights(kind: str, parameters: int, levels: int) -> int | None:
    """Return the number of flights of a factorial design, or None for other designs."""
    if kind == "corners":
        return 2**parameters
    if kind == "grid":
        return levels**parameters
    if kind == "one_at_a_time":
        return 1 + levels * parameters
    return None


def _slice(sampler: Any, first: int, stop: int) -> Floats:
    """Return the last coordinate of points ``first`` to ``stop - 1``, drawn in batches."""
    start = first - first % _PIECE
    if start:
        sampler.fast_forward(start)
    pieces = [sampler.random(_PIECE)[:, -1] for _ in range(start, stop, _PIECE)]
    return np.concatenate(pieces)[first - start : stop - start] if pieces else np.empty(0)


@dataclass(frozen=True)
class Copula:
    """Gaussian copula: columns and the Cholesky factor of their correlation matrix."""

    columns: tuple[int, ...]
    factor: Floats  # [column, column]

    def correlations(self, count: int) -> Floats:
        """Return the correlation matrix of the normal variables of `count` columns."""
        matrix = np.eye(count)
        if self.columns:
            matrix[np.ix_(self.columns, self.columns)] = self.factor @ self.factor.T
            matrix[np.abs(matrix) < 1e-12] = 0.0
        return matrix

    def apply(self, probabilities: Floats) -> Floats:
        """Return correlated probabilities [flight, parameter].

        Columns outside the copula are unchanged.
        """
        from scipy.special import ndtr, ndtri

        if not self.columns:
            return probabilities
        normal = [ndtri(probabilities[:, column]) for column in self.columns]
        mixed = probabilities.copy()
        for row, column in enumerate(self.columns):
            # Sum term by term, because rounding in BLAS depends on the number of flights.
            total = self.factor[row, 0] * normal[0]
            for k in range(1, row + 1):
                total += self.factor[row, k] * normal[k]
            mixed[:, column] = clip_probabilities(ndtr(total))
        return mixed


def make_copula(names: Sequence[str], pairs: dict[tuple[str, str], float]) -> Copula:
    """Return the copula with the given pairwise correlations of normal variables.

    Raise Refusal with the nearest valid correlations if the matrix is not positive definite.
    """
    columns = tuple(i for i, name in enumerate(names) if any(name in pair for pair in pairs))
    index = {names[column]: row for row, column in enumerate(columns)}
    matrix = np.eye(len(columns))
    for (first, other), value in pairs.items():
        matrix[index[first], index[other]] = matrix[index[other], index[first]] = value
    if columns and np.linalg.eigvalsh(matrix)[0] < 1e-9:
        valid = nearest_valid([names[column] for column in columns], matrix)
        problem = "the matrix of normal correlations is not positive definite"
        raise Refusal(problem, f"the nearest valid correlation: {valid}")
    return Copula(
        columns, np.asarray(np.linalg.cholesky(matrix) if columns else matrix, np.float64)
    )
