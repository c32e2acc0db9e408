"""What a campaign file's entries must be to each other and to the tables of parameters and metrics."""

import math
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.config import Campaign, Compared, select_asked
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.keep import ALL, BY_REQUIREMENTS
from abhv_mc.campaign.file.kinds import check_kinds, find_kind
from abhv_mc.campaign.file.requirements import (
    check_margins,
    check_requirements,
    check_stop,
    read_tables,
    select_requirements,
)
from abhv_mc.campaign.file.simulator import SimulatorCampaign, check_simulator, is_own, systems_key
from abhv_mc.campaign.file.unknowns import check_unknowns, match_requirements
from abhv_mc.campaign.file.user_metrics import (
    declare_metrics,
    find_user_channels,
    read_metrics_file,
)
from abhv_mc.campaign.sampling.derived_parameters import DOTTED, Derived, compile_derived
from abhv_mc.campaign.sampling.designs import (
    FACTORIAL,
    INDEPENDENT,
    Copula,
    count_flights,
    make_copula,
    normal_correlation,
)
from abhv_mc.campaign.sampling.marginals import Marginal
from abhv_mc.campaign.sampling.samples import SampleFile, full_rows, read_sample_file
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.channels import CHANNELS, Channel, effector_channels, state_channels
from abhv_mc.flight.metrics import MARGINS, METRICS, Metric, effector_metrics
from abhv_mc.flight.vehicle_parameters import read_vehicle_parameters
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import (
    Document,
    InputError,
    InputErrors,
    Refusal,
    one_of,
    read_document,
    validate,
)
from abhv_mc.kernel.plant.parameter_names import EFFECTORS, ENGINES
from abhv_mc.plant.parameters import OURS, Parameters
from abhv_mc.user_code.effector_commands import find_driven

_SAME = 1e-9  # by how much of itself a nominal value may be rounded


def check_derived(
    document: Document, model: Campaign, parameters: Parameters, errors: list[InputError]
) -> Derived:
    """The campaign's derived inputs; what is wrong is added to ``errors``."""
    made = []
    nominal = full_rows((), np.empty((1, 0)), (), parameters)
    for name, text in model.derived.items():
        where = ("derived", name)
        if name not in parameters:
            expected = one_of(parameters.dispersible, name)
            errors.append(document.key_error(where, f"unknown parameter '{name}'", expected))
            continue
        try:
            each = compile_derived(name, text, parameters)
            others = sorted(other for other in each.of if other in model.derived and other != name)
            if others:
                raise Refusal(
                    f"'{others[0]}', which is derived itself", "what is drawn, or its expression"
                )
            if seeds := sorted(each for each in {name, *each.of} if parameters[each].seed):
                raise Refusal(f"'{seeds[0]}', a seed", "what is a quantity")
            value, usual = float(each.evaluate(nominal)[0]), parameters[name].nominal
            if not (value == usual or math.isclose(value, usual, rel_tol=_SAME, abs_tol=_SAME)):
                found = f"{value:g} where all others are nominal"
                wish = f"{usual:g}, so that the nominal flight stays it (a bias is the mean of a distribution)"
                raise Refusal(found, wish)
            made.append(each)
        except Refusal as refusal:
            errors.append(document.error(where, refusal.found, refusal.expected))
    return tuple(made)


def read_campaign(
    path: str | PathLike[str],
    runs: int | None = None,
    seed: int | None = None,
    controllers: Sequence[str] | None = None,
    engine: Engine | None = None,
) -> Experiment:
    """Read and check a campaign file; the other arguments override its entries. Raises :class:`InputErrors`."""
    document = read_tables(read_document(path))
    file_runs = document.data.get("runs") if isinstance(document.data, dict) else None
    given = {key: value for key, value in (("runs", runs), ("seed", seed)) if value is not None}
    if given and isinstance(document.data, dict):
        document = replace(document, data=document.data | given)
    campaign = check_campaign(document, engine)  # what is left out must be right, too
    if controllers is not None:
        campaign = check_campaign(_select_controllers(campaign.document, controllers), engine)
    return replace(campaign, file_runs=file_runs)


