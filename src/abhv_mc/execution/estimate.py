"""Estimate of the time and disk space of a campaign from a few of its flights."""

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import make_ready, simulate
from abhv_mc.execution.first_flights import fly_first
from abhv_mc.execution.flight_counts import FlightCounts, make_flight_counts
from abhv_mc.execution.retention import select_flights
from abhv_mc.execution.retry import choose_batch
from abhv_mc.folder.envelope_states import ENVELOPE_FLIGHTS
from abhv_mc.folder.flights import END_TIME, FlightRows, flights_schema, write_block
from abhv_mc.folder.histories import write_histories
from abhv_mc.identity import count_cores
from abhv_mc.interfaces import Engine
from abhv_mc.statistics.unknowns import search_flights

TRIAL_FLIGHTS = 64


@dataclass(frozen=True)
class Estimate:
    """Estimated time and disk space of a campaign."""

    flights: int  # number of flights per controller
    controllers: int
    kind: str  # noun for a compared system: 'controller' or 'system'
    workers: int
    batch: int  # number of flights per block
    flight_s: float  # time of one flight on one core in s, averaged over controllers
    flying_s: float  # wall time of all flights in s
    rows_bytes: int
    histories_bytes: int
    searched: int  # number of flights per controller in the search over the unknowns
    # number of flights per controller whose histories are stored, without the flights selected by
    # the entry 'failed'
    kept: int
    envelope_bytes: int  # disk space of envelope data during the run
    warnings: tuple[str, ...]  # warnings about the mission

    @property
    def search_s(self) -> float:
        """Wall time in s of the search over the unknowns, included in ``flying_s``."""
        return self.controllers * self.flight_s * self.searched / self.workers

    @property
    def disk_bytes(self) -> int:
        """Maximum disk space during the run in bytes."""
        return self.rows_bytes + self.histories_bytes + self.envelope_bytes


def estimate_campaign(
    campaign: Experiment, engine: Engine | None = None, workers: int | None = None
) -> Estimate:
    """Estimate the cost from a few flights of each controller, and leave no files behind.

    Raise InputError for errors that only a flight reveals, such as a dispersion without effect.
    """
    model = campaign.model
    campaign = replace(campaign, engine=engine)
    simulator = campaign.simulator
    plans = simulator.make_plans(campaign.controllers)
    campaign = make_ready(campaign, plans)
    every = cells = 0
    first = next(iter(plans.values()))
    history_every = simulator.find_stride(first, "histories")
    if first.timing is not None:
        every = simulator.find_stride(first, "envelopes")
        cells = (first.timing.ticks // every + 1) * len(campaign.enveloped_channels)
    first_flights = fly_first(campaign, workers, {}).warnings
    source = campaign.make_samples()
    number = min(TRIAL_FLIGHTS, campaign.runs)
    values = source.draw(0, number)
    seconds, rows_size, histories_size = [], 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for name in plans:
            start = time.perf_counter()
            block = simulate(campaign, name, values, every)
            seconds.append((time.perf_counter() - start) / number)
            outcomes = campaign.outcomes.of(block.outcome)
            table = np.column_stack([block.metrics, block.end_time])
            columns = (*(metric.name for metric in campaign.measured), END_TIME.name)
            rows = FlightRows(
                controller=name,
                first=0,
                names=tuple(source.names),
                samples=values,
                outcome=outcomes,
                values=table,
                columns=columns,
            )
            tables = campaign.parameters, campaign.outcomes
            schema = flights_schema(source.names, {}, (*campaign.measured, END_TIME), *tables)
            write_block(Path(folder), rows, schema)
            rows_size += next(Path(folder).glob(f"{name}-*")).stat().st_size
            if not campaign.channels:
                continue
            block = simulate(campaign, name, values[:16], history_every)
            path = Path(folder) / "history.parquet"
            histories = path, name, range(len(block.outcome)), block.times, block.history
            write_histories(*histories, channels=campaign.kept_channels, recorded=campaign.channels)
            if first.timing is None and campaign.has_bands:
                cells = round(
                    block.times.size * model.keep.envelopes.rate / model.keep.histories.rate
                )
                cells *= len(campaign.channels)
            histories_size += path.stat().st_size // len(block.outcome)
    searched = 0
    if campaign.unknowns.names and model.points is None and campaign.requirements:
        searched = search_flights(
            len(campaign.unknowns.names), len(campaign.requirements), campaign.runs_at_point
        )
    workers = workers or model.execution.workers or count_cores()
    counts: FlightCounts = next(iter(make_flight_counts(campaign).values()))
    worst = range(min(campaign.worst, campaign.runs))
    history_flights = (
        len(select_flights(model.keep.histories.flights, campaign.runs, counts, worst))
        if campaign.channels
        else 0
    )
    return Estimate(
        flights=campaign.runs,
        controllers=len(plans),
        kind=campaign.kind,
        workers=workers,
        batch=model.execution.batch or choose_batch(campaign.runs, workers),
        flight_s=sum(seconds) / len(seconds),
        flying_s=sum(seconds) * (campaign.runs + history_flights + searched) / workers,
        rows_bytes=rows_size * campaign.runs // number,
        histories_bytes=histories_size * history_flights,
        searched=searched,
        kept=history_flights,
        envelope_bytes=4 * cells * min(campaign.runs, ENVELOPE_FLIGHTS) * len(plans),
        warnings=(*simulator.find_warnings(plans), *first_flights),
    )
