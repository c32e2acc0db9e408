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
    ContinuousMarginal,
    DiscreteMarginal,
    Marginal,
    MixtureMarginal,
    SometimesMarginal,
)
from abhv_mc.io.document_reader import compose
from abhv_mc.io.documents import validate
from abhv_mc.io.messages import InputError, Refusal, joined, one_of
from abhv_mc.statistics.reweight import Unseen, join_unseen, unseen_of_range, unseen_of_values

_SET = "--set"
_SLACK = (
    1e-9  # tolerance within which interval ends count as equal, relative to the interval's width
)


class Change(NamedTuple):
    """Changes to the distributions of some parameters of a campaign."""

    # entries of the campaign file before the change, by parameter
    before: dict[str, dict[str, Any]]
    after: dict[str, dict[str, Any]]
    marginals: dict[str, Marginal]  # new distributions, by parameter


def parse_settings(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Parse strings such as ``PARAMETER.KEY=VALUE`` into values by parameter and key."""
    settings: dict[str, dict[str, Any]] = {}
    for text in texts:
        key, sign, value = text.partition("=")
        name, _, entry = key.strip().rpartition(".")
        if not (sign and name and entry and value.strip()):
            raise InputError(
                _SET, f"found '{text}'", "PARAMETER.KEY=VALUE, such as aero.drag.half_width=12%"
            )
        if entry in settings.get(name, {}):
            raise InputError(_SET, f"'{key.strip()}' is set twice", "each setting only once")
        data = compose(Path(_SET), f"value: {value.strip()}\n".encode())[0]
        settings.setdefault(name, {})[entry] = data["value"] if isinstance(data, dict) else data
    return settings


def make_change(campaign: Experiment, settings: Mapping[str, Mapping[str, Any]]) -> Change:
    """Return the changed distributions after checking that the flights support them.

    Raise InputError if the flights do not support the new distributions.
    """
    if not campaign.independent:
        problem = "re-weighting requires independent flights, but " + campaign.dependence
        problem = (
            "the flights were simulated at fixed points of the unknowns"
            if campaign.unknowns.names
            else problem
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
            raise InputError(_SET, problem, " or ".join(f"{dotted}.{key}=VALUE" for key in sizes))
        if name not in entries:
            problem = f"the campaign does not disperse '{name}'"
            raise InputError(
                _SET, problem, one_of(entries, name) if entries else "a campaign with dispersions"
            )
        after[name] = {**({} if "distribution" in keys else entries[name]), **keys}
    document = replace(campaign.document, data={**data, "dispersions": {**entries, **after}})
    try:
        model = validate(document, type(campaign.model))
        marginals = {
            name: model.dispersions[name].make_marginal(campaign.parameters[name]) for name in after
        }
    except (InputError, Refusal) as error:
        raise InputError(_SET, error.found, error.expected) from None
    mixed = [campaign.names[column] for column in campaign.copula.columns]
    for name, marginal in marginals.items():
        if fault := _unsupported(name, campaign.marginals[name], marginal):
            raise InputError(_SET, *fault)
        if name in mixed and any(map(_has_choice, (campaign.marginals[other] for other in mixed))):
            problem = f"'{name}' is correlated with a discrete choice"
            raise InputError(
                _SET, problem, "a parameter that is not correlated with a discrete choice"
            )
    return Change({name: dict(entries[name]) for name in after}, after, marginals)


def _parts(marginal: Marginal) -> tuple[Marginal, ...]:
    return marginal.parts if isinstance(marginal, MixtureMarginal) else (marginal,)


def _has_choice(marginal: Marginal) -> bool:
    return any(isinstance(component, DiscreteMarginal) for component in _parts(marginal))


def _unsupported(name: str, old: Marginal, new: Marginal) -> tuple[str, str] | None:
    """Return the problem with a change and the expected input; None if the change is valid.

    The new distribution must have zero probability where no flights were simulated.
    """
    if isinstance(old, SometimesMarginal) and isinstance(new, SometimesMarginal):
        return _unsupported(name, old.drawn, new.drawn)
    if isinstance(old, SometimesMarginal) != isinstance(new, SometimesMarginal):
        problem = f"the change adds or removes the key 'probability' of '{name}'"
        return problem, "the key 'probability' both before and after the change, or neither"
    if isinstance(old, MixtureMarginal) or isinstance(new, MixtureMarginal):
        if _has_choice(old) or _has_choice(new):
            return (
                f"'{name}' is a mixture with a discrete choice",
                "a mixture of continuous distributions, or a new campaign",
            )
        # Each component of the new distribution must lie within a component of the old
        # distribution.
        for component in _parts(new):
            faults = [_unsupported(name, flown, component) for flown in _parts(old)]
            if all(faults):
                return faults[-1]
        return None
    if isinstance(old, DiscreteMarginal) and isinstance(new, DiscreteMarginal):
        missing = np.setdiff1d(new.values, old.values)
        expected = f"a subset of the values {joined([f'{value:g}' for value in old.values])}"
        return (
            (f"no flights were simulated with '{name}' = {missing[0]:g}", expected)
            if missing.size
            else None
        )
    if not (isinstance(old, ContinuousMarginal) and isinstance(new, ContinuousMarginal)):
        problem = (
            f"the change of '{name}' replaces a discrete choice by a continuous distribution, or "
            "vice versa"
        )
        return problem, "a distribution of the same kind as in the campaign"
    (low, high), (first, last) = old.frozen.support(), new.frozen.support()
    slack = _SLACK * (high - low) if np.isfinite(high - low) else 0.0
    if low - slack <= first and last <= high + slack:
        return None
    problem = f"'{name}' from {first:g} to {last:g} exceeds the simulated range"
    return problem, f"a distribution between {low:g} and {high:g}, or a new campaign"


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
            before = before.drawn if isinstance(before, SometimesMarginal) else before
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
