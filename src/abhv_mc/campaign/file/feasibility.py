"""Checks for undecidable requirements and for dispersions outside physical ranges.

`validate` rejects such campaigns; `run` warns, because other results may be useful.
"""

import re
from collections.abc import Iterator

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import ContinuousMarginal
from abhv_mc.io.messages import InputError, counted
from abhv_mc.statistics.evidence import flights_to_pass

# Parameters that must be positive. Factors on coefficients need not be positive, because components
# may be absent.
_ABOVE_ZERO = re.compile(
    r"^(atmosphere\.density|actuator\.|engine\.|mass\.(total|inertia_(xx|yy|zz))$|propulsion\.specific_impulse$"
    r"|aero\.(lift|drag)$|propulsion\.thrust$|wind\.(turbulence|gust)_length$)"
)
_RARELY = 1e-6  # tolerated probability of values beyond a bound
_UNLIKELY = 0.05  # required probabilities below this value are probably percentages
_USUAL = np.array([0.001, 0.999])  # probabilities of the quantiles that bound usual values
_HOT = 60.0  # largest usual offset of the air temperature, K
_OFFSETS = ("atmosphere.temperature", "atmosphere.uniform_temperature_offset")
_NARROW, _WIDE = 0.005, 5.0  # usual deviations from the nominal value, relative to it
_NEAR_ZERO = 0.1  # limit below which all values of a factor are probably wrong
# parameters with small deviations, or without a usual value
_SPECIAL = ("sensor.", "failure.", "control.", "wind.")
_FIRST = 1000  # number of flights, from flight 0, whose derived parameters are checked


def find_impossible(campaign: Experiment) -> list[InputError]:
    """Return errors for undecidable requirements and impossible dispersions."""
    return [*_requirements(campaign), *_meaningless(campaign)]


def refuse_input(campaign: Experiment, name: str, problem: str, expected: str) -> InputError:
    """Return the InputError for a varied input, with the location of its entry in the file."""
    location: tuple[str, ...] = (
        ("dispersions", name) if campaign.sample_file is None else ("sampling",)
    )
    if name not in campaign.names:
        location = ("unknowns" if name in campaign.unknowns.names else "derived", name)
    return campaign.document.key_error(location, problem, expected)


def values_of(campaign: Experiment, name: str) -> Floats:
    """Return values of a varied input, such as the ends of its range and extreme quantiles.

    The extreme quantiles exclude a probability of 1e-6 in each tail.
    """
    if name in campaign.unknowns.names:
        index = campaign.unknowns.names.index(name)
        return np.array([campaign.unknowns.low[index], campaign.unknowns.high[index]])
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
    """Return warnings about undecidable requirements and impossible dispersions."""
    problems = [f"{error.found}; required: {error.expected}" for error in find_impossible(campaign)]
    return problems + find_slips(campaign)


def find_slips(campaign: Experiment) -> list[str]:
    """Return warnings about probable slips of a factor 100 and about large temperature offsets."""
    slips = [
        campaign.document.error(
            ("requirements", i, "probability"),
            f"found a probability of {entry.probability:g}",
            f"did you mean {100.0 * entry.probability:g}?",
        )
        for i, entry in enumerate(campaign.requirements)
        if entry.probability < _UNLIKELY
    ]
    for name in campaign.varied:
        parameter, marginal = campaign.parameters[name], campaign.marginals.get(name)
        values = marginal.ppf(_USUAL) if marginal else values_of(campaign, name)
        if name in _OFFSETS and np.abs(values).max() > _HOT:
            problem = f"'{name}' is an offset and exceeds {_HOT:g} K"
            slips.append(refuse_input(campaign, name, problem, "a smaller difference"))
        is_relative = "%" in str(campaign.dispersions.get(name)) or not parameter.of_user
        if not (parameter.nominal and is_relative) or name.startswith(_SPECIAL):
            continue
        ratio = values / parameter.nominal
        is_usual = _NARROW <= np.abs(ratio - 1.0).max() < _WIDE
        if not is_usual or 0.0 < ratio.max() < _NEAR_ZERO:
            problem = f"'{name}' is {ratio.min():.4g} to {ratio.max():.4g} times its nominal value"
            slips.append(
                refuse_input(campaign, name, problem, "values without a slip of a factor 100")
            )
    return list(map(str, slips))


def _requirements(campaign: Experiment) -> Iterator[InputError]:
    document, entries = campaign.document, campaign.requirements
    for i, entry in enumerate(entries):
        low, high = entry.limits.low, entry.limits.high
        if not campaign.metrics[entry.metric].never_negative:
            continue
        if high is not None and high <= 0.0:
            yield document.error(
                ("requirements", i, "below"),
                f"no flight can meet the upper limit {high:g} of '{entry.metric}', because this "
                "metric is never negative",
                "a positive limit",
            )
        elif low is not None and low < 0.0:
            yield document.error(
                ("requirements", i, "above"),
                f"every flight meets the lower limit {low:g} of '{entry.metric}', because this "
                "metric is never negative",
                "a nonnegative limit",
            )
    if not campaign.judged:
        return
    family = campaign.family_risk
    verdicts = len(entries) * len(campaign.controllers)
    for i, entry in enumerate(entries):
        # In its first step, Holm's procedure divides the joint risk by the number of verdicts. This
        # step is decisive if no flight fails.
        risk = min(entry.consumer_risk, family / verdicts) if family else entry.consumer_risk
        needed = flights_to_pass(0, entry.probability, risk)
        if needed <= campaign.runs_at_point:
            continue
        problem = (
            f"{counted(campaign.runs_at_point, 'flight')} cannot demonstrate a probability of "
            f"{entry.probability:g} at a risk of {risk:g}"
        )
        expected = f"at least {counted(needed, 'flight')}, or a lower probability"
        yield document.error(("requirements", i, "probability"), problem, expected)


def _meaningless(campaign: Experiment) -> Iterator[InputError]:
    """Yield errors for nonpositive values of quantities that must be positive."""
    for name in campaign.varied:
        if campaign.parameters[name].of_user:
            continue
        least = float(values_of(campaign, name).min())
        if np.isnan(least):
            yield refuse_input(
                campaign,
                name,
                f"'{name}' has a value that is not a number",
                "an expression with a numerical value",
            )
        elif least <= 0.0 and _ABOVE_ZERO.search(name):
            marginal = campaign.marginals.get(name)
            if (
                least == 0.0
                and isinstance(marginal, ContinuousMarginal)
                and marginal.density(np.array(1e-12)) < 1e-6
            ):
                continue  # The values of the distribution approach zero but do not reach it.
            expected = "positive values, as from a truncated_normal or lognormal distribution"
            entry = campaign.dispersions.get(name, {})
            width = entry.get("half_width", entry.get("sigma"))
            if isinstance(width, (int, float)) and width >= 1:
                expected = f"positive values (did you mean '{width:g} %' instead of {width:g}?)"
            yield refuse_input(campaign, name, f"'{name}' has values down to {least:g}", expected)
