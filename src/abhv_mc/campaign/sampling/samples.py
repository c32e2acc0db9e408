"""Samples of a campaign: parameter values of each flight, drawn or read from a file.

Seeds of turbulence and sensor noise are columns of the samples but not dispersions. Each flight has
its own seeds, because flights with the same gusts would not be independent.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.derived_parameters import Derived, derive
from abhv_mc.campaign.sampling.designs import (
    FACTORIAL,
    NOMINAL,
    Copula,
    Design,
    draw_uniforms,
    stream_key,
)
from abhv_mc.campaign.sampling.marginals import Marginal
from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.io.foreign_table import read_foreign_table
from abhv_mc.io.messages import InputError

_WHOLE = 2.0**52  # upper bound on the integer seeds of a custom simulator


@dataclass(frozen=True)
class SampleSource:
    """Source that computes the samples of any requested flights."""

    names: tuple[str, ...]  # names of the sampled parameters
    flights: int
    draw: Callable[
        [int, int], Floats
    ]  # function that returns SI values [flight, parameter] of flights first to stop - 1


def drawn_samples(
    design: Design, marginals: Sequence[Marginal], copula: Copula, parameters: Parameters
) -> SampleSource:
    """Return samples that follow a design, marginal distributions and a copula."""

    def draw(first: int, stop: int) -> Floats:
        rows = design.draw(first, stop)
        if design.kind in FACTORIAL:
            nominal = parameters.nominal_of(design.names)
            values = np.column_stack(
                [marginal.at_fraction(rows[:, i]) for i, marginal in enumerate(marginals)]
            )
            return np.where(rows == NOMINAL, nominal, values)
        probabilities = copula.apply(rows)
        values = np.empty_like(probabilities)
        for i, marginal in enumerate(marginals):
            values[:, i] = marginal.ppf(probabilities[:, i])
        return values

    return SampleSource(design.names, design.flights, draw)


def find_seeds(names: Sequence[str], parameters: Parameters) -> tuple[str, ...]:
    """Return the noise seeds that flights need in addition to the parameters ``names``."""
    if not parameters.has_program:
        return tuple(record.name for record in parameters.records if record.seed)
    noise_parameters = {
        *names,
        *(parameter.name for parameter in parameters.records if parameter.nominal != 0.0),
    }
    return tuple(
        record.name
        for record in parameters.records
        if record.name not in names and noise_parameters.intersection(record.noises)
    )


def draw_seeds(parameter: Parameter, seed: int, first: int, count: int) -> Floats:
    """Draw noise seeds [flight]: numbers from 0 to 1, or integers for a custom simulator."""
    drawn = draw_uniforms(stream_key(seed, parameter.name), first, count)
    return drawn if parameter.noises else np.floor(drawn * _WHOLE)


def seeded_samples(
    samples: SampleSource, seeds: Sequence[Parameter], seed: int, design: str
) -> SampleSource:
    """Return samples with appended noise seeds, drawn from (seed, name, flight).

    All flights of a factorial ``design`` share one noise seed, because they are compared with each
    other.
    """

    def draw(first: int, stop: int) -> Floats:
        columns = [samples.draw(first, stop)]
        for parameter in seeds:
            if design in FACTORIAL:
                columns.append(np.repeat(draw_seeds(parameter, seed, 0, 1), stop - first)[:, None])
            else:
                columns.append(draw_seeds(parameter, seed, first, stop - first)[:, None])
        return np.hstack(columns)

    names = *samples.names, *(parameter.name for parameter in seeds)
    return SampleSource(names, samples.flights, draw)


def pooled_samples(
    sources: Sequence[SampleSource], runs: Sequence[int], flights: int
) -> SampleSource:
    """Return samples of several seeds in sequence, with ``runs`` flights per seed.

    The last source supplies further flights, up to a total of ``flights``.
    """
    starts = np.cumsum((0, *runs[:-1])).tolist()
    ends = [*starts[1:], flights]

    def draw(first: int, stop: int) -> Floats:
        pieces = [np.empty((0, len(sources[0].names)))]
        for source, start, end in zip(sources, starts, ends, strict=True):
            low, high = max(first, start), min(stop, end)
            if low < high:
                pieces.append(source.draw(low - start, high - start))
        return np.concatenate(pieces)

    return SampleSource(sources[0].names, flights, draw)


def samples_at_points(
    samples: SampleSource, column: int, unknowns: Sequence[str], points: Floats
) -> SampleSource:
    """Return samples repeated at each of ``points`` [point, unknown].

    With n points, row k contains sample k // n at point k % n. The columns of the unknowns start at
    index ``column``.
    """

    def draw(first: int, stop: int) -> Floats:
        sample, point = np.divmod(np.arange(first, stop), len(points))
        low = first // len(points)
        rows = samples.draw(low, -(-stop // len(points)))[sample - low]
        return np.column_stack([rows[:, :column], points[point], rows[:, column:]])

    names = (*samples.names[:column], *unknowns, *samples.names[column:])
    return SampleSource(names, samples.flights * len(points), draw)


def full_rows(
    names: Sequence[str], values: Floats, derived: Derived, parameters: Parameters
) -> Floats:
    """Return rows of all parameters [flight, parameter] for rows of samples.

    Parameters that are neither sampled nor derived have their nominal values.
    """
    rows = np.tile(parameters.nominal, (len(values), 1))
    rows[:, [parameters.index[name] for name in names]] = values
    derive(rows, derived, parameters)
    return rows


@dataclass(frozen=True)
class SampleFile:
    """Samples read from a file, in SI units."""

    names: tuple[str, ...]
    values: Floats  # [flight, parameter]


def read_sample_file(path: Path, parameters: Parameters) -> SampleFile:
    """Read a table with one row per flight and one column per parameter.

    An optional column ``flight`` must count from 0. Raise InputError if the table is invalid.
    """
    table = read_foreign_table(path)
    columns = table.find([*parameters.dispersible, "flight"])
    table.check_heads(columns, parameters.dispersible)
    flight = columns.pop("flight", None)
    if not columns:
        raise InputError(
            path,
            "no column has the name of a parameter",
            "at least one column named after a parameter",
            1,
        )
    if not len(table):
        raise InputError(path, "the table has no rows", "one row per flight", 1)
    factors = [table.factor(column, parameters[name].unit) for name, column in columns.items()]
    values = table.numbers([column.position for column in columns.values()]) * factors
    if flight and not np.array_equal(
        table.numbers([flight.position])[:, 0], np.arange(len(values))
    ):
        raise InputError(
            path, "the column 'flight' does not count up from 0", "the numbers 0, 1, 2, ...", 2
        )
    return SampleFile(tuple(columns), values)
