"""Re-weighting of simulated flights for other distributions of the dispersions.

The weight of a flight is the ratio of its new to its old probability density.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Copula
from abhv_mc.campaign.sampling.marginals import (
    DiscreteMarginal,
    Marginal,
    MixtureMarginal,
    SometimesMarginal,
    find_atoms,
    outside,
)
from abhv_mc.io.document_reader import compose
from abhv_mc.io.documents import validate
from abhv_mc.io.messages import InputError, Refusal, one_of
from abhv_mc.requests import parse_pairs
from abhv_mc.statistics.reweight import Unseen, join_unseen, unseen_of_range, unseen_of_values

_SOURCE = "dispersions"
_PROBABILITIES = np.linspace(0.0, 1.0, 1001)  # probabilities at which new values are checked


class Change(NamedTuple):
    """Changes to the distributions of some parameters of a campaign."""

    after: dict[str, dict[str, Any]]  # changed entries of the campaign file, by parameter
    marginals: dict[str, Marginal]  # new distributions, by parameter


def parse_settings(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Parse strings such as ``PARAMETER.KEY=VALUE`` into values by parameter and key."""

    def parse(text: str) -> Any:
        data: Any = compose(Path(_SOURCE), f"value: {text}\n".encode())[0]
        return data["value"]

    expected = "PARAMETER.KEY=VALUE, such as aero.drag.half_width=12%"
    settings: dict[str, dict[str, Any]] = {}
    for name, value in parse_pairs(_SOURCE, texts, expected, parse).items():
        parameter, _, key = name.rpartition(".")
        if not parameter or value is None:
            raise InputError(_SOURCE, f"found '{name}'", expected)
        settings.setdefault(parameter, {})[key] = value
    return settings


def make_change(campaign: Experiment, settings: Mapping[str, Mapping[str, Any]]) -> Change:
    """Return the changed distributions after checking that the flights support them.

    Raise InputError if the flights do not support the new distributions.
    """
    if not campaign.independent:
        problem = (
            "the flights were simulated at fixed points of the unknowns"
            if campaign.unknowns.names
            else "re-weighting requires independent flights, but " + campaign.dependence
        )
        raise InputError(
            campaign.document.path, problem, f"a campaign with sampling: {INDEPENDENT}"
        )
    data = campaign.document.entries
    entries = dict(data["dispersions"] or {})
    after = {}
    for name, keys in settings.items():
        if name not in entries and (dotted := f"{name}.{next(iter(keys))}") in entries:
            sizes = [key for key in entries[dotted] if key not in ("distribution", "probability")]
            problem = f"'{dotted}' does not name a key of the distribution"
            raise InputError(
                _SOURCE, problem, " or ".join(f"{dotted}.{key}=VALUE" for key in sizes)
            )
        if name not in entries:
            problem = f"the campaign does not disperse '{name}'"
            raise InputError(
                _SOURCE,
                problem,
                one_of(entries, name) if entries else "a campaign with dispersions",
            )
        after[name] = {**({} if "distribution" in keys else entries[name]), **keys}
    document = replace(campaign.document, data={**data, "dispersions": {**entries, **after}})
    try:
        model = validate(document, type(campaign.model))
        marginals = {
            name: model.dispersions[name].make_marginal(campaign.parameters[name]) for name in after
        }
    except (InputError, Refusal) as error:
        raise InputError(_SOURCE, error.found, error.expected) from None
    mixed = [campaign.names[column] for column in campaign.copula.columns]
    for name, marginal in marginals.items():
        if fault := _unsupported(name, campaign.marginals[name], marginal):
            raise InputError(_SOURCE, *fault)
        if name in mixed and any(find_atoms(campaign.marginals[other]).size for other in mixed):
            problem = f"'{name}' is correlated with a discrete choice"
            raise InputError(
                _SOURCE, problem, "a parameter that is not correlated with a discrete choice"
            )
    return Change(after, marginals)


def _parts(marginal: Marginal) -> tuple[Marginal, ...]:
    return marginal.parts if isinstance(marginal, MixtureMarginal) else (marginal,)


