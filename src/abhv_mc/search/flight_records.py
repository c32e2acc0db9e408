"""Records of test flights: reading, alignment in time, and simulation under the same conditions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    MixtureMarginal,
    clip_probabilities,
    find_moments,
)
from abhv_mc.execution.executor import make_ready, open_executor, open_threads, simulate
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.interfaces import Engine
from abhv_mc.io.foreign_table import ForeignTable, NumberTable, read_foreign_table
from abhv_mc.io.messages import check_names
from abhv_mc.io.units import parse_in_any_unit, parse_unit
from abhv_mc.search.search_flights import read_searched
from abhv_mc.search.space import make_space
from abhv_mc.statistics.circular import align_flights, unwrap
from abhv_mc.statistics.placement import find_offset

TIME, VEHICLE, HISTORY, ERROR = "time", "vehicle", "history", "_error"
_MOST_TIMES = 500  # maximum number of times at which histories are compared
_PIECE = 64  # number of flights that are simulated in one call
# Dispersions that vary from flight to flight by default; all others vary between vehicles.
_BY_FLIGHT = ("atmosphere.", "wind.", "initial.", "failure.")


@dataclass(frozen=True)
class FlightRecord:
    """Measurements of one test flight."""

    name: str
    vehicle: str
    inputs: Mapping[str, tuple[float, float]]  # measured parameters with standard errors
    values: Mapping[str, Floats]  # channels over "time", or metrics with one value each
    table: ForeignTable  # source of the values, for error messages
    offset: float = 0.0  # time by which the record's clock is ahead of the simulation, s


def sample(
    record: Mapping[str, Floats],
    names: Sequence[str],
    times: Floats,
    periods: Mapping[str, float],
    offset: float = 0.0,
) -> Floats:
    """Interpolate channels, or metrics without "time", at `times` [time, name]; NaN in gaps.

    The clock of the record is ahead by `offset`.
    """
    clock = record.get(TIME, times) - offset
    curves = (unwrap(record.get(name, np.nan * clock), periods.get(name, 0.0)) for name in names)
    return np.column_stack([np.interp(times, clock, curve, np.nan, np.nan) for curve in curves])


def read_records(
    files: Sequence[Path], experiment: Experiment
) -> tuple[list[FlightRecord], tuple[str, ...]]:
    """Return the test flights in files, and the headings of columns that are not used.

    A file with the column `time` is the history of one flight. Any other file has a row for each
    flight, with metrics or with the file of a history (`history`). Columns named like parameters
    are measured inputs, with their standard errors in columns with the suffix `_error`; flights
    with the same text in the column `vehicle` share a vehicle. Raise InputError if a file is
    invalid or if flights cannot be compared.
    """
    parameters = {record.name: record.unit for record in experiment.parameters.records}
    outputs = (*experiment.metrics.values(), *experiment.channels)
    units = {TIME: "s", **{record.name: record.unit for record in outputs}}
    column_units = (
        parameters | {f"{name}{ERROR}": unit for name, unit in parameters.items()} | units
    )
    ignored: list[str] = []

    def read(path: Path) -> Iterator[FlightRecord]:
        table = read_foreign_table(path)
        columns = table.find([*column_units, VEHICLE, HISTORY])
        used = [column.position for column in columns.values()]
        ignored.extend(head for i, head in enumerate(table.heads) if i not in used)
        vehicles, histories = (
            table.words(columns.pop(name).position) if name in columns else [""] * len(table)
            for name in (VEHICLE, HISTORY)
        )
        factors = [table.factor(column, column_units[name]) for name, column in columns.items()]
        positions = [column.position for column in columns.values()]
        values = table.numbers(positions, finite=False) * factors
        is_history = TIME in columns
        if is_history:
            table.numbers([columns[TIME].position])  # Times must be finite.
            NumberTable(table, columns, values).check_rising(TIME, "s")
        for i, rows in enumerate([values] if is_history else values[:, None]):
            own = dict(zip(columns, rows.T, strict=True))
            inputs = {
                name: (float(np.nanmean(own[name])), float(np.nanmax(own.get(name + ERROR, 0.0))))
                for name in parameters
                if np.isfinite(own.get(name, np.nan)).any()
            }
            name = path.name if is_history else f"{path.name}:{table.lines[i]}"
            measured = {key: value for key, value in own.items() if key in units}
            record = FlightRecord(name, name, {}, measured, table)
            if histories[i]:
                (record,) = read(path.parent / histories[i])
            yield replace(
                record, vehicle=vehicles[i] or record.vehicle, inputs={**record.inputs, **inputs}
            )

    records = [record for file in files for record in read(file)]
    is_history = TIME in records[0].values
    name = next(iter(experiment.channels if is_history else experiment.metrics.values())).name
    for record in records:
        if (TIME in record.values) != is_history or not set(record.values) - {TIME}:
            expected = f"columns such as '{name}'" + f" and '{TIME}'" * is_history
            raise record.table.error(None, None, "no column can be compared", expected)
    return records, tuple(dict.fromkeys(ignored))


class Programme:
    """Test flights, and the campaign that simulates flights under the same conditions."""

    def __init__(
        self,
        campaign: Path,
        files: Sequence[Path],
        controller: str | None = None,
        noise: Mapping[str, float] | None = None,
        engine: Engine | None = None,
    ) -> None:
        """Read a campaign (file, or results folder) and test flights.

        `noise` maps metrics and channels to standard deviations of measurement errors, in addition
        to those in the campaign file.
        """
        if campaign.is_dir():
            experiment = replace(read_folder_campaign(CampaignFolder(campaign)), engine=engine)
            controller = experiment.choose_controller(controller)
        else:
            experiment, controller = read_searched(campaign, controller, None, engine)
        self.controller = controller
        self.records, self.ignored = read_records(files, experiment)
        self.is_history = TIME in self.records[0].values
        self.names = tuple(
            dict.fromkeys(name for record in self.records for name in record.values if name != TIME)
        )
        clock = max((record.values.get(TIME, np.zeros(1)) for record in self.records), key=np.ptp)
        self.times = clock[:: -(-clock.size // _MOST_TIMES)]
        outputs = {own.name: own for own in (*experiment.metrics.values(), *experiment.channels)}
        self.units = {name: parse_unit(outputs[name].unit)[0] for name in self.names}
        check_names("--measured", noise or (), self.names, "channel or metric")
        self.noise = {
            name: parse_in_any_unit(value, outputs[name].unit)
            for name, value in experiment.model.measured.items()
            if name in self.names
        } | dict(noise or {})
        self.space = make_space(experiment)
        measured = dict.fromkeys(name for record in self.records for name in record.inputs)
        added = (name for name in measured if name not in self.space.names)
        self.measured, self.columns = tuple(measured), (*self.space.columns, *added)
        self.experiment = replace(experiment, columns=self.columns)
        self.nominal = experiment.parameters.nominal_of(self.columns)
        simulator = experiment.simulator
        plans = simulator.make_plans([controller])
        fitted = simulator.fit_plans(plans, self.columns, self.nominal[None])
        self.ready = make_ready(self.experiment, fitted)

    @cached_property
    def vehicles(self) -> list[int]:
        """First flight of each flight's vehicle."""
        names = [record.vehicle for record in self.records]
        return [names.index(name) for name in names]

    @cached_property
    def by_vehicle(self) -> tuple[str, ...]:
        """Names of the dispersions that all flights of a vehicle share.

        Dispersions that were measured, or are correlated with one that varies by flight, vary by
        flight.
        """
        entries, names = self.experiment.dispersions, self.space.names
        is_shared = [
            not (name.startswith(_BY_FLIGHT) or name.endswith("_noise") or name in self.measured)
            if (stated := entries[name].get("varies_by")) is None
            else stated == VEHICLE
            for name in names
        ]
        correlated = self.space.copula.correlations(len(names)) != 0.0
        by_flight = correlated[:, ~np.array(is_shared)].any(axis=1)
        return tuple(np.array(names)[~by_flight].tolist())

    @cached_property
    def priors(self) -> tuple[Floats, Floats]:
        """Means and standard deviations [flight, column], given measured parameters.

        Standard deviations of discrete parameters and of failures are 0.
        """
        center = np.tile(self.nominal, (len(self.records), 1))
        scale = np.zeros_like(center)
        for i, marginal in enumerate(self.space.marginals):
            if isinstance(marginal, ContinuousMarginal | MixtureMarginal):
                center[:, i], scale[:, i] = find_moments(marginal)
        for k, record in enumerate(self.records):
            for name, (value, error) in record.inputs.items():
                i = self.columns.index(name)
                weight = 1.0 / (1.0 + (error / (scale[k, i] or np.inf)) ** 2)
                center[k, i] += weight * (value - center[k, i])
                scale[k, i] = error * weight**0.5
        return center, scale

    def draw(self, sets: int) -> Floats:
        """Draw inputs [set, flight, column] of simulated sets of flights.

        Flights are grouped by vehicles like the test flights. Parameters that were measured in a
        flight follow a normal distribution given the measurement, and other parameters follow their
        distributions given correlated measured parameters.
        """
        from scipy.special import ndtr, ndtri

        space, count, (center, scale) = self.space, len(self.space.names), self.priors
        generator = np.random.default_rng(self.experiment.seed)
        points = generator.standard_normal((sets, len(self.records), count))
        shared = np.isin(space.names, self.by_vehicle)
        points[:, :, shared] = points[:, self.vehicles][:, :, shared]
        correlations = space.copula.correlations(count)
        points = points @ np.linalg.cholesky(correlations).T
        rows = center + scale * generator.standard_normal((*points.shape[:2], len(self.columns)))
        for k, record in enumerate(self.records):
            own = [i for i, name in enumerate(space.names) if name in record.inputs]
            shares = np.array([space.marginals[i].cdf(rows[:, k, i]) for i in own])
            targets = ndtri(clip_probabilities(shares)).reshape(len(own), sets).T
            gain = np.linalg.solve(correlations[np.ix_(own, own)], correlations[own])
            points[:, k] += (targets - points[:, k, own]) @ gain
            for i in {*range(count)} - {*own}:
                probabilities = clip_probabilities(ndtr(points[:, k, i]))
                rows[:, k, i] = space.marginals[i].ppf(probabilities)
        flat = rows.reshape(-1, len(self.columns))
        flat[:, count : len(space.columns)] = space.complete(flat[:, :0], self.experiment.seed, 0)
        return rows

    @contextmanager
    def open(self) -> Iterator[Callable[..., Floats]]:
        """Yield a function that simulates rows [..., column]; the result is [..., time, name].

        Errors of the campaign's sensors are included, and noise if the second argument is True.
        """
        experiment, simulator = self.experiment, self.experiment.simulator
        outputs = experiment.channels if self.is_history else experiment.measured
        index = [[output.name for output in outputs].index(name) for name in self.names]
        plan = self.ready.systems[self.controller].plan
        every = simulator.find_stride(plan, "histories") if self.is_history else None
        generator = np.random.default_rng(experiment.seed + 1)
        with open_executor(simulator.engine, experiment.model.execution, None) as executor:

            def compute(rows: Floats) -> Floats:
                block = simulate(self.ready, self.controller, rows, every, executor.fly)
                if every is None:
                    return block.metrics[:, None, index]
                columns = TIME, *self.names
                histories = (
                    dict(zip(columns, (block.times, *history.T[index]), strict=True))
                    for history in block.history
                )
                return np.array([self._sample(history) for history in histories])

            def run(rows: Floats, has_noise: bool = False) -> Floats:
                flat = rows.reshape(-1, rows.shape[-1])
                pieces = np.split(flat, range(_PIECE, len(flat), _PIECE))
                with open_threads(executor.workers) as threads:
                    sampled = np.concatenate(list(threads.map(compute, pieces)))
                for i, name in enumerate(self.names):
                    sensor = self.sensors.get(name, {})
                    errors = {kind: flat[:, [column]] for kind, column in sensor.items()}
                    sampled[:, :, i] *= errors.get("scale", 1.0)
                    sampled[:, :, i] += errors.get("bias", 0.0) / self.units[name]
                    sigma = errors.get("noise", 0.0) / self.units[name] + self.noise.get(name, 0.0)
                    if has_noise:
                        sampled[:, :, i] += sigma * generator.standard_normal(sampled.shape[:2])
                return sampled.reshape(*rows.shape[:-1], *sampled.shape[1:])

            yield run

    @cached_property
    def sensors(self) -> dict[str, dict[str, int]]:
        """Columns of the dispersed scale, bias and noise of the sensor of each channel.

        Channels with declared noise, and metrics, are not included.
        """
        sensors = {}
        for name in self.names if self.is_history else ():
            stems = name, name.rpartition("_")[0].removesuffix(ERROR)
            sensors[name] = {
                kind: self.columns.index(column)
                for kind in ("scale", "bias", "noise")
                for stem in stems
                if (column := f"sensor.{stem}_{kind}") in self.columns
            }
        return {name: own for name, own in sensors.items() if own and name not in self.noise}

    def _sample(self, record: Mapping[str, Floats], offset: float = 0.0) -> Floats:
        return sample(record, self.names, self.times, self.experiment.periods, offset)

    def align(self, simulated: Floats) -> Floats:
        """Align records with simulated flights [set, flight, time, name]; return the records.

        The result [flight, time, name] is NaN in gaps. Angles of both are near the mean of the
        simulated flights. A record is shifted in time if this reduces its deviation by more than
        that of any simulated flight.
        """
        tests = []
        for k, record in enumerate(self.records):
            sets = simulated[:, k]
            for span in (0.1, 0.02, 0.0):
                test = self._sample(record.values, record.offset)
                for i, period in enumerate(map(self.experiment.periods.get, self.names)):
                    pool = np.vstack([sets[:, :, i], test[None, :, i]])
                    pool = align_flights(pool, period or 0.0, len(sets))
                    sets[:, :, i], test[:, i] = pool[:-1], pool[-1]
                if not np.isfinite(test + sets).any():
                    expected = "times that overlap with those of the simulated flights"
                    raise record.table.error(
                        0, 0, "no value can be compared with the simulated flights", expected
                    )
                if not (span and self.is_history):
                    break
                steps, is_offset = find_offset(sets, test, span, len(self.space.names))
                if not (is_offset or record.offset):
                    break
                offset = record.offset + steps * float(np.mean(np.diff(self.times)))
                record = self.records[k] = replace(record, offset=offset)  # noqa: PLW2901
            tests.append(test)
        return np.array(tests)
