"""A campaign's samples: one row of parameter values for each flight, drawn before anything flies.

Turbulence and sensor noise have seeds: columns of the samples as soon as there is such noise, and no dispersion.
Without a seed of its own every flight would meet the same gusts, and the flights would not be independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.correlation import Copula
from abhv_mc.campaign.sampling.derived_parameters import Derived, derive
from abhv_mc.campaign.sampling.designs import FACTORIAL, NOMINAL, Design
from abhv_mc.campaign.sampling.marginals import Marginal
from abhv_mc.campaign.sampling.streams import draw_uniforms, stream_key
from abhv_mc.kernel.plant.parameter_names import SENSOR_NOISES
from abhv_mc.plant.parameters import OURS, Parameters

NOISE_OF_SEED = {"wind.turbulence_seed": ("wind.turbulence",), "sensor.noise_seed": SENSOR_NOISES}
"""By seed, the parameters that make the noise that it belongs to."""

_WHOLE = 2.0**52  # a seed of a user's simulator is a whole number below it


class SampleSource(Protocol):
    """Where samples come from."""

    @property
    def names(self) -> tuple[str, ...]:
        """Sampled parameters."""

    @property
    def flights(self) -> int:
        """Number of flights."""

    def draw(self, first: int, stop: int) -> Floats:
        """Values ``[flight, parameter]``, SI, of the flights ``first`` .. ``stop - 1``."""


@dataclass(frozen=True)
class DrawnSamples:
    """Samples of a design: its probabilities, correlated by the copula, through each parameter's distribution."""

    design: Design
    marginals: tuple[Marginal, ...]
    copula: Copula
    parameters: Parameters = OURS

    @property
    def names(self) -> tuple[str, ...]:
        return self.design.names

    @property
    def flights(self) -> int:
        return self.design.flights

    def draw(self, first: int, stop: int) -> Floats:
        rows = self.design.draw(first, stop)
        if self.design.kind in FACTORIAL:
            nominal = self.parameters.nominal_of(self.names)
            values = np.column_stack([marginal.at_fraction(rows[:, i]) for i, marginal in enumerate(self.marginals)])
            return np.where(rows == NOMINAL, nominal, values)
        probabilities = self.copula.apply(rows)
        values = np.empty_like(probabilities)
        for i, marginal in enumerate(self.marginals):
            values[:, i] = marginal.ppf(probabilities[:, i])
        return values


def find_seeds(names: Sequence[str], parameters: Parameters = OURS) -> tuple[str, ...]:
    """The seeds that flights need beside columns of these names; all of a user's simulator."""
    if parameters is not OURS:
        return tuple(record.name for record in parameters.records if record.seed)
    there = {*names, *(parameter.name for parameter in parameters.records if parameter.nominal != 0.0)}
    return tuple(seed for seed, noises in NOISE_OF_SEED.items() if seed not in names and there.intersection(noises))


def draw_seeds(name: str, seed: int, first: int, count: int) -> Floats:
    """Values [flight] of a seed: in 0..1, of a user's simulator whole numbers."""
    drawn = draw_uniforms(stream_key(seed, name), first, count)
    return drawn if name in NOISE_OF_SEED else np.floor(drawn * _WHOLE)


@dataclass(frozen=True)
class SeededSamples:
    """Samples with the seeds of the flights' noise in columns behind them, each from (seed, name, flight).

    Flights that are compared with each other by their design, all of a factorial one, have a common one.
    """

    samples: SampleSource
    seeds: tuple[str, ...]
    seed: int  # of the campaign
    design: str

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.samples.names, *self.seeds)

    @property
    def flights(self) -> int:
        return self.samples.flights

    def draw(self, first: int, stop: int) -> Floats:
        columns = [self.samples.draw(first, stop)]
        for name in self.seeds:
            if self.design in FACTORIAL:
                columns.append(np.repeat(draw_seeds(name, self.seed, 0, 1), stop - first)[:, None])
            else:
                columns.append(draw_seeds(name, self.seed, first, stop - first)[:, None])
        return np.hstack(columns)


@dataclass(frozen=True)
class PooledSamples:
    """Samples of several seeds, one after the other: the first flights of each, numbered on; the last one goes on."""

    sources: tuple[SampleSource, ...]
    runs: tuple[int, ...]
    flights: int

    @property
    def names(self) -> tuple[str, ...]:
        return self.sources[0].names

    def draw(self, first: int, stop: int) -> Floats:
        starts = np.cumsum((0, *self.runs[:-1])).tolist()
        ends = [*starts[1:], self.flights]
        pieces = [np.empty((0, len(self.names)))]
        for source, start, end in zip(self.sources, starts, ends, strict=True):
            low, high = max(first, start), min(stop, end)
            if low < high:
                pieces.append(source.draw(low - start, high - start))
        return np.concatenate(pieces)


@dataclass(frozen=True)
class PointSamples:
    """Samples of a source, each flown at every point of unknowns: row k is sample k // points at point k % points."""

    samples: SampleSource
    place: int  # of the unknowns' columns among the source's
    unknowns: tuple[str, ...]
    points: Floats  # [point, unknown]

    @property
    def names(self) -> tuple[str, ...]:
        names = self.samples.names
        return (*names[: self.place], *self.unknowns, *names[self.place :])

    @property
    def flights(self) -> int:
        return self.samples.flights * len(self.points)

    def draw(self, first: int, stop: int) -> Floats:
        sample, point = np.divmod(np.arange(first, stop), len(self.points))
        low = first // len(self.points)
        rows = self.samples.draw(low, -(-stop // len(self.points)))[sample - low]
        return np.column_stack([rows[:, : self.place], self.points[point], rows[:, self.place :]])


def full_rows(names: Sequence[str], values: Floats, derived: Derived, parameters: Parameters = OURS) -> Floats:
    """Full rows ``[flight, parameter]`` in the order of ``parameters``: nominal but for sampled and derived columns."""
    rows = np.tile(parameters.nominal, (len(values), 1))
    rows[:, [parameters.index[name] for name in names]] = values
    derive(rows, derived, parameters)
    return rows
