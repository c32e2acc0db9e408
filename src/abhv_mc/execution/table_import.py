"""Import of tables of flights, computed by another simulator, into a results folder.

Tests check whether the inputs are independent draws from the stated distributions.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from abhv_mc.array_types import Floats, Ints
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import Marginal, find_atoms, find_moments, outside
from abhv_mc.execution.executor import FlightRunner
from abhv_mc.execution.flight_tables import read_flight_tables
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.execution.runner import RunResult, fly_opened
from abhv_mc.execution.setup import OpenCampaign, make_manifest
from abhv_mc.folder.flights import (
    END_TIME,
    Digest,
    FlightRows,
    SampleReader,
    flights_schema,
    write_block,
    write_samples,
)
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.inputs import FolderInputs, collect_inputs, describe_changes, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import RUNNING
from abhv_mc.folder.opening import FlownFolder, begin_folder, open_folder
from abhv_mc.folder.requirement_sets import mark_later_choices, replace_requirements
from abhv_mc.io.messages import InputError, InputErrors, counted
from abhv_mc.statistics.table_checks import Column, TableFindings, check_table, half_steps


def import_tables(
    tables: Sequence[Path], campaign_file: Path, out: Path | None = None, fresh: bool = False
) -> RunResult:
    """Import flights into a results folder, or resume the import.

    The campaign has no simulator. Either one table contains inputs and results, or a table of
    inputs and a table of results are paired by flight number. Requirements get verdicts if tests
    do not reject the independence of the inputs, and estimates otherwise. Raise InputError, which
    states the row, if a table is invalid.
    """
    campaign = read_campaign(campaign_file, runs=1)
    if campaign.can_rerun:
        raise campaign.document.error(
            (),
            "the flights of this campaign are computed by abhv-mc",
            "a campaign with 'inputs' and without a simulator",
        )
    table = read_flight_tables(tables, campaign)
    pa.default_memory_pool().release_unused()
    samples, blocks, name = table.samples, list(table.blocks), tables[-1].name
    campaign = read_campaign(campaign_file, runs=len(samples))
    reasons = check_draws(table.path, campaign, samples, table.factors, table.lines)
    if reasons:
        campaign = _without_verdicts(campaign)
    inputs = collect_inputs(campaign)
    with ExitStack() as stack:
        stack.enter_context(sigterm_as_interrupt())
        folder = CampaignFolder(out or Path("reports") / campaign.name)
        flown = open_folder(folder, fresh, stack)
        if flown is not None:
            _check_same(flown, inputs, samples)
            files = flown.files
            manifest = replace_requirements(folder, flown.manifest, files, inputs.data)
            campaign, _ = mark_later_choices(folder, manifest, campaign)
        else:
            files = begin_folder(folder, inputs, {}, stack)
            write_samples(
                folder.samples,
                campaign.inputs,
                len(samples),
                lambda first, stop: samples[first:stop],
                {"table": name},
                table=campaign.parameters,
            )
            manifest = files.write_manifest(
                make_manifest(campaign, inputs, {}, (*table.warnings, *reasons))
            )
        digests = (block.digest() for block in blocks)
        if manifest.complete and manifest.digest != str(sum(digests, Digest())):
            problem = "the folder contains the flights of another table"
            raise InputError(folder.root, problem, "another folder (-o DIR), or --fresh")
        stored = [path for path in files.paths() if path.parent == folder.flights]
        if not manifest.complete or any(map(files.damage, stored)):
            _write_blocks(folder, files, campaign, blocks, name)
            manifest = replace(manifest, state=RUNNING)
        opened = OpenCampaign(folder, campaign, manifest, campaign.controllers, files)
        return fly_opened(opened, lambda: FlightRunner(campaign.simulator.engine.fly, 1))


def _without_verdicts(campaign: Experiment) -> Experiment:
    """Return the campaign with `independent: no`, so that requirements get only estimates."""
    data = campaign.document.entries
    document = replace(campaign.document, data={**data, "independent": False})
    model = campaign.model.model_copy(update={"independent": False})
    return replace(campaign, document=document, model=model)


def _check_same(flown: FlownFolder, inputs: FolderInputs, samples: Floats) -> None:
    """Raise InputError if the folder contains another campaign or another table."""
    before = read_folder_inputs(flown.folder, flown.manifest)
    changes = describe_changes(before, inputs, extensible=False)
    if flown.manifest.search:
        changes = ["the flights of a search"]
    elif not changes:
        stored = SampleReader(flown.folder.samples)
        if not np.array_equal(stored.rows(0, stored.flights), samples):
            changes = ["samples: imported from a table with other inputs"]
    if changes:
        problem = "the folder contains another campaign:\n  " + "\n  ".join(changes)
        raise InputError(flown.folder.root, problem, "another folder (-o DIR), or --fresh")


def _write_blocks(
    folder: CampaignFolder,
    files: FileHashes,
    campaign: Experiment,
    blocks: list[FlightRows],
    source: str,
) -> None:
    """Write the flights and delete files of an interrupted import."""
    stale = list(folder.flights.glob("*.parquet"))
    files.forget(*stale)
    for path in stale:
        path.unlink()
    schema = flights_schema(
        campaign.inputs,
        {"table": source},
        (*campaign.measured, END_TIME),
        campaign.parameters,
        campaign.outcomes,
    )
    for block in blocks:
        write_block(folder.flights, block, schema)


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
