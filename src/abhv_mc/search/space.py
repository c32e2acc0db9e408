"""A campaign's dispersions as the points that searches know: standard normal numbers, or a box -1 .. 1."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.derived_parameters import Derived
from abhv_mc.campaign.sampling.designs import Copula, stream_key
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    Marginal,
    MixtureMarginal,
    SometimesMarginal,
)
from abhv_mc.campaign.sampling.samples import draw_seeds, full_rows
from abhv_mc.io.documents import InputError
from abhv_mc.plant.parameters import OURS, Parameters

_SMALLEST = 2.0**-53
_TRIED, _FEWEST_INSIDE = 65536, 10  # random flights
_SEEDS = {
    "wind.turbulence_seed": "wind.turbulence",
    "sensor.noise_seed": "_noise",
}  # and how what it seeds ends


@dataclass(frozen=True)
class Space:
    """The dispersed parameters but for seeds, which belong to no dimension: they are drawn for each flight."""

    names: tuple[str, ...]  # of the dimensions
    seeds: tuple[str, ...]  # seed-like parameters, columns after the dimensions
    marginals: tuple[Marginal, ...]
    copula: Copula
    derived: Derived
    parameters: Parameters = OURS  # in the order of full rows

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of :meth:`complete`."""
        return (*self.names, *self.seeds)

    @property
    def probabilities(self) -> dict[str, float]:
        """Of what does not come in every flight, such as a failure: how often it does."""
        marginals = zip(self.names, self.marginals, strict=True)
        return {
            name: one.probability for name, one in marginals if isinstance(one, SometimesMarginal)
        }

    def from_normal(self, points: Floats, on: NDArray[np.bool_] | None = None) -> Floats:
        """Values ``[flight, dimension]`` in SI of standard normal points: through the copula and the distributions.

        ``on`` [flight, switch] says what of :attr:`probabilities` comes; without it, the points say that too.
        """
        from scipy.special import ndtr

        uniform = self.copula.apply(np.clip(ndtr(points), _SMALLEST, 1.0 - _SMALLEST))
        values, switch = np.empty_like(uniform), 0
        for i, marginal in enumerate(self.marginals):
            if on is not None and isinstance(marginal, SometimesMarginal):
                values[:, i] = np.where(
                    on[:, switch], marginal.drawn.ppf(uniform[:, i]), marginal.nominal
                )
                switch += 1
            else:
                values[:, i] = marginal.ppf(uniform[:, i])
        return values

    def bounds(self, box: float) -> Floats:
        """Low and high ends ``[dimension, 2]``: of bounded distributions their range, of others +-``box`` sigma.

        Of what comes with a probability, such as a failure, they are those of the values that it has when it comes.
        """
        from scipy.special import ndtr

        found = []
        tails = np.array([ndtr(-box), ndtr(box)])
        for marginal in self.marginals:
            whole = _when_it_comes(marginal)
            sides = []
            for part in whole.parts if isinstance(whole, MixtureMarginal) else (whole,):
                ends = part.at_fraction(np.array([0.0, 1.0]))
                bounded = part.cdf(ends) - np.array([0.0, 1.0])
                sides.append(np.where(np.abs(bounded) < 1e-12, ends, part.ppf(tails)))
            found.append((np.min(sides, axis=0)[0], np.max(sides, axis=0)[1]))
        return np.array(found)

    def from_box(self, points: Floats, bounds: Floats) -> Floats:
        """Values ``[flight, dimension]`` in SI of points of the box -1 .. 1; discrete ones take their nearest value."""
        values = bounds[:, 0] + 0.5 * (points + 1.0) * (bounds[:, 1] - bounds[:, 0])
        values = np.where(points == 1.0, bounds[:, 1], values)
        for i, marginal in enumerate(self.marginals):
            drawn = _when_it_comes(marginal)
            if isinstance(drawn, DiscreteMarginal):
                values[:, i] = drawn.at_fraction(0.5 * (points[:, i] + 1.0))
        return values

    def draw_in_box(self, bounds: Floats, seed: int, number: int) -> Floats:
        """Random values ``[flight, dimension]`` as a campaign draws them, those outside of the box drawn anew.

        What does not come, a failure or another thing with a probability, is outside of no box. Raises InputError for a
        box in which hardly a random flight lies.
        """
        absent = np.array(
            [m.nominal if isinstance(m, SometimesMarginal) else np.nan for m in self.marginals]
        )
        generator = np.random.Generator(
            np.random.Philox(np.random.SeedSequence(stream_key(seed, "box", "search")))
        )
        kept, tried = np.empty((0, len(self.names))), 0
        while len(kept) < number:
            drawn = self.from_normal(generator.standard_normal((2 * number, len(self.names))))
            inside = np.all(
                (drawn >= bounds[:, 0]) & (drawn <= bounds[:, 1]) | (drawn == absent), axis=1
            )
            kept, tried = np.concatenate([kept, drawn[inside]]), tried + len(drawn)
            if tried >= _TRIED and len(kept) < _FEWEST_INSIDE:
                found = f"a box with {len(kept)} of {tried} random flights of its {len(self.names)} dispersions inside"
                raise InputError("--box", found, "a larger one")
        return kept[:number]

    def rows(self, values: Floats) -> Floats:
        """Full rows ``[flight, parameter]`` of values in the order of :attr:`columns`."""
        return full_rows(self.columns, values, self.derived, self.parameters)

    def complete(self, values: Floats, seed: int, first: int | None) -> Floats:
        """Values with the seeds' columns: of the flights from ``first`` on, or one for all where it is None."""
        columns = []
        for name in self.seeds:
            drawn = draw_seeds(name, seed, first or 0, len(values) if first is not None else 1)
            columns.append(np.resize(drawn, len(values)))
        return np.column_stack([values, *columns])


