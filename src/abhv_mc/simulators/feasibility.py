"""What a campaign asks for and cannot get: requirements that no flight decides, laws that leave what has a meaning.

`validate` refuses these; `run` says them and flies, since the rest of the campaign may be worth it.
"""

import re
from collections.abc import Iterator

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import ContinuousMarginal
from abhv_mc.io.documents import InputError
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, Vehicle
from abhv_mc.statistics.evidence import flights_to_pass

# Without a meaning at or below zero. A factor on a coefficient has one: the part is absent or turned around.
_ABOVE_ZERO = re.compile(
    r"^(atmosphere\.|actuator\.|engine\.|mass\.(total|inertia_(xx|yy|zz))$|propulsion\.specific_impulse$"
    r"|aero\.(lift|drag)$|propulsion\.thrust$|wind\.(turbulence|gust)_length$)"
)
_RARELY = 1e-6  # probability that an unbounded law may have beyond a bound
_FIRST = 1000  # flights whose derived inputs are looked at


def find_impossible(campaign: Experiment) -> list[InputError]:
    """Everything of that kind, each with its place in the file."""
    return [*_requirements(campaign), *_meaningless(campaign)]


def find_lacking(campaign: Experiment, vehicle: Vehicle) -> list[InputError]:
    """Dispersions of parts that the vehicle does not have, and that would leave every flight as it is."""
    wish = "a dispersion that matters to this vehicle"
    return [
        refuse_input(campaign, name, f"'{name}' of a vehicle that has no such part", wish)
        for name in campaign.varied
        if not _has(vehicle, name)
    ]


def refuse_input(campaign: Experiment, name: str, found: str, expected: str) -> InputError:
    """What to raise for an input that varies, where the file says that it does."""
    place: tuple[str, ...] = (
        ("dispersions", name) if campaign.sample_file is None else ("sampling",)
    )
    if name not in campaign.names:
        place = ("unknowns" if name in campaign.unknowns.names else "derived", name)
    return campaign.document.key_error(place, found, expected)


def values_of(campaign: Experiment, name: str) -> Floats:
    """Values of an input that varies, with its ends; of unbounded laws all but one in 1e6."""
    if name in campaign.unknowns.names:
        at = campaign.unknowns.names.index(name)
        return np.array([campaign.unknowns.low[at], campaign.unknowns.high[at]])
    if name not in campaign.names:
        rows = campaign.rows(campaign.make_samples().draw(0, min(campaign.runs, _FIRST)))
        return rows[:, campaign.parameters.index[name]]
    if campaign.sample_file is not None:
        return campaign.sample_file.values[:, campaign.names.index(name)]
    marginal = campaign.marginals[name]
    return np.append(
        marginal.ppf(np.array([_RARELY, 1.0 - _RARELY])), marginal.at_fraction(np.array([0.0, 1.0]))
    )


def asked_in_vain(campaign: Experiment) -> list[str]:
    """The same in sentences (without their full stops), where it is no reason to refuse the campaign."""
    return [
        f"the campaign asks for {error.found}; it takes {error.expected}"
        for error in find_impossible(campaign)
    ]


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
            found = (
                f"'{entry.metric}' above {low:g}, which every flight meets: it is never negative"
            )
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


def _meaningless(campaign: Experiment) -> Iterator[InputError]:
    """Values at or below zero of what has a meaning above it only."""
    for name in campaign.varied:
        if campaign.parameters[name].of_user:
            continue
        least = float(values_of(campaign, name).min())
        if np.isnan(least):
            yield refuse_input(
                campaign, name, f"'{name}' that is no number", "an expression that is one"
            )
        elif least <= 0.0 and _ABOVE_ZERO.search(name):
            marginal = campaign.marginals.get(name)
            if (
                least == 0.0
                and isinstance(marginal, ContinuousMarginal)
                and marginal.density(np.array(1e-12)) < 1e-6
            ):
                continue  # a law that comes near zero and never reaches it
            wish = "values above zero, as of a truncated_normal or lognormal law: at or below it has no meaning"
            entry = campaign.dispersions.get(name, {})
            width = entry.get("half_width", entry.get("sigma"))
            if isinstance(width, (int, float)) and width >= 1:
                wish = f"did you mean '{width:g} %' in place of {width:g}?"
            yield refuse_input(campaign, name, f"'{name}' down to {least:g}", wish)


def _has(vehicle: Vehicle, name: str) -> bool:
    """Whether a parameter multiplies anything of the vehicle. What is added, and what no file lacks, does."""
    group, _, rest = name.partition(".")
    if (vehicle.foreign.aerodynamics and group == "aero") or (
        vehicle.foreign.propulsion and group == "propulsion"
    ):
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
    thrust = "capture_area_ratio", "thrust_area"
    rows: dict[str, tuple[str, ...]] = {
        "propulsion.thrust": thrust,
        "propulsion.specific_impulse": thrust,
    }
    rows["mass.inertia_13"] = ("inertia_13",)
    return name not in rows or any(np.any(_values(vehicle, row)) for row in rows[name])


def _values(vehicle: Vehicle, row: str) -> np.ndarray:
    """All nodes of one of the fixed tables."""
    tables = vehicle.tables
    number = int(tables.fixed_row[FIXED_TABLE_ROWS.index(row)])
    group = int(np.searchsorted(tables.group_row, number, side="right")) - 1
    stop = np.append(tables.group_start, tables.data.size)[group + 1]
    block = tables.data[tables.group_start[group] : stop].reshape(-1, tables.group_width[group])
    values: np.ndarray = block[:, number - tables.group_row[group]]
    return values