def _kind(marginal: Marginal) -> str:
    if isinstance(marginal, SometimesMarginal):
        return "a distribution with the key 'probability'"
    if isinstance(marginal, DiscreteMarginal):
        return "a discrete choice"
    if find_atoms(marginal).size:
        return "a mixture with a discrete choice"
    return "a continuous distribution"


def _unsupported(name: str, old: Marginal, new: Marginal) -> tuple[str, str] | None:
    """Return the problem with a change and the expected input; None if the change is valid.

    The new distribution must have zero probability where no flights were simulated.
    """
    if isinstance(old, SometimesMarginal) and isinstance(new, SometimesMarginal):
        old, new = old.drawn, new.drawn
    if (kind := _kind(new)) != _kind(old) or "mixture" in kind:
        problem = f"'{name}' changes from {_kind(old)} to {kind}"
        return problem, "distributions of the same kind, without a mixture that has a choice"
    low, high = old.at_fraction(np.array([0.0, 1.0]))
    for component in _parts(new):
        values = component.ppf(_PROBABILITIES)
        if outside(old, values).any():
            first, last = values.min(), values.max()
            problem = f"'{name}' from {first:g} to {last:g} exceeds the simulated values"
            return problem, f"values that occur between {low:g} and {high:g}, or a new campaign"
    return None


def weigh_flights(campaign: Experiment, change: Change, samples: Floats) -> Floats:
    """Return the ratio of new to old density for each flight [flight], about 1 on average.

    `samples` has shape [flight, parameter].
    """
    weights = np.ones(len(samples))
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, marginal in change.marginals.items():
            values = samples[:, campaign.names.index(name)]
            weights *= marginal.density(values) / campaign.marginals[name].density(values)
    mixed = [campaign.names[column] for column in campaign.copula.columns]
    if any(name in change.marginals for name in mixed):
        columns = samples[:, list(campaign.copula.columns)]
        old = [campaign.marginals[name] for name in mixed]
        new = [
            change.marginals.get(name, marginal) for name, marginal in zip(mixed, old, strict=True)
        ]
        weights *= np.exp(
            _log_copula(campaign.copula, new, columns) - _log_copula(campaign.copula, old, columns)
        )
    return np.nan_to_num(weights, nan=0.0, posinf=0.0)


def _log_copula(copula: Copula, marginals: Sequence[Marginal], columns: Floats) -> Floats:
    """Return the log density of the Gaussian copula [flight], up to a constant."""
    from scipy.linalg import solve_triangular
    from scipy.special import ndtri

    uniform = np.column_stack(
        [marginal.cdf(column) for marginal, column in zip(marginals, columns.T, strict=True)]
    )
    normal = ndtri(np.clip(uniform, 2.0**-53, 1.0 - 2.0**-53))
    mixed = solve_triangular(copula.factor, normal.T, lower=True)
    return 0.5 * (np.sum(normal**2, axis=1) - np.sum(mixed**2, axis=0))


def unseen_probability(campaign: Experiment, change: Change, samples: Floats) -> Unseen:
    """Return the probability, under the new distributions, of values that were not sampled.

    `samples` has shape [flight, parameter].
    """
    parts = []
    for name, marginal in change.marginals.items():
        values, share = samples[:, campaign.names.index(name)], 1.0
        drawn, before = marginal, campaign.marginals[name]
        if isinstance(marginal, SometimesMarginal):
            values = values[values != marginal.nominal]
            share, drawn = marginal.probability, marginal.drawn
            before = getattr(before, "drawn", before)
        if isinstance(drawn, DiscreteMarginal):
            parts.append(
                unseen_of_values(drawn.values, share * drawn.density(drawn.values), values)
            )
        elif values.size:
            ends = np.array([values.min(), values.max()])
            low, high = drawn.cdf(ends).tolist()
            weights = np.nan_to_num(drawn.density(ends) / before.density(ends), posinf=0.0)
            parts.append(
                unseen_of_range(
                    (share * low, share * (1.0 - high)), (weights[0], weights[1]), values.size
                )
            )
        else:
            parts.append((share, share))
    return join_unseen(parts)
