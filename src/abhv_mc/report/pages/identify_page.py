"""Printed results of `abhv-mc identify`."""

from collections.abc import Iterator, Mapping

from abhv_mc.search.identify import FIT_RISK, Identification
from abhv_mc.topics.formatting import p_equation, percent, significant
from abhv_mc.topics.section import Section, make_records


def make_identify_section(answer: Identification) -> Section:
    """Return the estimates, residuals and fit of an identification."""
    return Section("Summary", (make_records(_texts(answer)),))


def _texts(answer: Identification) -> Iterator[tuple[str, str]]:
    fit = f"{p_equation(answer.p_value)}, rejected below {percent(FIT_RISK)}"
    if answer.converged:
        yield "Model fits" if answer.fits else "Model does not fit", fit
    else:
        yield "Not converged", "the estimates are not the best fit; the fit is not judged"
    for entry in answer.parameters:
        spread = "unknown" if entry.spread is None else significant(entry.spread, 3)
        yield (
            f"{entry.name} ({entry.unit})",
            f"{significant(entry.mean, 4)} (standard error {significant(entry.mean_error, 2)}), "
            f"spread {spread}",
        )
        for unit, value in entry.values.items():
            error = significant(1.96 * entry.errors[unit], 2)
            yield f"{entry.name}, {unit}", f"{significant(value, 4)} +- {error} (95 %)"
    for group, correlation in answer.inseparable:
        yield "Not separable", f"{', '.join(group)} (correlation {correlation:.2f})"
    yield "Nuisances", ", ".join(answer.nuisances)
    yield "Noise (sigma)", _list(answer.noise)
    for flight, residuals in answer.residuals.items():
        offset = f", clock offset {answer.offsets[flight]:.3g} s"
        yield flight, f"residuals (rms, sigmas) {_list(residuals)}{offset}"
    yield "Simulations", f"{answer.simulations} of each flight"


def _list(numbers: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {significant(value, 3)}" for name, value in numbers.items())