def _when_it_comes(marginal: Marginal) -> Marginal:
    """The distribution of the drawn values."""
    return marginal.drawn if isinstance(marginal, SometimesMarginal) else marginal


def make_space(campaign: Experiment, with_unknowns: bool = False) -> Space:
    """The space of a campaign's dispersions, and of its unknowns as uniform ones. Raises InputError where there is
    nothing to search."""
    document = campaign.document
    if campaign.sample_file is not None:
        raise document.error(
            ("sampling",), "samples from a file", "distributions, which a search needs"
        )
    unknowns = campaign.unknowns
    if unknowns.names and not with_unknowns:
        wish = "a campaign without: this search is over dispersions (`run` finds the unknowns' worst values)"
        raise document.key_error(("unknowns",), "unknowns", wish)
    ranges = zip(unknowns.names, unknowns.low.tolist(), unknowns.high.tolist(), strict=True)
    marginals = campaign.marginals | {
        name: ContinuousMarginal("uniform", (low, high - low)) for name, low, high in ranges
    }
    names = tuple(name for name in marginals if name not in _SEEDS)
    if not names:
        raise document.error((), "no dispersions", "something to vary")
    moved = (*names, *(each.name for each in campaign.derived))
    seeds = tuple(
        each.name
        for each in campaign.parameters.records
        if each.seed
        and (
            each.of_user
            or each.name in campaign.names
            or any(name.endswith(_SEEDS[each.name]) for name in moved)
        )
    )
    place = {campaign.names[column]: row for row, column in enumerate(campaign.copula.columns)}
    chosen = [name for name in names if name in place]
    if len(chosen) < len(place):
        raise document.error(
            ("correlations",), "a seed that is correlated", "seeds that belong to themselves"
        )
    copula = Copula(tuple(names.index(name) for name in chosen), campaign.copula.factor)
    chosen_marginals = tuple(marginals[name] for name in names)
    return Space(names, seeds, chosen_marginals, copula, campaign.derived, campaign.parameters)
