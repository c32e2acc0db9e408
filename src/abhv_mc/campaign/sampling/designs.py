"""Designs of experiments: how the uniform numbers of a campaign's flights are chosen.

A design gives for each flight and parameter a number in [0, 1], the probability at which the parameter's distribution
is read. ``random``, ``sobol`` and ``halton`` give flight k the same numbers however many flights there are; the others
depend on the number of flights, which for ``corners``, ``grid`` and ``one_at_a_time`` follows from the parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.streams import draw_uniforms, make_generator, stream_key
from abhv_mc.plant.parameters import OURS, Parameters

INDEPENDENT = "random"  # the design whose flights are independent draws, so that binomial statistics hold
EXTENSIBLE = frozenset({"random", "sobol", "halton", "file"})  # more flights leave the first ones as they are
FACTORIAL = frozenset({"corners", "grid", "one_at_a_time"})

_BITS = 30  # of a Sobol point: 2**30 flights at most
_PIECE = 4096  # points drawn at once; a power of two, as Sobol's net wants
NOMINAL = -1.0  # stands in a factorial design for "the nominal value, whatever its probability"


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
    return _slice(lambda: qmc.Sobol(d=_dimension(design, name), bits=_BITS, rng=rng), first, stop) + 0.5 ** (_BITS + 1)


def _draw_halton(design: Design, name: str, first: int, stop: int) -> Floats:
    """Halton's sequence, scrambled by random permutations of the digits (Owen 2017); dimensions as for Sobol."""
    from scipy.stats import qmc

    rng = make_generator(design.seed, name, "halton")
    return _open(_slice(lambda: qmc.Halton(d=_dimension(design, name), rng=rng), first, stop))


def _dimension(design: Design, name: str) -> int:
    """From 1."""
    return design.parameters.dispersible.index(name) + 1


def _slice(make_sampler: Callable[[], object], first: int, stop: int) -> Floats:
    """Last column of the sampler's points ``first`` .. ``stop - 1``, piece by piece to bound the memory."""
    sampler: object = make_sampler()
    start = first - first % _PIECE
    if start:
        sampler.fast_forward(start)  # type: ignore[attr-defined]
    pieces = [sampler.random(_PIECE)[:, -1] for _ in range(start, stop, _PIECE)]  # type: ignore[attr-defined]
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
