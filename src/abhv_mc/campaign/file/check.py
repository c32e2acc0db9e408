"""Consistency checks of the entries of a campaign file.

The models of vehicles, missions and controllers are imported on first use, because campaigns of
custom simulators do not need them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike

import numpy as np

from abhv_mc.campaign.file.config import BY_REQUIREMENTS, Campaign, Compared, select_asked
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.kinds import find_kind
from abhv_mc.campaign.file.requirements import (
    check_requirements,
    check_stop,
    read_tables,
    select_requirements,
)
from abhv_mc.campaign.file.systems import Registered, find_simulator, systems_key
from abhv_mc.campaign.file.unknowns import check_unknowns, match_requirements
from abhv_mc.campaign.sampling.derived_parameters import Derived, compile_derived
from abhv_mc.campaign.sampling.designs import (
    FACTORIAL,
    INDEPENDENT,
    Copula,
    count_flights,
    is_discrete,
    make_copula,
    normal_correlation,
)
from abhv_mc.campaign.sampling.marginals import Marginal
from abhv_mc.campaign.sampling.samples import SampleFile, full_rows, read_sample_file
from abhv_mc.flights.parameters import Parameters
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, Problems, read_document, validate
from abhv_mc.io.messages import InputErrors, Refusal, counted, one_of, quoted
from abhv_mc.io.units import parse_in_any_unit

_SAME = 1e-9  # relative tolerance within which nominal values count as equal


def check_derived(model: Campaign, parameters: Parameters, errors: Problems) -> Derived:
    """Return the derived inputs of a campaign; append problems to ``errors``."""
    derived_inputs = []
    nominal = full_rows((), np.empty((1, 0)), (), parameters)
    for name, text in model.derived.items():
        where = ("derived", name)
        if name not in parameters:
            errors.add_key(
                where, f"unknown parameter '{name}'", one_of(parameters.dispersible, name)
            )
            continue
        with errors.collect(*where):
            derived_input = compile_derived(name, text, parameters)
            for operand in sorted(derived_input.of & model.derived.keys() - {name}):
                raise Refusal(
                    f"'{operand}' is itself a derived parameter",
                    "a drawn parameter, or the expression that defines the derived parameter",
                )
            for operand in sorted({name, *derived_input.of}):
                if parameters[operand].seed:
                    raise Refusal(f"'{operand}' is a random seed", "a parameter that is a quantity")
            value, usual = (
                float(derived_input.program.evaluate(nominal)[0]),
                parameters[name].nominal,
            )
            if not (value == usual or math.isclose(value, usual, rel_tol=_SAME, abs_tol=_SAME)):
                raise Refusal(
                    f"the value is {value:g} if all parameters are nominal",
                    f"the nominal value {usual:g} (specify a bias as the mean of a distribution)",
                )
            derived_inputs.append(derived_input)
    return tuple(derived_inputs)


def read_campaign(
    path: str | PathLike[str],
    runs: int | None = None,
    seed: int | None = None,
    controllers: Sequence[str] | None = None,
    engine: Engine | None = None,
) -> Experiment:
    """Read and check a campaign file. Raise InputErrors with all problems.

    ``runs``, ``seed`` and ``controllers`` override the entries of these names in the file.
    """
    document = read_tables(read_document(path))
    file_runs = document.data.get("runs") if isinstance(document.data, dict) else None
    overrides = {key: value for key, value in (("runs", runs), ("seed", seed)) if value is not None}
    if overrides and isinstance(document.data, dict):
        document = replace(document, data=document.data | overrides)
    campaign = check_campaign(
        document, engine
    )  # Controllers that are not selected must also be valid.
    if controllers is not None:
        campaign = check_campaign(_select_controllers(campaign.document, controllers), engine)
    return replace(campaign, file_runs=file_runs)


def check_campaign(document: Document, engine: Engine | None = None) -> Experiment:
    """Check a campaign document. Raise InputErrors with all problems."""
    if (kind := find_kind(document, "campaign")) != "campaign":
        raise document.error((), f"this is a {kind} file", "a campaign file")
    document, simulator = read_tables(document), find_simulator(document)
    document = simulator.prepare(document)
    return replace(_check(document, validate(document, simulator.keys), simulator), engine=engine)


def _check(document: Document, model: Campaign, simulator: Registered) -> Experiment:
    """Check constraints that the pydantic model cannot express. Raise InputErrors."""
    errors = Problems(document)
    contents = simulator.read(document, model, errors)
    parameters = contents.parameters
    marginals = _make_marginals(model, parameters, errors)
    sample_file = read_sample_file(model.sampling.path, parameters) if model.sampling.path else None
    names = sample_file.names if sample_file else tuple(model.dispersions)
    copula, document = _make_copula(model, names, marginals, errors)
    derived = check_derived(model, parameters, errors)
    units = {metric.name: metric.unit for metric in contents.metrics}
    _check_measured(model, units | dict(contents.units), errors)
    requirements = tuple(check_requirements(model, contents, errors))
    _check_names(model, contents.systems, errors)
    other_roles = {
        **dict.fromkeys(model.derived, "derived"),
        **dict.fromkeys(model.dispersions, "a dispersion"),
    }
    box = model.unknowns, model.points, other_roles, model.sampling.design
    unknowns = check_unknowns(*box, parameters=parameters, errors=errors)
    data = document.entries
    unknowns = match_requirements(unknowns, model.points, data.get("requirements") or [])
    number = _check_runs(model, names, sample_file, errors) * len(unknowns.points)
    ranking = model.keep.histories.by
    has_margins = contents.margin_flights(number) == number
    metrics = (*contents.metrics, *(contents.margins if has_margins else ()))
    ranked = (BY_REQUIREMENTS, *(metric.name for metric in metrics))
    if ranking not in ranked:
        errors.add(
            ("keep", "histories", "by"), f"unknown metric '{ranking}'", one_of(ranked, ranking)
        )
    for item in model.keep.histories.flights:
        if isinstance(item, int) and item >= number:
            where = ("keep", "histories", "flights")
            errors.add(where, f"unknown flight {item}", f"a flight number from 0 to {number - 1}")
    check_stop(model, errors)
    joined = model.sampling.design == INDEPENDENT and not unknowns.names
    if model.pooled and (not joined or sum(pool.runs for pool in model.pooled) > number):
        pooled_flights = sum(pool.runs for pool in model.pooled)
        errors.add_key(
            ("pooled",),
            f"found {counted(pooled_flights, 'pooled flight')}",
            f"at most {counted(number, 'flight')}, as in 'runs', and 'sampling: {INDEPENDENT}'",
        )
    contents.check(number, errors)
    if errors:
        raise InputErrors(errors)
    columns = tuple(dict.fromkeys((*names, *parameters.index))) if contents.is_imported else None
    inputs = document, model, contents, number, marginals, copula, sample_file, requirements
    return Experiment(*inputs, derived=derived, unknowns=unknowns, columns=columns)


def _select_controllers(document: Document, controllers: Sequence[str]) -> Document:
    """Return a checked campaign restricted to ``controllers``."""
    data = document.entries
    key = systems_key(data)
    systems = data.get(key) or {}
    for name in controllers:
        if name not in systems:
            raise document.error(
                (key,), f"unknown {key.removesuffix('s')} '{name}'", one_of(systems, name)
            )
    chosen = {name: systems[name] for name in systems if name in controllers}
    requirements = list(select_requirements(data.get("requirements") or [], controllers))
    selected = {**data, key: chosen, "requirements": requirements}
    if tested := data.get("under_test"):
        selected["under_test"] = [name for name in tested if name in controllers]
        if not selected["under_test"]:
            problem = f"--controllers {quoted(controllers)} selects none of 'under_test'"
            raise document.error(("under_test",), problem, f"at least one of {quoted(tested)}")
    return replace(document, data=select_asked(selected, controllers))


def _check_names(model: Campaign, systems: Sequence[str], errors: Problems) -> None:
    """Check that 'under_test' and 'asks' list different controllers of the campaign."""
    compared = model.asks.compare if isinstance(model.asks, Compared) else ()
    for keys, names in ((("under_test",), model.under_test or ()), (("asks", "compare"), compared)):
        for i, name in enumerate(names):
            if name not in systems:
                problem, expected = f"unknown name '{name}'", one_of(systems, name)
            elif name in names[:i]:
                problem, expected = f"'{name}' is listed twice", "each name only once"
            else:
                continue
            errors.add((*keys, i), problem, expected)


def _make_marginals(
    model: Campaign, parameters: Parameters, errors: Problems
) -> dict[str, Marginal]:
    marginals = {}
    for name, distribution in model.dispersions.items():
        where = ("dispersions", name)
        if name not in parameters.dispersible or (
            parameters[name].seed and parameters[name].of_user
        ):
            errors.add_key(
                where,
                f"unknown parameter '{name}'"
                if name not in parameters
                else f"'{name}' is a random seed",
                one_of(parameters.dispersible, name),
            )
            continue
        if distribution.probability < 1.0 and model.sampling.design in FACTORIAL:
            errors.add(
                (*where, "probability"),
                f"the key 'probability' conflicts with the design '{model.sampling.design}', which "
                "sets all values",
                "a design that draws random values, or no key 'probability'",
            )
        with errors.collect(*where):
            marginals[name] = distribution.make_marginal(parameters[name])
    if model.sampling.design == "file" and model.dispersions:
        errors.add_key(
            ("dispersions",),
            "dispersions cannot be combined with samples from a file",
            "no dispersions, because the columns of the file define the samples",
        )
    return marginals


def _make_copula(
    model: Campaign, names: Sequence[str], marginals: Mapping[str, Marginal], errors: Problems
) -> tuple[Copula, Document]:
    """Return the copula, and the document with the solved correlations of discrete inputs.

    A folder with samples of other correlations is therefore not extended.
    """
    pairs = {}
    document, copula = errors.document, Copula((), np.eye(0))
    entries = [*document.entries.get("correlations", ())]
    for i, entry in enumerate(model.correlations):
        for j, name in enumerate(entry.between):
            if name not in names:
                problem = f"'{name}' is not dispersed"
                errors.add(("correlations", i, "between", j), problem, one_of(names, name))
            elif name in model.dispersions and model.dispersions[name].probability < 1.0:
                errors.add(
                    ("correlations", i, "between", j),
                    f"'{name}' has a probability below 1, so some flights have its nominal value",
                    "a parameter that is drawn in every flight",
                )
        pair = (min(entry.between), max(entry.between))
        if pair in pairs:
            errors.add(
                ("correlations", i), f"{quoted(pair)} are listed twice", "each pair only once"
            )
        pairs[pair] = entry.normal or 0.0
        if entry.rank is not None and marginals.keys() >= set(pair):
            both = [marginals[name] for name in pair]
            with errors.collect("correlations", i):
                pairs[pair] = normal_correlation(entry.rank, both)
            if is_discrete(both):
                entries[i] = {"between": [*entry.between], "normal": pairs[pair]}
    if pairs and model.sampling.design in (*FACTORIAL, "file"):
        errors.add_key(
            ("correlations",),
            f"the design '{model.sampling.design}' does not permit correlations",
            "no correlations, because this design sets all values",
        )
    if not errors:
        with errors.collect("correlations"):
            copula = make_copula(names, pairs)
        if entries:
            document = replace(document, data=document.entries | {"correlations": entries})
    return copula, document


def _check_measured(model: Campaign, units: Mapping[str, str], errors: Problems) -> None:
    """Check that measured quantities are known, and that their noise has a valid unit."""
    for name, value in model.measured.items():
        where = ("measured", name)
        if name not in units:
            errors.add_key(where, f"unknown channel or metric '{name}'", one_of(units, name))
            continue
        with errors.collect(*where):
            if not parse_in_any_unit(value, units[name]) >= 0.0:
                raise Refusal(f"found {value}", "a nonnegative standard deviation")


def _check_runs(
    model: Campaign, names: Sequence[str], sample_file: SampleFile | None, errors: Problems
) -> int:
    """Return the number of flights, as stated in the file or determined by the design."""
    design = model.sampling.design
    if design in FACTORIAL and not names:
        errors.add(
            ("sampling",), f"the design '{design}' requires dispersions", "at least one dispersion"
        )
        return 1
    number = (
        len(sample_file.values)
        if sample_file
        else count_flights(design, len(names), model.sampling.levels)
    )
    if number is None:
        if model.runs is None:
            errors.add(
                (),
                "the key 'runs' is missing",
                f"this key, because the design '{design}' does not determine the number of flights",
            )
        return model.runs or 1
    if number > 2**30:
        errors.add(("sampling",), f"the design has {number:.3g} flights", "at most 1e9")
    fits = model.runs is None or (model.runs <= number if sample_file else model.runs == number)
    if not fits:
        errors.add(
            ("runs",),
            f"found {model.runs}",
            f"{'at most ' if sample_file else ''}{number}, the number of flights in the design "
            f"'{design}', or no 'runs'",
        )
    return model.runs or number