def check_campaign(document: Document, engine: Engine | None = None) -> Experiment:
    """Check a campaign that was read already. Raises :class:`InputErrors`."""
    if (kind := find_kind(document, "campaign")) != "campaign":
        raise document.error((), f"a {kind} file", "a campaign file")
    document = name_effectors(read_tables(document))
    model: Campaign = validate(document, SimulatorCampaign if is_own(document.data) else Campaign)
    return replace(_check(document, model), engine=engine)


def _check(document: Document, model: Campaign) -> Experiment:
    """What the model does not say. Raises :class:`InputError`."""
    errors: list[InputError] = []
    own = model if isinstance(model, SimulatorCampaign) else None
    if not own:
        check_kinds(document, model)
    parameters, states = (
        (own.parameters, ())
        if own
        else read_vehicle_parameters(model.vehicle, model.controllers.values())
    )
    marginals = _make_marginals(document, model, parameters, errors)
    sample_file = read_sample_file(model.sampling.path, parameters) if model.sampling.path else None
    names = sample_file.names if sample_file else tuple(model.dispersions)
    copula = _make_copula(document, model, names, errors)
    derived = check_derived(document, model, parameters, errors)
    user_channels = find_user_channels(model.channels) if model.channels else ()
    if own:
        check_simulator(document, own, errors)
        declared: tuple[Metric, ...] = ()
        effectors: tuple[str, ...] = ()
        metrics = measured = {name: entry.record(name) for name, entry in own.metrics.items()}
    else:
        effectors = find_driven(model.vehicle, model.controllers.values())
        declared = _declare_metrics(document, model, user_channels, effectors, states, errors)
        own_channels = *effector_channels(effectors), *state_channels(states)
        _check_channels(document, model, own_channels, errors)
        metrics = {metric.name: metric for metric in (*METRICS, *declared)}
        measured = metrics | {metric.name: metric for metric in MARGINS}
    requirements = tuple(check_requirements(document, model, measured, errors))
    _check_asked(document, model, tuple(own.systems if own else model.controllers), errors)
    others = {
        **dict.fromkeys(model.derived, "derived"),
        **dict.fromkeys(model.dispersions, "a dispersion"),
    }
    box = model.unknowns, model.points, others, model.sampling.design
    unknowns = check_unknowns(document, *box, parameters, errors)
    data: Any = document.data
    unknowns = match_requirements(unknowns, model.points, data.get("requirements") or [])
    number = _check_runs(document, model, names, sample_file, errors) * len(unknowns.points)
    by = model.keep.histories.by
    ranked = (
        BY_REQUIREMENTS,
        *(measured if model.margins and model.margins.of(number) == number else metrics),
    )
    if by not in ranked:
        errors.append(document.error(("keep", "histories", "by"), f"'{by}'", one_of(ranked, by)))
    for item in model.keep.histories.flights:
        if isinstance(item, int) and item >= number:
            where = ("keep", "histories", "flights")
            errors.append(
                document.error(where, f"flight {item}", f"flights from 0 to {number - 1}")
            )
    check_stop(document, model, errors)
    joined = model.sampling.design == INDEPENDENT and not unknowns.names
    if model.pooled and (not joined or sum(part.runs for part in model.pooled) > number):
        found = f"{sum(part.runs for part in model.pooled)} pooled flights"
        errors.append(
            document.key_error(
                ("pooled",), found, f"at most {number} ('runs'), of the design {INDEPENDENT}"
            )
        )
    check_margins(document, model, number, errors)
    if errors:
        raise InputErrors(errors)
    shared = document, model, number, marginals, copula, sample_file, requirements
    return Experiment(
        *shared,
        tuple(metrics.values()),
        declared,
        user_channels,
        effectors,
        states,
        derived=derived,
        unknowns=unknowns,
        parameters=parameters,
        columns=tuple(dict.fromkeys((*names, *parameters.index)))
        if own and not own.simulator
        else None,
    )


