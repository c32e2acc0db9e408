"""Records of test flights: reading, alignment in time, and simulation under the same conditions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.samples import draw_seeds
from abhv_mc.execution.executor import FlightRunner, open_executor, open_threads
from abhv_mc.execution.simulation import make_ready, simulate
from abhv_mc.flight.plan import Recording
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.interfaces import Engine
from abhv_mc.io.foreign_table import NumberTable, read_foreign_table
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.io.units import parse_in_any_unit, parse_unit
from abhv_mc.search.search_flights import read_searched
from abhv_mc.search.space import Space, make_space
from abhv_mc.statistics.circular import align_flights, unwrap
from abhv_mc.statistics.time_offsets import find_offset

TIME, VEHICLE, HISTORY, ERROR = "time", "vehicle", "history", "_error"
_MOST_TIMES = 500  # maximum number of times at which histories are compared
_PIECE = 64  # number of flights that are simulated in one call
_QUANTILES = 2001  # number of values of a measured parameter with an error
# Dispersions that vary from flight to flight by default; all others vary between vehicles.
_BY_FLIGHT = ("atmosphere.", "wind.", "initial.", "failure.")


@dataclass(frozen=True)
class FlightRecord:
    """Measurements of one test flight."""

    name: str
    vehicle: str
    inputs: Mapping[str, tuple[float, float]]  # measured parameters with standard errors
    values: Mapping[str, Floats]  # channels over "time", or metrics with one value each
    table: NumberTable  # source of the values, for error messages
    offset: float = 0.0  # time by which the record's clock is ahead of the simulation, s

    def sample(
        self, channels: Sequence[str], times: Floats, periods: Mapping[str, float]
    ) -> Floats:
        """Interpolate channels at simulation times [time, channel], with NaN in gaps."""
        curves, clock = [], self.values[TIME] - self.offset
        for channel in channels:
            values = self.values.get(channel, np.full(clock.size, np.nan))
            gaps = ~np.isfinite(values)
            curve = np.full(times.size, np.nan)
            if not gaps.all():
                known = unwrap(values[~gaps], periods[channel])
                curve = np.interp(times, clock[~gaps], known, np.nan, np.nan)
                curve[np.interp(times, clock, gaps.astype(float)) > 0.0] = np.nan
            curves.append(curve)
        return np.column_stack(curves)


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
    ignored: list[str] = []

    def read(path: Path) -> Iterator[FlightRecord]:
        table = read_foreign_table(path)
        errors = {f"{name}{ERROR}": unit for name, unit in parameters.items()}
        known = parameters | errors | units
        columns = table.find([*known, VEHICLE, HISTORY])
        used = {column.position for column in columns.values()}
        ignored.extend(head for i, head in enumerate(table.heads) if i not in used)
        texts = {
            name: table.words(columns.pop(name).position)
            for name in (VEHICLE, HISTORY)
            if name in columns
        }
        if TIME in columns:
            table.numbers([columns[TIME].position])  # Times must be finite.
        factors = [table.factor(column, known[name]) for name, column in columns.items()]
        positions = [column.position for column in columns.values()]
        values = table.numbers(positions, finite=False) * factors
        numbers = NumberTable(table, columns, values)
        timed = TIME in columns
        if timed:
            numbers.check_rising(TIME, "s")
        for i, rows in enumerate([values] if timed else values[:, np.newaxis]):
            own = dict(zip(columns, rows.T, strict=True))
            inputs = {
                name: (float(np.nanmean(own[name])), float(np.nanmax(own.get(name + ERROR, 0.0))))
                for name in parameters
                if name in own and np.isfinite(own[name]).any()
            }
            name = path.name if timed else f"{path.name}:{table.lines[i]}"
            vehicle = texts[VEHICLE][i] if VEHICLE in texts else ""
            measured = {key: value for key, value in own.items() if key in units}
            if HISTORY in texts and texts[HISTORY][i]:
                (record,) = read(path.parent / texts[HISTORY][i])
                yield replace(
                    record,
                    vehicle=vehicle or record.vehicle,
                    inputs={**record.inputs, **inputs},
                )
            else:
                yield FlightRecord(name, vehicle or name, inputs, measured, numbers)

    records = [record for file in files for record in read(file)]
    timed = [TIME in record.values for record in records]
    for record, is_timed in zip(records, timed, strict=True):
        if is_timed != timed[0]:
            table, problem = record.table.table, f"the column '{TIME}' is missing"
            raise table.error(None, None, problem, "histories only, or metrics only")
        if not set(record.values) - {TIME}:
            name = next(iter(experiment.channels if is_timed else experiment.metrics.values())).name
            table, expected = record.table.table, f"columns that the campaign computes: '{name}'"
            raise table.error(None, None, "no column can be compared", expected)
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
        self.timed = TIME in self.records[0].values
        names = [name for record in self.records for name in record.values if name != TIME]
        self.names = tuple(dict.fromkeys(names))
        longest = max(self.records, key=lambda record: np.ptp(record.values.get(TIME, np.zeros(1))))
        clock = longest.values.get(TIME, np.zeros(1))
        self.times = clock[:: -(-clock.size // _MOST_TIMES)]
        outputs = (*experiment.metrics.values(), *experiment.channels)
        self.units = {record.name: record.unit for record in outputs}
        declared = experiment.model.measured.items()
        sigmas = {name: parse_in_any_unit(value, self.units[name]) for name, value in declared}
        for name in noise or {}:
            if name not in self.names:
                problem = f"unknown channel or metric '{name}'"
                raise InputError("--measured", problem, one_of(self.names, name))
        sigmas |= noise or {}
        self.noise = {name: sigmas[name] for name in self.names if name in sigmas}
        self.space: Space = make_space(experiment)
        measured = dict.fromkeys(name for record in self.records for name in record.inputs)
        added = tuple(name for name in measured if name not in self.space.names)
        self.measured, self.columns = tuple(measured), (*self.space.names, *added)
        columns = (*self.columns, *self.space.seeds)
        simulator = experiment.simulator
        self.experiment = replace(experiment, columns=columns)
        plans = simulator.make_plans([controller])
        rows = self.nominal[np.newaxis]
        self.ready = make_ready(self.experiment, simulator.fit_plans(plans, columns, rows))

    @cached_property
    def nominal(self) -> Floats:
        """Nominal values of the simulated columns."""
        return self.experiment.parameters.nominal_of(self.experiment.inputs)

    @cached_property
    def vehicles(self) -> list[int]:
        """First flight of each flight's vehicle."""
        names = [record.vehicle for record in self.records]
        return [names.index(name) for name in names]

    @cached_property
    def by_vehicle(self) -> Mask:
        """Mask of the dispersions that all flights of a vehicle share.

        Raise InputError if correlated dispersions vary differently.
        """
        entries, names = self.experiment.dispersions, self.space.names
        shared = np.array(
            [
                entries.get(name, {}).get("varies_by", "")
                or ("flight" if name.startswith(_BY_FLIGHT) or name.endswith("_noise") else VEHICLE)
                for name in names
            ]
        )
        mixed = self.space.copula.correlations(len(names)) * (shared[:, np.newaxis] != shared)
        for i, j in np.argwhere(mixed)[:1]:
            problem = f"'{names[i]}' varies by {shared[i]}, '{names[j]}' by {shared[j]}"
            expected = "the same 'varies_by' for correlated dispersions"
            raise self.experiment.document.error(("dispersions", names[i]), problem, expected)
        return np.array(shared == VEHICLE)

    def draw(self, sets: int) -> Floats:
        """Draw inputs [set, flight, column] of simulated sets of flights.

        Flights are grouped by vehicles like the test flights. Parameters that were measured in a
        flight follow their distribution given the measurement, and other parameters follow theirs
        given correlated measured parameters.
        """
        from scipy.special import ndtr, ndtri

        space, flights = self.space, len(self.records)
        generator = np.random.default_rng(self.experiment.seed)
        points = generator.standard_normal((sets, flights, len(space.names)))
        points[:, :, self.by_vehicle] = points[:, self.vehicles][:, :, self.by_vehicle]
        correlations = space.copula.correlations(len(space.names))
        points = points @ np.linalg.cholesky(correlations).T
        rows = np.tile(self.nominal, (sets, flights, 1))
        exact = {}
        for k, record in enumerate(self.records):
            known = {}
            for name, (value, error) in record.inputs.items():
                column = self.columns.index(name)
                values = value + error * generator.standard_normal(sets)
                if name in space.names:
                    marginal = space.marginals[column]
                    if error:
                        grid = marginal.ppf((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
                        weights = -0.5 * ((grid - value) / error) ** 2
                        weights = np.exp(weights - weights.max())
                        values = generator.choice(grid, sets, p=weights / weights.sum())
                    probability = np.clip(marginal.cdf(values), 2.0**-53, 1.0 - 2.0**-53)
                    known[column] = ndtri(probability)
                exact[k, column] = values
            if known:
                own, targets = list(known), np.column_stack([*known.values()])
                gain = np.linalg.solve(correlations[np.ix_(own, own)], correlations[own])
                points[:, k] += (targets - points[:, k, own]) @ gain
        for i, marginal in enumerate(space.marginals):
            probability = np.clip(ndtr(points[:, :, i]), 2.0**-53, 1.0 - 2.0**-53)
            rows[:, :, i] = marginal.ppf(probability)
        for (k, column), values in exact.items():
            rows[:, k, column] = values
        for i, name in enumerate(space.seeds, len(self.columns)):
            drawn = draw_seeds(name, self.experiment.seed, 0, sets * flights)
            rows[:, :, i] = drawn.reshape(sets, flights)
        return rows

    @contextmanager
    def open(self) -> Iterator[Callable[[Floats], Floats]]:
        """Yield a function that returns simulated outputs [..., time, name] of rows [..., column].

        Errors of the campaign's sensors are included, except their noise.
        """
        simulator = self.experiment.simulator
        plan = self.ready.systems[self.controller].plan
        channels = [channel.name for channel in self.experiment.channels]
        metrics = [metric.name for metric in self.experiment.measured]
        index = [(channels if self.timed else metrics).index(name) for name in self.names]
        recording: Recording | int | None = None
        if self.timed:
            recording = simulator.find_stride(plan, "histories")
            if simulator.capabilities.has_mission:
                recording, index = Recording(recording, tuple(index)), [*range(len(index))]
        executor: FlightRunner

        def compute(rows: Floats) -> Floats:
            block = simulate(self.ready, self.controller, rows, recording, executor.fly)
            if not self.timed:
                return block.metrics[:, np.newaxis, index]
            outputs = np.empty((len(rows), self.times.size, len(index)))
            for k, history in enumerate(block.history):
                for i, column in enumerate(index):
                    curve = unwrap(history[:, column], self.experiment.periods[self.names[i]])
                    outputs[k, :, i] = np.interp(self.times, block.times, curve, np.nan, np.nan)
            return outputs

        def run(rows: Floats) -> Floats:
            flat = rows.reshape(-1, rows.shape[-1])
            pieces = np.split(flat, range(_PIECE, len(flat), _PIECE))
            with open_threads(executor.workers) as threads:
                outputs = np.concatenate(list(threads.map(compute, pieces)))
            self._add_sensor_errors(outputs, flat)
            return outputs.reshape(*rows.shape[:-1], *outputs.shape[1:])

        execution = self.experiment.model.execution
        with open_executor(simulator.engine, execution, None) as executor:
            yield run

    def sensor_errors(self, name: str, rows: Floats) -> dict[str, Floats]:
        """Return the sensor's scale, bias and noise [flight] that the campaign disperses."""
        stem = name if f"sensor.{name}_bias" in self.columns else name.rpartition("_")[0]
        stem = stem.removesuffix(ERROR)
        if name in self.noise or not self.timed:
            return {}
        return {
            error: rows[..., self.columns.index(column)]
            for error in ("scale", "bias", "noise")
            if (column := f"sensor.{stem}_{error}") in self.columns
        }

    def _add_sensor_errors(self, outputs: Floats, rows: Floats) -> None:
        for i, name in enumerate(self.names):
            errors, unit = self.sensor_errors(name, rows), parse_unit(self.units[name])[0]
            if "scale" in errors and not name.rpartition("_")[0].endswith(ERROR):
                outputs[:, :, i] *= errors["scale"][:, np.newaxis]
            outputs[:, :, i] += np.reshape(errors.get("bias", 0.0), (-1, 1)) / unit

    def simulate_sets(self, simulate: Callable[[Floats], Floats], rows: Floats) -> Floats:
        """Return outputs [set, flight, time, name] of `rows` with measurement noise."""
        outputs = simulate(rows)
        generator = np.random.default_rng(self.experiment.seed + 1)
        for i, name in enumerate(self.names):
            sigma: float | Floats = self.noise.get(name, 0.0)
            if "noise" in (errors := self.sensor_errors(name, rows)):
                sigma = np.abs(errors["noise"])[..., np.newaxis] / parse_unit(self.units[name])[0]
            outputs[..., i] += sigma * generator.standard_normal(outputs.shape[:-1])
        return outputs

    def align(self, simulated: Floats) -> Floats:
        """Align records with simulated flights [set, flight, time, name]; return the records.

        The result [flight, time, name] is NaN in gaps. Angles of both are near the mean of the
        simulated flights. A record is shifted in time if this reduces its deviation by more than
        that of any simulated flight.
        """
        if not self.timed:
            missing = np.full(1, np.nan)
            values = [
                [own.values.get(name, missing) for name in self.names] for own in self.records
            ]
            return np.array(values).swapaxes(1, 2)
        return np.array([self._align(k, simulated[:, k]) for k in range(len(self.records))])

    def _align(self, k: int, simulated: Floats) -> Floats:
        """Shift record `k` in time; return it, and align `simulated` [set, time, name]."""
        periods, is_shifted = self.experiment.periods, True
        for span in (0.1, 0.02, 0.0):
            record = self.records[k]
            test = record.sample(self.names, self.times, periods)
            for i, name in enumerate(self.names):
                pool = np.vstack([simulated[:, :, i], test[np.newaxis, :, i]])
                pool = align_flights(pool, periods[name], len(simulated))
                simulated[:, :, i], test[:, i] = pool[:-1], pool[-1]
            if not np.isfinite(test + simulated).any():
                expected = "times that overlap with those of the simulated flights"
                problem = "no value can be compared with the simulated flights"
                raise record.table.error(0, TIME, problem, expected)
            if span and is_shifted and self.times.size > 1:
                steps, is_significant = find_offset(simulated, test, span, len(self.space.names))
                is_shifted = is_significant or bool(record.offset)
                if is_shifted:
                    offset = record.offset + steps * float(np.mean(np.diff(self.times)))
                    self.records[k] = replace(record, offset=offset)
        return test
