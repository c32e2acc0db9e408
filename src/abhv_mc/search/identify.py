"""Identification of dispersions from the records of test flights."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    MixtureMarginal,
    find_moments,
)
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import write_document
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.plant.parameters import Parameter
from abhv_mc.search.flight_records import Programme
from abhv_mc.statistics.circular import move_near
from abhv_mc.statistics.identification import estimate, find_spread

FIT_RISK = 0.01  # probability of calling a valid model invalid
_SETS = 39  # number of simulated sets with which records are aligned


@dataclass(frozen=True)
class IdentifiedParameter:
    """Estimates of one parameter in each vehicle, or in each flight, in SI units."""

    name: str
    unit: str
    values: Mapping[str, float]  # estimate by vehicle or flight
    errors: Mapping[str, float]  # standard errors
    mean: float
    mean_error: float
    spread: float | None  # standard deviation between vehicles or flights; None for only one


@dataclass(frozen=True)
class Identification:
    """Parameters identified from test flights, and how well the model fits."""

    controller: str
    flights: tuple[str, ...]
    vehicles: int
    parameters: tuple[IdentifiedParameter, ...]
    nuisances: tuple[str, ...]  # dispersions that keep their distributions
    # groups of parameters that the flights cannot separate, with the correlation of a pair
    inseparable: tuple[tuple[tuple[str, ...], float], ...]
    residuals: Mapping[str, Mapping[str, float]]  # rms by flight and channel, in noise sigmas
    noise: Mapping[str, float]  # standard deviations of the noise
    estimated_noise: tuple[str, ...]  # channels whose noise is estimated from the residuals
    offsets: Mapping[str, float]  # time by which each record's clock is ahead, s
    p_value: float  # probability of a larger chi-square if the model is valid
    fits: bool
    simulations: int  # number of simulations of each flight
    ignored: tuple[str, ...]
    dispersions: Mapping[str, Mapping[str, Any]]  # renewed dispersions, as in a campaign file


def identify(
    campaign: Path,
    files: Sequence[Path],
    parameters: Sequence[str] = (),
    controller: str | None = None,
    noise: Mapping[str, float] | None = None,
    *,
    output: Path | None = None,
    announce: Callable[[str], None] = lambda text: None,
    engine: Engine | None = None,
) -> Identification:
    """Estimate parameters from test flights, and write a campaign with renewed dispersions.

    By default, all dispersions that vary by vehicle are estimated. Other dispersions are nuisance
    parameters with the normal distributions of their mean and standard deviation; discrete
    dispersions and failures are nominal. `noise` is that of :class:`Programme`. Raise InputError if
    nothing can be identified.
    """
    programme = Programme(campaign, files, controller, noise, engine)
    names, records = programme.names, programme.records
    document = programme.experiment.document
    if output is not None and output.absolute().parent != document.path.absolute().parent:
        expected = f"a file in the folder of {document.path}, to which its paths are relative"
        raise InputError("-o", f"found '{output}'", expected)
    for name in () if programme.timed else names:
        if name not in programme.noise:
            expected = f"the standard deviation of its error: --measured {name}=SIGMA"
            raise InputError("--measured", f"the error of the metric '{name}' is unknown", expected)
    center, scale = _find_priors(programme)
    moving = np.flatnonzero(scale.any(axis=0))
    columns = [programme.columns[i] for i in moving.tolist()]
    shared = np.array([name in _shared(programme) for name in columns])
    choices = [name for name in columns if name not in programme.measured]
    by_vehicle = [name for name in choices if name in _shared(programme)]
    chosen = parameters or by_vehicle or choices
    for name in chosen:
        if name not in choices:
            raise InputError("--parameters", f"'{name}' cannot be estimated", one_of(choices, name))
    listed = np.array([name in chosen for name in columns])
    mix = _mix(programme, columns, listed)
    center, scale = center[:, np.newaxis], scale[:, np.newaxis, moving]
    with programme.open() as simulate:
        announce(f"simulating {_SETS * len(records)} flights to align the records")
        tests = programme.align(programme.simulate_sets(simulate, programme.draw(_SETS)))
        periods = [programme.experiment.periods.get(name, 0.0) for name in names]

        def compute(points: Floats) -> Floats:
            rows = np.tile(programme.nominal, (*points.shape[:2], 1))
            rows[..., : center.shape[2]] = center
            rows[..., moving] += scale * (points @ mix.T)
            outputs = simulate(rows)
            for i, period in enumerate(periods):
                if period:
                    near = tests[:, np.newaxis, :, i]
                    outputs[..., i] = move_near(outputs[..., i], near, period)
            return outputs.reshape(*points.shape[:2], -1)

        result = estimate(
            compute,
            tests.reshape(len(tests), -1),
            np.tile([programme.noise.get(name, np.nan) for name in names], tests.shape[1]),
            np.tile(np.arange(len(names)), tests.shape[1]),
            np.array(programme.vehicles),
            shared=shared,
            listed=listed,
        )
    found = []
    for i in np.flatnonzero(result.listed).tolist():
        flights = sorted(set(programme.vehicles)) if shared[i] else range(len(records))
        labels = [records[k].vehicle if shared[i] else records[k].name for k in flights]
        values = center[:, 0, moving[i]] + scale[:, 0, i] * result.values[:, i]
        errors = scale[:, 0, i] * result.errors[:, i]
        own = values[list(flights)], errors[list(flights)]
        mean, error, spread = find_spread(*own)
        found.append(
            IdentifiedParameter(
                name=columns[i],
                unit=programme.experiment.parameters[columns[i]].unit,
                values=dict(zip(labels, own[0].tolist(), strict=True)),
                errors=dict(zip(labels, own[1].tolist(), strict=True)),
                mean=mean,
                mean_error=error,
                spread=spread if len(labels) > 1 else None,
            )
        )
    residuals = result.residuals.reshape(tests.shape)
    sigma = result.sigma[: len(names)].tolist()
    answer = Identification(
        controller=programme.controller,
        flights=tuple(record.name for record in records),
        vehicles=len(set(programme.vehicles)),
        parameters=tuple(found),
        nuisances=tuple(np.array(columns)[~result.listed].tolist()),
        inseparable=tuple(
            (tuple(columns[i] for i in group), correlation)
            for group, correlation in result.inseparable
        ),
        residuals={
            record.name: {
                name: float(np.sqrt(np.mean(own[np.isfinite(own)] ** 2)))
                for name, own in zip(names, flight.T, strict=True)
                if np.isfinite(own).any()
            }
            for record, flight in zip(records, residuals, strict=True)
        },
        noise=dict(zip(names, sigma, strict=True)),
        estimated_noise=tuple(name for name in names if name not in programme.noise),
        offsets={record.name: record.offset for record in records},
        p_value=result.p_value,
        fits=result.converged and result.p_value >= FIT_RISK,
        simulations=result.simulations,
        ignored=programme.ignored,
        dispersions={
            parameter.name: _renew(
                programme.experiment.dispersions[parameter.name],
                parameter,
                programme.experiment.parameters[parameter.name],
            )
            for parameter in found
        },
    )
    if output is not None:
        entries = document.entries
        dispersions = {**entries["dispersions"], **answer.dispersions}
        write_document(output, {**entries, "dispersions": dispersions}, _comment(answer, document))
    return answer


def _shared(programme: Programme) -> list[str]:
    """Return the names of unmeasured dispersions that all flights of a vehicle share."""
    pairs = zip(programme.space.names, programme.by_vehicle, strict=True)
    return [name for name, is_shared in pairs if is_shared and name not in programme.measured]


def _find_priors(programme: Programme) -> tuple[Floats, Floats]:
    """Return means and standard deviations [flight, column], given measured parameters."""
    flights = len(programme.records)
    center = np.tile(programme.nominal[: len(programme.columns)], (flights, 1))
    scale = np.zeros_like(center)
    for i, marginal in enumerate(programme.space.marginals):
        if isinstance(marginal, ContinuousMarginal | MixtureMarginal):
            center[:, i], scale[:, i] = find_moments(marginal)
    for k, record in enumerate(programme.records):
        for name, (value, error) in record.inputs.items():
            column = programme.columns.index(name)
            prior = scale[k, column] or np.inf
            weight = 1.0 / (1.0 + (error / prior) ** 2)
            center[k, column] += weight * (value - center[k, column])
            scale[k, column] = error * weight**0.5
    return center, scale


def _mix(programme: Programme, columns: Sequence[str], listed: Floats) -> Floats:
    """Return the matrix that correlates nuisance parameters [column, column]."""
    names = programme.space.names
    own = [
        i
        for i, name in enumerate(columns)
        if name in names and not listed[i] and name not in programme.measured
    ]
    index = [names.index(columns[i]) for i in own]
    correlations = programme.space.copula.correlations(len(names))[np.ix_(index, index)]
    mix = np.eye(len(columns))
    mix[np.ix_(own, own)] = np.linalg.cholesky(correlations)
    return mix


def _renew(
    entry: Mapping[str, Any], identified: IdentifiedParameter, parameter: Parameter
) -> dict[str, Any]:
    """Return the normal distribution of a parameter in another vehicle of the fleet."""
    sigma = float(np.hypot(identified.spread or 0.0, identified.mean_error))
    is_number = parameter.of_user or parameter.unit == "-"
    texts = {
        key: float(f"{value:.6g}") if is_number else f"{value:.6g} {parameter.unit}"
        for key, value in (("mean", identified.mean), ("sigma", sigma))
    }
    varies = {key: value for key, value in entry.items() if key == "varies_by"}
    return {"distribution": "normal", **texts, **varies}


def _comment(answer: Identification, source: object) -> str:
    """Return the comment on the source of the renewed dispersions."""
    lines = [
        f"Dispersions identified from {', '.join(answer.flights)} with {source}:",
        *(
            f"{entry.name}: mean {entry.mean:.4g}, standard error {entry.mean_error:.2g}, "
            + ("one sample" if entry.spread is None else f"spread {entry.spread:.2g}")
            for entry in answer.parameters
        ),
        *(f"not separable: {', '.join(group)}" for group, _ in answer.inseparable),
        f"chi-square: p = {answer.p_value:.2g}" + ("" if answer.fits else ", does not fit"),
    ]
    return "\n".join(lines)
