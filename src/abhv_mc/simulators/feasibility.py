"""What a campaign asks for and cannot get: requirements that no flight decides, laws that leave what has a meaning.

`validate` refuses these; `run` says them and flies, since the rest of the campaign may be worth it.
"""

import re
from collections.abc import Iterator

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import ContinuousMarginal, MixtureMarginal
from abhv_mc.io.documents import InputError
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, Vehicle
from abhv_mc.statistics.evidence import flights_to_pass

# Without a meaning at or below zero. A factor on a coefficient has one: the part is absent or turned around.
_ABOVE_ZERO = re.compile(
    r"^(atmosphere\.|actuator\.|engine\.|mass\.(total|inertia_(xx|yy|zz))$|propulsion\.specific_impulse$"
    r"|aero\.(lift|drag)$|propulsion\.thrust$|wind\.(turbulence|gust)_length$)"
)
_MOST_BELOW_ZERO = 1e-6  # probability that an unbounded law may have there
_FIRST = 1000  # flights whose derived inputs are looked at


def find_impossible(campaign: Experiment, vehicle: Vehicle | None = None) -> list[InputError]:
    """Everything of that kind, each with its place in the file; with ``vehicle`` also what that has nothing of."""
    found = [*_requirements(campaign)]
    if campaign.user_model is None:
        found += [*_laws(campaign), *_derived(campaign)]
    return found if vehicle is None else [*found, *_lacking(campaign, vehicle)]


def asked_in_vain(campaign: Experiment) -> list[str]:
    """The same in sentences (without their full stops), where it is no reason to refuse the campaign."""
    return [f"the campaign asks for {error.found}; it takes {error.expected}" for error in find_impossible(campaign)]


def _requirements(campaign: Experiment) -> Iterator[InputError]:
    document, entries = campaign.document, campaign.requirements
    for i, entry in enumerate(entries):
        low, high = entry.limits
        if not campaign.metrics[entry.metric].never_negative:
            continue
        if high is not None and high <= 0.0:
            found = f"'{entry.metric}' below {high:g}, which no flight meets: it is never negative"
            yield document.error(("requirements", i, "below"), found, "a limit above zero")
        elif low is not None and low < 0.0:
            found = f"'{entry.metric}' above {low:g}, which every flight meets: it is never negative"
            yield document.error(("requirements", i, "above"), found, "a limit from zero on")
    if not campaign.judged:
        return
    family = campaign.family_risk
    verdicts = len(entries) * len(campaign.controllers)
    for i, entry in enumerate(entries):
        # Every requirement is judged on every controller; where each flight met all, Holm's first step decides.
        risk = min(entry.consumer_risk, family / verdicts) if family else entry.consumer_risk
        needed = flights_to_pass(0, entry.probability, risk)
        if needed <= campaign.runs_at_point:
            continue
        found = (
            f"a probability of {entry.probability:g} that no outcome of {campaign.runs_at_point} flights shows at a "
            f"risk of {risk:g}"
        )
        wish = f"at least {needed} flights, or a lower probability"
        yield document.error(("requirements", i, "probability"), found, wish)


