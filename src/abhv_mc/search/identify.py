"""Identification of dispersions from the records of test flights."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import write_document
from abhv_mc.io.messages import InputError, check_names
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

    parameters: tuple[IdentifiedParameter, ...]
    nuisances: tuple[str, ...]  # dispersions that keep their distributions
    # groups of parameters that the flights cannot separate, with the correlation of a pair
    inseparable: tuple[tuple[tuple[str, ...], float], ...]
    residuals: Mapping[str, Mapping[str, float]]  # rms by flight and channel, in noise sigmas
    noise: Mapping[str, float]  # standard deviations of the noise, declared or estimated
    offsets: Mapping[str, float]  # time by which each record's clock is ahead, s
    p_value: float  # probability of a larger chi-square if the model is valid
    fits: bool  # whether the estimation converged and the model is not rejected
    converged: bool
    simulations: int  # number of simulations of each flight
    dispersions: Mapping[str, Mapping[str, Any]]  # renewed dispersions, as in a campaign file

    def texts(self) -> Iterator[tuple[str, str]]:
        """Yield the labels and texts of the results."""
        fit = f"p = {self.p_value:.2g}, rejected below {FIT_RISK:g}"
        if self.converged:
            yield "Model fits" if self.fits else "Model does not fit", fit
        else:
            yield "Not converged", "the estimates are not the best fit; the fit is not judged"
        for entry in self.parameters:
            spread = "unknown" if entry.spread is None else f"{entry.spread:.3g}"
            mean = f"{entry.mean:.4g} (standard error {entry.mean_error:.2g})"
            yield f"{entry.name} ({entry.unit})", f"{mean}, spread {spread}"
            for unit, value in entry.values.items():
                interval = f"{value:.4g} +- {1.96 * entry.errors[unit]:.2g} (95 %)"
                yield f"{entry.name}, {unit}", interval
        for group, correlation in self.inseparable:
            yield "Not separable", f"{', '.join(group)} (correlation {correlation:.2f})"
        yield "Nuisances", ", ".join(self.nuisances)
        yield "Noise (sigma)", _list(self.noise)
        for flight, residuals in self.residuals.items():
            offset = f"clock offset {self.offsets[flight]:.3g} s"
            yield flight, f"residuals (rms, sigmas) {_list(residuals)}, {offset}"
        yield "Simulations", f"{self.simulations} of each flight"


def _list(numbers: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in numbers.items())


def identify(
    campaign: Path,
    files: Sequence[Path],
    parameters: Sequence[str] = (),
    controller: str | None = None,
    noise: Mapping[str, float] | None = None,
    *,
    output: Path | None = None,
    engine: Engine | None = None,
) -> Identification:
    """Estimate parameters from test flights, and write a campaign with renewed dispersions.

    By default, all dispersions that vary by vehicle are estimated. Other dispersions are nuisance
    parameters with the normal distributions of their mean and standard deviation; discrete
    dispersions and failures are nominal. `noise` is that of :class:`Programme`. Raise InputError if
    nothing can be identified.
    """
    programme = Programme(campaign, files, controller, noise, engine)
    names, records, experiment = programme.names, programme.records, programme.experiment
    document = experiment.document
    source = document.path.absolute()
    if output is not None and (
        source == output.absolute() or output.absolute().parent != source.parent
    ):
        expected = f"another file in the folder of {source}, to which its paths are relative"
        raise InputError("-o", f"found '{output}'", expected)
    for name in () if programme.is_history else names:
        if name not in programme.noise:
            problem, expected = f"the error of '{name}' is unknown", f"--measured {name}=SIGMA"
            raise InputError("--measured", problem, expected)
    center, scale = (prior[:, None] for prior in programme.priors)
    moving = np.flatnonzero(scale.any(axis=(0, 1)))
    columns = [programme.columns[i] for i in moving]
    shared = np.isin(columns, programme.by_vehicle)
    choices = [name for name in columns if name not in programme.measured]
    chosen = parameters or [name for name in choices if name in programme.by_vehicle] or choices
    check_names("--parameters", chosen, choices, "parameter to estimate")
    listed = np.isin(columns, chosen)
    own = np.flatnonzero(np.isin(columns, choices) & ~listed)
    correlations = programme.space.copula.correlations(len(programme.columns))
    mix = np.eye(len(columns))
    mix[np.ix_(own, own)] = np.linalg.cholesky(correlations[np.ix_(moving[own], moving[own])])
    with programme.open() as simulate:
        tests = programme.align(simulate(programme.draw(_SETS), True))

        def compute(points: Floats) -> Floats:
            rows = np.tile(center, (1, points.shape[1], 1))
            rows[..., moving] += scale[..., moving] * (points @ mix.T)
            outputs = simulate(rows)
            for i, name in enumerate(names):
                if period := experiment.periods.get(name):
                    outputs[..., i] = move_near(outputs[..., i], tests[:, None, :, i], period)
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
    identified, renewed = [], dict(document.entries["dispersions"])
    for i in np.flatnonzero(result.listed).tolist():
        rows = np.unique(programme.vehicles) if shared[i] else np.arange(len(records))
        labels = [records[k].vehicle if shared[i] else records[k].name for k in rows]
        spreads = scale[rows, 0, moving[i]]
        values = center[rows, 0, moving[i]] + spreads * result.points[rows, i]
        errors = spreads * result.errors[rows, i]
        mean, error, spread = find_spread(values, errors)
        parameter = experiment.parameters[columns[i]]
        identified.append(
            IdentifiedParameter(
                name=columns[i],
                unit=parameter.unit,
                values=dict(zip(labels, values.tolist(), strict=True)),
                errors=dict(zip(labels, errors.tolist(), strict=True)),
                mean=mean,
                mean_error=error,
                spread=spread if len(labels) > 1 else None,
            )
        )
        numbers = {"mean": mean, "sigma": float(np.hypot(spread, error))}
        renewed[columns[i]] = {
            "distribution": "normal",
            **{key: f"{value:.6g}{parameter.unit_suffix}" for key, value in numbers.items()},
            "varies_by": "vehicle" if shared[i] else "flight",
        }
    residuals = result.residuals.reshape(tests.shape)
    counts = np.maximum(np.isfinite(residuals).sum(axis=1), 1)
    residuals = np.sqrt(np.nansum(residuals**2, axis=1) / counts)
    answer = Identification(
        parameters=tuple(identified),
        nuisances=tuple(np.array(columns)[~result.listed].tolist()),
        inseparable=tuple(
            (tuple(columns[i] for i in group), correlation)
            for group, correlation in result.inseparable
        ),
        residuals={
            record.name: dict(zip(names, row.tolist(), strict=True))
            for record, row in zip(records, residuals, strict=True)
        },
        noise=dict(zip(names, result.sigma.tolist(), strict=False)),
        offsets={record.name: record.offset for record in records},
        p_value=result.p_value,
        fits=result.converged and result.p_value >= FIT_RISK,
        converged=result.converged,
        simulations=result.simulations,
        dispersions=renewed,
    )
    if output is not None:
        lines = (f"{label}: {text}" for label, text in answer.texts())
        comment = "\n".join(["Dispersions identified from test flights", *lines])
        write_document(output, {**document.entries, "dispersions": renewed}, comment)
    return answer
