"""Dispersions of a campaign as standard normal points, or as points of a box -1 .. 1."""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.derived_parameters import Derived
from abhv_mc.campaign.sampling.designs import Copula, make_generator
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    Marginal,
    MixtureMarginal,
    SometimesMarginal,
    clip_probabilities,
)
from abhv_mc.campaign.sampling.samples import draw_seeds, full_rows
from abhv_mc.flights.parameters import Parameters
from abhv_mc.io.messages import InputError, counted

# number of random flights that are tried, and minimum number of flights that must be in the box
_TRIED, _FEWEST_INSIDE = 65536, 10
_SEEDS = {
    "wind.turbulence_seed": "wind.turbulence",
    "sensor.noise_seed": "_noise",
}  # seed parameters, with the endings of the names of the parameters that use the seed


@dataclass(frozen=True)
class Space:
    """Dispersed parameters as dimensions of a search; seeds are drawn for each flight."""

    names: tuple[str, ...]  # names of the dimensions
    seeds: tuple[str, ...]  # seed parameters, whose columns follow the dimensions
    marginals: tuple[Marginal, ...]
    copula: Copula
    derived: Derived
    parameters: Parameters  # all parameters, in the order of full rows

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of :meth:`complete`."""
        return (*self.names, *self.seeds)

    @property
    def probabilities(self) -> dict[str, float]:
        """Probabilities, by name, of parameters that occur in some flights only (failures)."""
        return {
            name: marginal.probability
            for name, marginal in zip(self.names, self.marginals, strict=True)
            if isinstance(marginal, SometimesMarginal)
        }

    def from_normal(self, points: Floats, on: Mask | None = None) -> Floats:
        """Convert standard normal points to SI values [flight, dimension].

        The points are transformed by the copula and the distributions. `on` [flight, switch]
        selects which parameters in :attr:`probabilities` occur; by default, the points select them.
        """
        from scipy.special import ndtr

        uniform = self.copula.apply(clip_probabilities(ndtr(points)))
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
        """Return the lower and upper bounds of the box in each dimension [dimension, 2].

                The bounds are the range of a bounded distribution, or the quantiles of any other
        distribution at +-`box` standard deviations of a normal distribution. For a failure that
        occurs only in some flights, the bounds are the range of its parameter in these flights.
        """
        from scipy.special import ndtr

        limits = []
        tails = np.array([ndtr(-box), ndtr(box)])
        for marginal in self.marginals:
            distribution = _when_it_comes(marginal)
            sides = []
            for component in (
                distribution.parts if isinstance(distribution, MixtureMarginal) else (distribution,)
            ):
                ends = component.at_fraction(np.array([0.0, 1.0]))
                bounded = component.cdf(ends) - np.array([0.0, 1.0])
                sides.append(np.where(np.abs(bounded) < 1e-12, ends, component.ppf(tails)))
            limits.append((np.min(sides, axis=0)[0], np.max(sides, axis=0)[1]))
        return np.array(limits)

    def from_box(self, points: Floats, bounds: Floats) -> Floats:
        """Convert points of the box -1 .. 1 to SI values [flight, dimension].

        Values of discrete parameters are rounded.
        """
        values = bounds[:, 0] + 0.5 * (points + 1.0) * (bounds[:, 1] - bounds[:, 0])
        values = np.where(points == 1.0, bounds[:, 1], values)
        for i, marginal in enumerate(self.marginals):
            drawn = _when_it_comes(marginal)
            if isinstance(drawn, DiscreteMarginal):
                values[:, i] = drawn.at_fraction(0.5 * (points[:, i] + 1.0))
        return values

    def draw_in_box(self, bounds: Floats, seed: int, number: int) -> Floats:
        """Return values [flight, dimension] drawn from the campaign's distributions in the box.

        Flights outside the box are redrawn; the parameter of a failure that does not occur is
        always inside the box. Raise InputError if almost no random flight is inside the box.
        """
        absent = np.array(
            [m.nominal if isinstance(m, SometimesMarginal) else np.nan for m in self.marginals]
        )
        generator = make_generator(seed, "box", "search")
        accepted, tried = np.empty((0, len(self.names))), 0
        while len(accepted) < number:
            drawn = self.from_normal(generator.standard_normal((2 * number, len(self.names))))
            inside = np.all(
                (drawn >= bounds[:, 0]) & (drawn <= bounds[:, 1]) | (drawn == absent), axis=1
            )
            accepted, tried = np.concatenate([accepted, drawn[inside]]), tried + len(drawn)
            if tried >= _TRIED and len(accepted) < _FEWEST_INSIDE:
                share = f"{len(accepted)} of {counted(tried, 'random flight')}"
                box = f"the box of the {counted(len(self.names), 'dispersion')}"
                raise InputError("--box", f"{box} contains only {share}", "a larger box")
        return accepted[:number]

    def rows(self, values: Floats) -> Floats:
        """Return full rows [flight, parameter] for values in the order of :attr:`columns`."""
        return full_rows(self.columns, values, self.derived, self.parameters)

    def complete(self, values: Floats, seed: int, first: int | None) -> Floats:
        """Add seeds of flights numbered from `first`, or a common seed if `first` is None."""
        columns = []
        for name in self.seeds:
            drawn = draw_seeds(
                self.parameters[name], seed, first or 0, len(values) if first is not None else 1
            )
            columns.append(np.resize(drawn, len(values)))
        return np.column_stack([values, *columns])


def _when_it_comes(marginal: Marginal) -> Marginal:
    """Return the distribution of a failure's parameter, given that the failure occurs."""
    return marginal.drawn if isinstance(marginal, SometimesMarginal) else marginal


def make_space(campaign: Experiment, with_unknowns: bool = False) -> Space:
    """Return the space of a campaign's dispersions; unknowns are uniform, if included.

    Raise InputError if there is nothing to search.
    """
    document = campaign.document
    if campaign.sample_file is not None:
        raise document.error(
            ("sampling",),
            "the samples are read from a file",
            "distributions, which a search requires",
        )
    unknowns = campaign.unknowns
    if unknowns.names and not with_unknowns:
        raise document.key_error(
            ("unknowns",),
            "the campaign has unknowns",
            "a campaign without unknowns, because this search covers only dispersions (`run` finds "
            "the worst values of unknowns)",
        )
    ranges = zip(unknowns.names, unknowns.low.tolist(), unknowns.high.tolist(), strict=True)
    marginals = campaign.marginals | {
        name: ContinuousMarginal("uniform", (low, high - low)) for name, low, high in ranges
    }
    names = tuple(name for name in marginals if name not in _SEEDS)
    if not names:
        raise document.error((), "the campaign has no dispersions", "at least one dispersion")
    moved = (*names, *(record.name for record in campaign.derived))
    seeds = tuple(
        record.name
        for record in campaign.parameters.records
        if record.seed
        and (
            record.of_user
            or record.name in campaign.names
            or any(name.endswith(_SEEDS[record.name]) for name in moved)
        )
    )
    rows = {campaign.names[column]: row for row, column in enumerate(campaign.copula.columns)}
    chosen = [name for name in names if name in rows]
    if len(chosen) < len(rows):
        raise document.error(
            ("correlations",), "a random seed is correlated", "independent random seeds"
        )
    copula = Copula(tuple(names.index(name) for name in chosen), campaign.copula.factor)
    chosen_marginals = tuple(marginals[name] for name in names)
    return Space(names, seeds, chosen_marginals, copula, campaign.derived, campaign.parameters)