def _laws(campaign: Experiment) -> Iterator[InputError]:
    """Laws that give values at or below zero to what has a meaning above it only."""
    for name, low in zip(campaign.unknowns.names, campaign.unknowns.low.tolist(), strict=True):
        if _ABOVE_ZERO.search(name) and low <= 0.0:
            wish = "values above zero: at or below it has no meaning"
            yield campaign.document.key_error(("unknowns", name), f"'{name}' down to {low:g}", wish)
    for column, name in enumerate(campaign.names):
        if not _ABOVE_ZERO.search(name):
            continue
        if campaign.sample_file is not None:
            least = float(campaign.sample_file.values[:, column].min())
            if least <= 0.0:
                found = f"'{name}' down to {least:g} in the samples"
                yield campaign.document.error(("sampling",), found, "values above zero: below it has no meaning")
            continue
        marginal = campaign.marginals[name]
        if isinstance(marginal, ContinuousMarginal | MixtureMarginal):
            least = float(marginal.frozen.support()[0]) if isinstance(marginal, ContinuousMarginal) else -np.inf
            if not np.isfinite(least):
                below = float(marginal.cdf(np.zeros(1))[0])
                if below > _MOST_BELOW_ZERO:
                    found = f"'{name}' at or below zero with a probability of {below:.2g}"
                    wish = f"at most {_MOST_BELOW_ZERO:g}: below zero it has no meaning; truncated_normal, or lognormal"
                    yield campaign.document.key_error(("dispersions", name), found, wish)
                continue
            if least == 0.0 and float(marginal.density(np.array([1e-12]))[0]) < 1e-6:
                continue  # a lognormal law comes near zero and never reaches it
        else:
            least = float(marginal.at_fraction(np.zeros(1))[0])
        if least <= 0.0:
            found = f"'{name}' down to {least:g}"
            yield campaign.document.key_error(
                ("dispersions", name), found, "values above zero: at or below it has no meaning"
            )


def _derived(campaign: Experiment) -> Iterator[InputError]:
    """Derived inputs that some of the first flights have without a meaning."""
    if not campaign.derived:
        return
    rows = campaign.rows(campaign.make_samples().draw(0, min(campaign.runs, _FIRST)))
    for each in campaign.derived:
        values = rows[:, PARAMETER_INDEX[each.name]]
        least = float(values.min())
        if np.isnan(least):
            yield campaign.document.error(("derived", each.name), "an expression that is no number", "one that is")
        elif least <= 0.0 and _ABOVE_ZERO.search(each.name):
            found = f"'{each.name}' down to {least:g}"
            wish = "values above zero: at or below it has no meaning"
            yield campaign.document.error(("derived", each.name), found, wish)


def _lacking(campaign: Experiment, vehicle: Vehicle) -> Iterator[InputError]:
    """Dispersions of parts that the vehicle does not have, and that would leave every flight as it is."""
    where = ("sampling",) if campaign.sample_file is not None else ("dispersions",)
    for name in campaign.varied:
        if _has(vehicle, name):
            continue
        drawn = name in campaign.names
        place = (*where, name) if drawn and campaign.sample_file is None else where if drawn else ("derived", name)
        found = f"'{name}' of a vehicle that has no such part"
        yield campaign.document.key_error(place, found, "a dispersion that matters to this vehicle")


def _has(vehicle: Vehicle, name: str) -> bool:
    """Whether a parameter multiplies anything of the vehicle. What is added, and what no file lacks, does."""
    group, _, rest = name.partition(".")
    if vehicle.foreign.aerodynamics and group == "aero":
        return True
    if vehicle.foreign.propulsion and group == "propulsion":
        return True
    if group == "aero" and not rest.endswith(".increment"):
        coefficient, _, variable = rest.partition(".")
        if variable:
            return bool(np.any(vehicle.build_up.factor == PARAMETER_INDEX[name]))
        return bool(np.any(vehicle.build_up.coefficient == COEFFICIENTS.index(coefficient)))
    if effector := re.match(r"effector_(\d+)", rest):
        return int(effector[1]) < len(vehicle.effector_mix)
    if group == "engine":
        return vehicle.constants.equivalence_ratio_max > 0.0
    if name == "mass.inertia_13":
        return bool(np.any(_values(vehicle, "inertia_13")))
    return name not in ("propulsion.thrust", "propulsion.specific_impulse") or any(
        np.any(_values(vehicle, row)) for row in ("capture_area_ratio", "thrust_area")
    )


def _values(vehicle: Vehicle, row: str) -> np.ndarray:
    """All nodes of one of the fixed tables."""
    tables = vehicle.tables
    number = int(tables.fixed_row[FIXED_TABLE_ROWS.index(row)])
    group = int(np.searchsorted(tables.group_row, number, side="right")) - 1
    stop = np.append(tables.group_start, tables.data.size)[group + 1]
    block = tables.data[tables.group_start[group] : stop].reshape(-1, tables.group_width[group])
    values: np.ndarray = block[:, number - tables.group_row[group]]
    return values