def name_effectors(document: Document) -> Document:
    """The campaign with failures and effectiveness of the vehicle's own effectors and engines by their place.

    ``failure.right_elevon.stuck_time`` becomes ``failure.effector_0.stuck_time`` where the vehicle file lists
    right_elevon first.
    """
    data: Any = document.data
    try:
        content: Any = read_document(document.resolve(data["vehicle"])).data
        parts = (
            (content.get("effectors", {}), EFFECTORS),
            ((content.get("propulsion") or {}).get("engines", {}), ENGINES),
        )
        places = {
            name: place for names, there in parts for name, place in zip(names, there, strict=False)
        }
    except (InputError, KeyError, TypeError, AttributeError):
        return document  # the models refuse it

    def renamed(text: str) -> str:
        group, _, rest = text.partition(".")
        effector = rest.partition(".")[0].removesuffix("_effectiveness")
        known = group not in ("failure", "control") or text in OURS or effector not in places
        return text if known else f"{group}.{places[effector]}{rest[len(effector) :]}"

    def rename(value: Any) -> Any:
        if isinstance(value, dict):
            return {rename(key): rename(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [rename(inner) for inner in value]
        return (
            DOTTED.sub(lambda found: renamed(found[0]), value) if isinstance(value, str) else value
        )

    keys = ("dispersions", "unknowns", "derived", "correlations")
    return replace(
        document, data={**data, **{key: rename(data[key]) for key in keys if key in data}}
    )


def _select_controllers(document: Document, controllers: Sequence[str]) -> Document:
    """A campaign that was checked, of these controllers alone."""
    data: Any = document.data
    key = systems_key(data)
    held = data.get(key) or {}
    for name in controllers:
        if name not in held:
            found = f"no {key.removesuffix('s')} '{name}', which was asked for"
            raise document.error((key,), found, one_of(held, name))
    chosen = {name: held[name] for name in held if name in controllers}
    requirements = list(select_requirements(data.get("requirements") or [], controllers))
    selected = {**data, key: chosen, "requirements": requirements}
    return replace(document, data=select_asked(selected, controllers))


def _check_asked(
    document: Document, model: Campaign, systems: Sequence[str], errors: list[InputError]
) -> None:
    """Check that the question compares controllers of the campaign, the first of them with others."""
    if not isinstance(model.asks, Compared):
        return
    for i, name in enumerate(model.asks.compare):
        where = ("asks", "compare", i)
        if name not in systems:
            errors.append(document.error(where, f"'{name}'", one_of(systems, name)))
        elif name in model.asks.compare[:i]:
            errors.append(document.error(where, f"'{name}' a second time", "each name once"))
        elif i == 0 and name != systems[0]:
            errors.append(
                document.error(where, f"'{name}'", f"'{systems[0]}', the campaign's first")
            )


def _make_marginals(
    document: Document, model: Campaign, parameters: Parameters, errors: list[InputError]
) -> dict[str, Marginal]:
    marginals: dict[str, Marginal] = {}
    for name, distribution in model.dispersions.items():
        where = ("dispersions", name)
        if name not in parameters.dispersible or (
            parameters[name].seed and parameters[name].of_user
        ):
            found = f"unknown parameter '{name}'" if name not in parameters else f"'{name}', a seed"
            errors.append(document.key_error(where, found, one_of(parameters.dispersible, name)))
            continue
        if distribution.probability < 1.0 and model.sampling.design in FACTORIAL:
            found = (
                f"a probability with the design '{model.sampling.design}', which sets every value"
            )
            errors.append(
                document.error(
                    (*where, "probability"), found, "a design that draws, or no probability"
                )
            )
        try:
            marginals[name] = distribution.make_marginal(parameters[name])
        except Refusal as refusal:
            errors.append(document.error((*where, *refusal.keys), refusal.found, refusal.expected))
    if model.sampling.design == "file" and model.dispersions:
        found = "dispersions beside samples from a file"
        errors.append(
            document.key_error(
                ("dispersions",), found, "one of them: the file's columns say it all"
            )
        )
    return marginals


def _make_copula(
    document: Document, model: Campaign, names: Sequence[str], errors: list[InputError]
) -> Copula:
    pairs: dict[tuple[str, str], float] = {}
    for i, entry in enumerate(model.correlations):
        for j, name in enumerate(entry.between):
            if name not in names:
                found = f"'{name}', which is not dispersed"
                errors.append(
                    document.error(("correlations", i, "between", j), found, one_of(names, name))
                )
            elif name in model.dispersions and model.dispersions[name].probability < 1.0:
                found = f"'{name}', which is drawn with a probability: most flights share its nominal value"
                errors.append(
                    document.error(
                        ("correlations", i, "between", j), found, "one that every flight draws"
                    )
                )
        pair = (min(entry.between), max(entry.between))
        if pair in pairs:
            errors.append(
                document.error(
                    ("correlations", i), f"{' and '.join(pair)} a second time", "each pair once"
                )
            )
        pairs[pair] = (
            normal_correlation(entry.rank) if entry.rank is not None else float(entry.normal or 0.0)
        )
    if pairs and model.sampling.design in (*FACTORIAL, "file"):
        found = f"correlations with the design '{model.sampling.design}'"
        errors.append(
            document.key_error(("correlations",), found, "none: this design sets every value")
        )
    if errors:
        return Copula((), np.eye(0))
    try:
        return make_copula(names, pairs)
    except np.linalg.LinAlgError:
        found = "correlations whose matrix is not positive definite"
        errors.append(
            document.error(("correlations",), found, "correlations that can hold together")
        )
        return Copula((), np.eye(0))


def _declare_metrics(
    document: Document,
    model: Campaign,
    user_channels: Sequence[tuple[str, str]],
    effectors: tuple[str, ...],
    states: tuple[tuple[str, str], ...],
    errors: list[InputError],
) -> tuple[Metric, ...]:
    """The records of the campaign's own metrics; no file of channels is run."""
    place: tuple[str, ...] = ("metrics",)
    entries, of = model.metrics, document
    if isinstance(entries, Path):
        of, entries = read_metrics_file(entries)
        place = ()
    windows = (
        read_mission(model.mission).windows()
        if any(entry.phase for entry in entries.values())
        else {}
    )
    own = declare_metrics(entries, user_channels, of, place, errors, windows, effectors, states)
    return (*effector_metrics(effectors), *own)


def _check_channels(
    document: Document,
    model: Campaign,
    own_channels: tuple[Channel, ...],
    errors: list[InputError],
) -> None:
    """That kept histories can hold what they are to: channels of effectors are those of the campaign's vehicle."""
    known = [ALL, *(channel.name for channel in (*CHANNELS, *own_channels))]
    for name in model.keep.histories.channels:
        if name not in known:
            errors.append(
                document.error(
                    ("keep", "histories", "channels"), f"channel '{name}'", one_of(known, name)
                )
            )


def _check_runs(
    document: Document,
    model: Campaign,
    names: Sequence[str],
    sample_file: SampleFile | None,
    errors: list[InputError],
) -> int:
    """Number of flights: what the file says, or what the design has."""
    design = model.sampling.design
    if design in FACTORIAL and not names:
        errors.append(
            document.error(("sampling",), f"'{design}' without dispersions", "something to vary")
        )
        return 1
    number = (
        len(sample_file.values)
        if sample_file
        else count_flights(design, len(names), model.sampling.levels)
    )
    if number is None:
        if model.runs is None:
            errors.append(
                document.error(
                    (), "no key 'runs'", f"'runs' here, as the design '{design}' takes any number"
                )
            )
        return model.runs or 1
    if number > 2**30:
        errors.append(
            document.error(("sampling",), f"a design of {number:.3g} flights", "at most 1e9")
        )
    fits = model.runs is None or (model.runs <= number if sample_file else model.runs == number)
    if not fits:
        expected = f"{'at most ' if sample_file else ''}{number}, what the design '{design}' has (or no 'runs')"
        errors.append(document.error(("runs",), f"{model.runs}", expected))
    return model.runs or number
