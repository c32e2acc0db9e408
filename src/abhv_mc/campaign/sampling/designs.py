"""The uniform numbers of a campaign's flights: how they are drawn, chosen by a design, and correlated by a copula.

Random numbers belong to a seed, a name and a flight, and to nothing else. Each (seed, name) keys its own counter-based
Philox generator and the flight's number is its counter. So flight k does not depend on how many flights there are or in
what order they are drawn, an added parameter shifts nothing, and neighbouring seeds share nothing. Salmon et al.,
"Parallel random numbers: as easy as 1, 2, 3", SC 2011.

A design gives for each flight and parameter a number in [0, 1], the probability at which the parameter's distribution
is read. ``random``, ``sobol`` and ``halton`` give flight k the same numbers however many flights there are; the others
depend on the number of flights, which for ``corners``, ``grid`` and ``one_at_a_time`` follows from the parameters.

A Gaussian copula correlates samples, while the marginals stay what they are and flight k a function of k alone:
probabilities become standard normal numbers, which the Cholesky factor of their correlation matrix mixes. A rank
correlation (Spearman's rho) belongs to the normal correlation 2 sin(pi rho / 6): Kruskal, JASA 53 (1958).
"""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.plant.parameters import OURS, Parameters

INDEPENDENT = (
    "random"  # the design whose flights are independent draws, so that binomial statistics hold
)
EXTENSIBLE = frozenset(
    {"random", "sobol", "halton", "file"}
)  # more flights leave the first ones as they are
FACTORIAL = frozenset({"corners", "grid", "one_at_a_time"})

_BITS = 30  # of a Sobol point: 2**30 flights at most
_PIECE = 4096  # points drawn at once; a power of two, as Sobol's net wants
NOMINAL = -1.0  # stands in a factorial design for "the nominal value, whatever its probability"
_WORDS = 4  # 64-bit words of one Philox4x64 counter value


def stream_key(seed: int, name: str, purpose: str = "sample") -> int:
    """128-bit key of a stream."""
    text = f"abhv-mc stream 1|{purpose}|{seed}|{name}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "little")


def draw_uniforms(key: int, first: int, count: int) -> NDArray[np.float64]:
    """One uniform number ``[flight]``, strictly between 0 and 1, of the flights ``first`` .. ``first + count - 1``."""
    generator = np.random.Philox(key=key)
    generator.advance(first)
    words = generator.random_raw(_WORDS * count)[::_WORDS]
    return (words >> np.uint64(12)).astype(np.float64) * 2.0**-52 + 2.0**-53


def make_generator(seed: int, name: str, purpose: str) -> np.random.Generator:
    """A generator for what is drawn once for a whole campaign: scrambles, permutations."""
    return np.random.Generator(
        np.random.Philox(np.random.SeedSequence(stream_key(seed, name, purpose)))
    )


@dataclass(frozen=True)
class Design:
    """A design for named parameters. Call :meth:`draw` for any range of flights."""

    kind: str
    seed: int
    names: tuple[str, ...]
    flights: int
    levels: int = 2  # of a grid, and of each side of one_at_a_time
    parameters: Parameters = OURS

    def draw(self, first: int, stop: int) -> Floats:
        """Probabilities ``[flight, parameter]`` of the flights ``first`` .. ``stop - 1``."""
        flights, number = np.arange(first, stop), len(self.names)
        if self.kind == "one_at_a_time":
            return _one_at_a_time_rows(flights, number, self.levels)
        if self.kind in FACTORIAL:
            return _grid_rows(flights, number, 2 if self.kind == "corners" else self.levels)
        draw = _COLUMNS[self.kind]
        columns = [draw(self, name, first, stop) for name in self.names]
        return np.column_stack(columns) if columns else np.empty((stop - first, 0))


def count_flights(kind: str, parameters: int, levels: int) -> int | None:
    """Number of flights that a factorial design has; None for a design that takes any number."""
    if kind == "corners":
        return 2**parameters
    if kind == "grid":
        return levels**parameters
    if kind == "one_at_a_time":
        return 1 + levels * parameters
    return None


def _draw_random(design: Design, name: str, first: int, stop: int) -> Floats:
    return draw_uniforms(stream_key(design.seed, name), first, stop - first)


def _draw_latin_hypercube(design: Design, name: str, first: int, stop: int) -> Floats:
    """One flight in each of N equal slices of every parameter. McKay, Beckman & Conover 1979."""
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(d=1, rng=make_generator(design.seed, name, "latin hypercube"))
    return _open(sampler.random(design.flights)[first:stop, 0])


def _draw_sobol(design: Design, name: str, first: int, stop: int) -> Floats:
    """Sobol's sequence (Joe & Kuo 2008), scrambled (Matousek 1998).

    A parameter's dimension is its place in the table of parameters, and its scramble belongs to the seed and its
    name: the campaign's other parameters change neither. Only the sampler's last dimension is used.
    """
    from scipy.stats import qmc

    rng = make_generator(design.seed, name, "sobol")
    return _slice(
        lambda: qmc.Sobol(d=_dimension(design, name), bits=_BITS, rng=rng), first, stop
    ) + 0.5 ** (_BITS + 1)


def _draw_halton(design: Design, name: str, first: int, stop: int) -> Floats:
    """Halton's sequence, scrambled by random permutations of the digits (Owen 2017); dimensions as for Sobol."""
    from scipy.stats import qmc

    rng = make_generator(design.seed, name, "halton")
    return _open(_slice(lambda: qmc.Halton(d=_dimension(design, name), rng=rng), first, stop))


def _dimension(design: Design, name: str) -> int:
    """From 1."""
    return design.parameters.dispersible.index(name) + 1


def _slice(make_sampler: Callable[[], Any], first: int, stop: int) -> Floats:
    """Last column of the sampler's points ``first`` .. ``stop - 1``, piece by piece to bound the memory."""
    sampler = make_sampler()
    start = first - first % _PIECE
    if start:
        sampler.fast_forward(start)
    pieces = [sampler.random(_PIECE)[:, -1] for _ in range(start, stop, _PIECE)]
    return np.concatenate(pieces)[first - start : stop - start] if pieces else np.empty(0)


def _open(values: Floats) -> Floats:
    """Keep clear of 0 and 1, where an unbounded distribution is infinite."""
    return np.clip(values, 2.0**-53, 1.0 - 2.0**-53)


def _grid_rows(flights: NDArray[np.int64], parameters: int, levels: int) -> Floats:
    """Full factorial, the last parameter changing fastest; entries are fractions of the distribution's extent."""
    powers = levels ** np.arange(parameters - 1, -1, -1)
    digits = flights[:, None] // powers[None, :] % levels
    return digits / (levels - 1)


def _one_at_a_time_rows(flights: NDArray[np.int64], parameters: int, levels: int) -> Floats:
    """Flight 0 is nominal; then each parameter alone takes its levels, the others nominal."""
    rows = np.full((len(flights), parameters), NOMINAL)
    moved = flights > 0
    which, level = np.divmod(flights[moved] - 1, levels)
    rows[np.nonzero(moved)[0], which] = level / (levels - 1)
    return rows


_COLUMNS: dict[str, Callable[[Design, str, int, int], Floats]] = {
    "random": _draw_random,
    "lhs": _draw_latin_hypercube,
    "sobol": _draw_sobol,
    "halton": _draw_halton,
}


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
    return Copula(
        columns, np.asarray(np.linalg.cholesky(matrix) if columns else matrix, np.float64)
    )
