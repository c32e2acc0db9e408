"""Other laws for the dispersions of flown flights: the ratio of densities by which each flight counts then."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.check import CheckedCampaign
from abhv_mc.campaign.config import Campaign
from abhv_mc.campaign.correlation import Copula
from abhv_mc.campaign.designs import INDEPENDENT
from abhv_mc.campaign.laws import ContinuousLaw, DiscreteLaw, Law
from abhv_mc.document_reader import compose
from abhv_mc.documents import InputError, Refusal, one_of, validate
from abhv_mc.plant.parameters import PARAMETER_INDEX, PARAMETERS
from abhv_mc.statistics.reweight import Unseen, join_unseen, unseen_of_range, unseen_of_values

Floats = NDArray[np.float64]

_SET = "--set"
_SLACK = 1e-9  # of a law's width, for ends that are the same but for rounding


@dataclass(frozen=True)
class Change:
    """Other laws for some parameters of a campaign."""

    before: dict[str, dict[str, Any]]  # entries of the campaign file, by parameter
    after: dict[str, dict[str, Any]]
    laws: dict[str, Law]  # the new ones


def parse_settings(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """``PARAMETER.KEY=VALUE`` as values by parameter and key. Raises InputError."""
    settings: dict[str, dict[str, Any]] = {}
    for text in texts:
        key, sign, value = text.partition("=")
        name, _, entry = key.strip().rpartition(".")
        if not (sign and name and entry and value.strip()):
            raise InputError(_SET, None, None, f"'{text}'", "PARAMETER.KEY=VALUE, such as aero.drag.half_width=12%")
        data = compose(Path(_SET), f"value: {value.strip()}\n".encode())[0]
        settings.setdefault(name, {})[entry] = data["value"] if isinstance(data, dict) else data
    return settings


def make_change(campaign: CheckedCampaign, settings: Mapping[str, Mapping[str, Any]]) -> Change:
    """Check other settings of a campaign's dispersions. Raises InputError for what cannot be asked of its flights."""
    design = campaign.model.sampling.design
    if design != INDEPENDENT:
        found = f"flights of the design '{design}', which are not independent draws"
        raise InputError(campaign.document.path, None, None, found, f"a campaign with sampling: {INDEPENDENT}")
    data: Any = campaign.document.data
    entries = dict(data["dispersions"] or {})
    after = {}
    for name, keys in settings.items():
        if name not in entries:
            found = f"'{name}', which the campaign did not disperse"
            raise InputError(_SET, None, None, found, one_of(entries, name) if entries else "a dispersion")
        after[name] = {**({} if "distribution" in keys else entries[name]), **keys}
    document = replace(campaign.document, data={**data, "dispersions": {**entries, **after}})
    try:
        model = validate(document, Campaign)
        laws = {name: model.dispersions[name].make_law(PARAMETERS[PARAMETER_INDEX[name]]) for name in after}
    except (InputError, Refusal) as error:
        raise InputError(_SET, None, None, error.found, error.wanted) from None
    mixed = [campaign.names[column] for column in campaign.copula.columns]
    for name, law in laws.items():
        _check_support(name, campaign.laws[name], law)
        if name in mixed and any(isinstance(campaign.laws[other], DiscreteLaw) for other in mixed):
            found = f"'{name}', correlated with a discrete choice"
            raise InputError(_SET, None, None, found, "a parameter without such a correlation")
    return Change({name: dict(entries[name]) for name in after}, after, laws)


def _check_support(name: str, old: Law, new: Law) -> None:
    """Flights exist wherever the new law has weight. Raises InputError."""
    if isinstance(old, DiscreteLaw) and isinstance(new, DiscreteLaw):
        missing = np.setdiff1d(new.values, old.values)
        if missing.size:
            wanted = f"some of {', '.join(f'{value:g}' for value in old.values)}"
            raise InputError(_SET, None, None, f"{name} at {missing[0]:g}, where nothing was flown", wanted)
        return
    if not (isinstance(old, ContinuousLaw) and isinstance(new, ContinuousLaw)):
        found = f"a change of {name} between a discrete choice and a continuous law"
        raise InputError(_SET, None, None, found, "a law of the same kind")
    (low, high), (first, last) = old.frozen.support(), new.frozen.support()
    slack = _SLACK * (high - low) if np.isfinite(high - low) else 0.0
    if first < low - slack or last > high + slack:
        found = f"{name} from {first:g} to {last:g}, beyond what was flown"
        raise InputError(_SET, None, None, found, f"a law within {low:g} .. {high:g}, or a fresh campaign")


def weigh_flights(campaign: CheckedCampaign, change: Change, samples: Floats) -> Floats:
    """By how much each flight ``[flight, parameter]`` counts under the changed laws, mean about 1."""
    weights = np.ones(len(samples))
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, law in change.laws.items():
            values = samples[:, campaign.names.index(name)]
            weights *= law.density(values) / campaign.laws[name].density(values)
    mixed = [campaign.names[column] for column in campaign.copula.columns]
    if any(name in change.laws for name in mixed):
        columns = samples[:, list(campaign.copula.columns)]
        old = [campaign.laws[name] for name in mixed]
        new = [change.laws.get(name, law) for name, law in zip(mixed, old, strict=True)]
        weights *= np.exp(_log_copula(campaign.copula, new, columns) - _log_copula(campaign.copula, old, columns))
    return np.nan_to_num(weights, nan=0.0, posinf=0.0)


def _log_copula(copula: Copula, laws: Sequence[Law], columns: Floats) -> Floats:
    """Logarithm of the Gaussian copula's density ``[flight]``, but for a constant."""
    from scipy.linalg import solve_triangular
    from scipy.special import ndtri

    uniform = np.column_stack([law.cdf(column) for law, column in zip(laws, columns.T, strict=True)])
    normal = ndtri(np.clip(uniform, 2.0**-53, 1.0 - 2.0**-53))
    mixed = solve_triangular(copula.factor, normal.T, lower=True)
    return np.asarray(0.5 * (np.sum(normal**2, axis=1) - np.sum(mixed**2, axis=0)))


def unseen_probability(campaign: CheckedCampaign, change: Change, samples: Floats) -> Unseen:
    """Probability, under the changed laws, of values that no flight ``[flight, parameter]`` stands for."""
    parts = []
    for name, law in change.laws.items():
        values = samples[:, campaign.names.index(name)]
        if isinstance(law, DiscreteLaw):
            parts.append(unseen_of_values(law.values, law.density(law.values), values))
        else:
            ends = np.array([values.min(), values.max()])
            low, high = law.cdf(ends).tolist()
            weights = np.nan_to_num(law.density(ends) / campaign.laws[name].density(ends), posinf=0.0)
            parts.append(unseen_of_range((low, 1.0 - high), (weights[0], weights[1]), values.size))
    return join_unseen(parts)
