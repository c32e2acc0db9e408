"""Printed results of `abhv-mc identify`."""

from collections.abc import Iterator

from abhv_mc.search.identify import FIT_RISK, Identification
from abhv_mc.topics.formatting import p_equation, percent, significant
from abhv_mc.topics.section import Cell, Section, Table, make_records


def make_identify_section(answer: Identification) -> Section:
    """Return the estimates, residuals and fit of an identification."""
    estimates = tuple(
        (
            Cell(parameter.name, head=True),
            Cell(unit),
            Cell(significant(value, 4)),
            Cell(significant(1.96 * parameter.errors[unit], 2)),
        )
        for parameter in answer.parameters
        for unit, value in parameter.values.items()
    )
    residuals = tuple(
        (Cell(flight, head=True), Cell(name), Cell(significant(rms, 3)))
        for flight, channels in answer.residuals.items()
        for name, rms in channels.items()
    )
    heads = ("Parameter", "Vehicle or flight", "Estimate", "95 % interval (+-)")
    return Section(
        "Summary",
        (
            make_records(_texts(answer)),
            Table("Estimates", heads, (estimates,)),
            Table("Residuals", ("Flight", "Channel", "rms in sigmas"), (residuals,)),
        ),
    )


def _texts(answer: Identification) -> Iterator[tuple[str, str]]:
    fit = f"{p_equation(answer.p_value)}, rejected below {percent(FIT_RISK)}"
    yield "Model fits" if answer.fits else "Model does not fit", fit
    for entry in answer.parameters:
        unit = "" if entry.unit == "-" else f" {entry.unit}"
        spread = "" if entry.spread is None else f", spread {significant(entry.spread, 3)}{unit}"
        error = significant(entry.mean_error, 2)
        yield entry.name, f"{significant(entry.mean, 4)} (standard error {error}){unit}{spread}"
    for group, correlation in answer.inseparable:
        yield "Not separable", f"{', '.join(group)} (correlation {correlation:.2f})"
    yield "Nuisances", ", ".join(answer.nuisances)
    noise = (f"{name} {significant(answer.noise[name], 2)}" for name in answer.estimated_noise)
    yield "Noise estimated (sigma)", ", ".join(noise)
    offsets = (f"{name} {offset:.3g} s" for name, offset in answer.offsets.items() if offset)
    yield "Clock offsets", ", ".join(offsets)
    yield "Simulations", f"{answer.simulations} of each flight"
    yield "Columns ignored", ", ".join(answer.ignored)
