"""Tests of whether imported flights are random draws from the campaign's dispersions."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import Marginal, find_atoms, find_moments, outside
from abhv_mc.io.input_error import InputError, InputErrors
from abhv_mc.io.phrases import counted
from abhv_mc.statistics.table_checks import Column, TableFindings, check_table, half_steps

_ESTIMATES = "'independent: no' for estimates without verdicts"
_MISSING = "rows of failed flights may be missing"


def check_draws(
    path: Path, campaign: Experiment, samples: Floats, factors: Floats, lines: Ints
) -> tuple[str, ...]:
    """Return sentences that state why the rows of a table are not independent draws.

    ``samples`` [flight, input] are in the units of the campaign, ``factors`` [input] convert from
    the units of the table, and ``lines`` [flight] are line numbers in the table. Raise InputErrors
    if a value lies outside the range of its distribution, or if a table whose draws are declared
    independent contradicts the declared dispersions.
    """
    columns = []
    for name, marginal in campaign.marginals.items():
        i = campaign.inputs.index(name)
        values = samples[:, i]
        rounding = half_steps(values / factors[i]) * abs(factors[i])
        is_outside = outside(marginal, values, rounding)
        if is_outside.any():
            row = int(np.argmax(is_outside))
            problem = f"the value {values[row]:.10g} of '{name}' is outside its distribution"
            raise InputError(path, problem, "a draw from the stated distribution", int(lines[row]))
        if campaign.judged:
            columns.append(make_column(marginal, values, rounding))
    if not columns:
        return ()
    findings = check_table(columns, campaign.copula.correlations(len(columns)))
    errors = [
        InputError(path, problem, expected, line)
        for problem, expected, line in _contradictions(findings, campaign, columns, lines)
    ]
    if errors:
        raise InputErrors(errors)
    names = list(campaign.marginals)
    return (
        *(
            f"'{names[j]}' follows its stated distribution more closely than independent draws do, "
            "as in a Latin hypercube: requirements get estimates instead of verdicts"
            for j in findings.too_close
        ),
        *(
            f"'{names[j]}' is {columns[j].values[0]:.10g} in all rows, so the table does not show "
            "its dispersion: requirements get estimates instead of verdicts"
            for j in findings.constant
        ),
    )


def make_column(marginal: Marginal, values: Floats, rounding: Floats) -> Column:
    """Return a column of values [flight] with the largest rounding error of each value."""
    atoms = find_atoms(marginal)
    step = np.maximum(2.0 * rounding, np.diff(np.unique(values)).min(initial=np.inf))
    ends = marginal.cdf(np.array([np.min(values - step), np.max(values + step)]))
    return Column(
        values=values,
        half_step=rounding,
        low=marginal.cdf(np.nextafter(values - rounding, -np.inf)),
        high=marginal.cdf(values + rounding),
        atoms=atoms,
        shares=marginal.cdf(atoms) - marginal.cdf(np.nextafter(atoms, -np.inf)),
        tails=(float(ends[0]), float(1.0 - ends[1])),
    )


def _contradictions(
    findings: TableFindings, campaign: Experiment, columns: list[Column], lines: Ints
) -> Iterator[tuple[str, str, int]]:
    """Yield (problem, expected value, line) for each finding that contradicts independence."""
    names = list(campaign.marginals)
    levels = {level.column: level for level in reversed(findings.levels)}
    for j in sorted({*findings.too_far, *levels}):
        values, unit = columns[j].values, campaign.parameters[names[j]].unit
        mean, sigma = find_moments(campaign.marginals[names[j]])
        problem = (
            f"column '{names[j]}' ({unit}) is not drawn from its distribution: stated mean "
            f"{mean:.6g} and spread {sigma:.4g}, found mean {values.mean():.6g} and spread "
            f"{values.std():.4g}"
        )
        if j in levels:
            level = levels[j]
            problem += f"; the value {level.value:.6g} is in {level.count} of "
            problem += f"{counted(len(values), 'row')}, but its stated probability is "
            problem += f"{100 * level.probability:.4g} %"
        yield problem, f"draws from the stated distributions ({_MISSING}), or {_ESTIMATES}", 1
    for j, side in findings.missing:
        mean, sigma = find_moments(campaign.marginals[names[j]])
        end = (np.sort(columns[j].values)[-side] - mean) / sigma
        problem = (
            f"column '{names[j]}' has no value beyond {end:+.1f} sigma: state the truncation, or "
            "failed rows are missing"
        )
        yield problem, f"all draws from the stated distributions, or {_ESTIMATES}", 1
    for pair in findings.correlations:
        a, b = (names[j] for j in pair.columns)
        problem = (
            f"the rank correlation of '{a}' and '{b}' is {pair.found:.3g} with equal values in the "
            f"most favourable order, but {pair.stated:.3g} is expected"
        )
        yield problem, f"'correlations' that match the table ({_MISSING}), or {_ESTIMATES}", 1
    if equal := findings.equal:
        first, second = (int(lines[row]) for row in equal.example)
        explained = f"about {equal.explained:.2g}" if equal.explained > 0.01 else "none"
        pairs = counted(equal.pairs, "pair of rows has/pairs of rows have")
        problem = (
            f"{pairs} the same inputs, such as lines {first} and {second}; rounding explains "
            f"{explained} of them"
        )
        yield problem, f"different inputs in all flights, or {_ESTIMATES}", second
