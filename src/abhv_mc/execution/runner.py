"""Run of a campaign: computation of missing flights, envelopes and histories."""

import json
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.execution.added_values import add_values
from abhv_mc.execution.executor import (
    FlightRunner,
    check_source,
    connect,
    open_executor,
    simulate,
    with_proofs,
    work_ahead,
)
from abhv_mc.execution.flight_counts import (
    Completion,
    count_flights,
    flight_values,
    judge_requirements,
)
from abhv_mc.execution.interrupts import interrupts_deferred, sigterm_as_interrupt
from abhv_mc.execution.progress import Progress, Waiting
from abhv_mc.execution.progress_page import ProgressPage
from abhv_mc.execution.retention import (
    ESTIMATES,
    HistoryFile,
    StoredFlights,
    list_histories,
    write_kept_histories,
)
from abhv_mc.execution.retry import (
    BATCH_FLIGHTS,
    Block,
    choose_batch,
    choose_timed,
    choose_unrecorded,
    cut_blocks,
)
from abhv_mc.execution.setup import AddedValuesError, OpenCampaign, open_campaign
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.metrics import MARGIN_VALUES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.repeatability import ROUNDING, Repeatability, weakest
from abhv_mc.folder import envelope_states
from abhv_mc.folder.envelope_states import Cells, Collector
from abhv_mc.folder.flights import Digest, FlightRows, SampleReader, flights_schema, write_block
from abhv_mc.folder.flown_blocks import find_joins, join_files, read_flown_blocks
from abhv_mc.folder.hashes import KEY, Products
from abhv_mc.folder.histories import write_envelopes
from abhv_mc.folder.layout import append_log, write_text
from abhv_mc.folder.manifest import (
    COMPLETE,
    INTERRUPTED,
    RUNNING,
    Manifest,
    add_events,
    note_flyers,
)
from abhv_mc.interfaces import Engine, Fly, Plan
from abhv_mc.io.messages import grouped_digits, notify
from abhv_mc.process_settings import rare_garbage_collection
from abhv_mc.requests import Request

_SAVE_INTERVAL = 5.0  # interval in s between updates of the manifest


@dataclass(frozen=True)
class RunResult:
    """Result of a run: the folder and its manifest."""

    folder: Path
    manifest: Manifest

    @property
    def complete(self) -> bool:
        return self.manifest.complete


@rare_garbage_collection()
def run_campaign(request: Request, engine: Engine | None = None) -> RunResult:
    """Run a campaign, or the flights that are missing from its folder.

    After an interrupt the result is incomplete; completed flights are kept. ``engine`` replaces the
    compiled simulator of the vehicle. Raise InputError, before files are created, if the request is
    invalid, and StorageFullError if the disk is full.
    """
    try:
        return _run_campaign(request, engine)
    except AddedValuesError as error:

        def run(output: Path) -> Manifest:
            return _run_campaign(replace(request, output=output), engine).manifest

        manifest = add_values(error, run)
        if not manifest.complete:
            return RunResult(Path(error.file), manifest)
    return _run_campaign(request, engine)


def _run_campaign(request: Request, engine: Engine | None) -> RunResult:
    with ExitStack() as stack:
        stack.enter_context(sigterm_as_interrupt())
        scheduler = stack.enter_context(connect(request.scheduler))
        opened = open_campaign(request, engine, stack)
        executor = open_executor(
            opened.campaign.simulator.engine,
            opened.campaign.model.execution,
            request.workers,
            scheduler,
            request.check_workers,
        )
        return fly_opened(opened, lambda: stack.enter_context(executor))


def fly_opened(opened: OpenCampaign, find_executor: Callable[[], FlightRunner]) -> RunResult:
    """Run the missing flights of an open folder, then create envelopes and histories.

    ``find_executor`` returns the executor; it is called if the folder is not current.
    """
    return _Run(opened).run(find_executor)


class _Run:
    """Run of the missing flights of one folder."""

    fly: Fly
    workers: int
    batch: int  # number of flights in a block
    cells: dict[str, Cells]  # cells of the envelopes by controller; empty without envelopes

    def __init__(self, opened: OpenCampaign) -> None:
        self.folder, self.plans = opened.folder, opened.plans
        self.manifest, self.simulator = opened.manifest, opened.campaign.simulator
        self.campaign = with_proofs(opened.campaign)
        self.files = opened.files
        model = self.campaign.model
        self.completion = Completion(self.campaign, opened.shard, opened.requested)
        self.products = Products(self.folder, self.campaign.controllers, self.campaign.runs)
        self.stored = None
        if self.campaign.repeatability in (Repeatability.EXACT, Repeatability.ROUNDING):
            self.stored = StoredFlights(self.campaign, opened.shard)
        self.sharded = self.manifest.shard is not None
        self.samples = SampleReader(self.folder.samples)
        self.collectors: dict[str, Collector] = {}
        provenance = {"seed": str(model.seed), "campaign_hash": self.manifest.campaign_hash}
        provenance["version"] = str(self.manifest.versions.get("abhv_mc"))
        values = flight_values(self.campaign)
        self.columns = tuple(signal.name for signal in values)
        tables = self.campaign.parameters, self.campaign.outcomes
        self.schema = flights_schema(self.samples.names, provenance, values, *tables)
        self.with_margins = self.campaign.margin_flights
        self.start, self.wall_before = time.monotonic(), self.manifest.wall_time_s

    def run(self, find_executor: Callable[[], FlightRunner]) -> RunResult:
        """Run the missing flights, then create envelopes, histories and margins."""
        runs = dict.fromkeys(self.completion.done, self.campaign.runs)
        for rows, digest in read_flown_blocks(
            self.folder,
            runs,
            self.samples,
            self.columns,
            self.files,
            keep_failed_to_run=not self.campaign.can_rerun,
        ):
            self._count(rows, digest)
        is_complete = self.manifest.complete and self.completion.is_complete()
        adds_flights = not is_complete
        if is_complete and (self._has_products() or self._keeps_products()):
            if self._judge() != self.manifest:  # The controllers may have been reordered.
                self._write_manifest(COMPLETE)
            return RunResult(self.folder.root, self.manifest)
        check_source(self.folder, self.manifest, self.simulator)
        executor = find_executor()
        self.fly, self.workers = executor.fly, executor.workers
        batch = self.campaign.model.execution.batch
        self.batch = batch or choose_batch(self.campaign.runs, self.workers)
        self.most = self.campaign.runs  # largest block for which the time of a flight allows
        try:
            if not (self.completion.is_complete() and self._has_envelopes()):
                self._fly()
            is_complete = self.completion.is_complete()
            if is_complete:
                if adds_flights:
                    self._check_stored()
                self._finish()
            self._write_manifest(COMPLETE if is_complete else INTERRUPTED)
        except KeyboardInterrupt:
            with interrupts_deferred():
                self._write_manifest(INTERRUPTED)
        except BaseException:
            with suppress(Exception):  # A full disk must not hide the original error.
                self._write_manifest(INTERRUPTED)
            raise
        return RunResult(self.folder.root, self.manifest)

    def _keeps_products(self) -> bool:
        """Return True if stored histories are kept although requirements select other flights.

        A version of the program cannot add histories to flights of another version.
        """
        is_other = self.manifest.source_hash != self.simulator.engine.source
        return is_other and self._has_margins() and self._has_envelopes()

    def _has_products(self) -> bool:
        """Return whether histories, margins and envelopes are current; for a shard, return True."""
        if self.sharded:
            return True
        histories = all(file.product.is_current(self.files) for file in self._list_histories())
        return histories and self._has_margins() and self._has_envelopes()

    def _has_margins(self) -> bool:
        """Return True if trim margins are current or cannot be computed."""
        no_margins = self.simulator.engine.find_stability is None
        return no_margins or self.products.margins.is_current(self.files)

    def _make_cells(self, plan: Plan) -> Cells:
        """Return the channels and times of the envelopes of a controller."""
        campaign, points = self.campaign, len(self.campaign.unknowns.points)
        names = campaign.enveloped_channels
        index = {channel.name: i for i, channel in enumerate(campaign.channels)}
        columns = tuple(index[name] for name in names)
        every, times = 1, None
        if (timing := plan.timing) is not None:
            every = self.simulator.find_stride(plan, "envelopes")
            times = np.arange(timing.ticks // every + 1).astype(np.float64) * (every * timing.tick)
        return Cells(names, columns, every, times, points, campaign.periods)

    def _has_envelopes(self) -> bool:
        """Return True if envelopes are current and complete, or if none are requested."""
        last = min(self.completion.goal(), envelope_states.ENVELOPE_FLIGHTS)
        is_complete = all(
            mask[self.completion.first : last].all() for mask in self.completion.done.values()
        )
        no_envelopes = not self.campaign.has_bands
        return no_envelopes or (is_complete and self.products.envelopes.is_current(self.files))

    def _fly(self) -> None:
        """Run the missing flights, in steps if the campaign stops when its verdicts are known."""
        self.cells = {}
        if self.campaign.has_bands:
            self.cells = {name: self._make_cells(plan) for name, plan in self.plans.items()}
        if not self._has_envelopes():
            states, done = self.folder.envelope_states, self.completion.done
            self.collectors = {
                name: Collector(states, name, done[name], self.cells[name]) for name in self.plans
            }
        self._time_flights()
        while missing := self.completion.find_missing(self.collectors):
            self._fly_missing(missing)

    def _time_flights(self) -> None:
        """Set the block size from the computing time of a flight, if the simulator measures it."""
        plans = [system.plan for system in self.campaign.systems.values()]
        if (seconds := self.simulator.time_of_flight(plans)) is None:
            return
        for name, (rows, envelope) in self.completion.find_missing(self.collectors).items():
            if rows.any() and not seconds:
                first = int(np.argmax(rows))
                block = Block(name, first, first + 1, True, bool(envelope[first]))
                self._keep(*self._fly_block(block, self.samples.rows(first, first + 1)))
                seconds = self.simulator.time_of_flight(plans) or 0.0
        self.most = chosen = choose_timed(self.campaign.runs, self.workers, seconds)
        self.batch = self.campaign.model.execution.batch or min(
            chosen, BATCH_FLIGHTS if self.collectors else chosen
        )

    def _fly_missing(self, missing: dict[str, tuple[Mask, Mask]]) -> None:
        """Run the missing flights and store each finished block."""
        total = sum(int((rows | envelope).sum()) for rows, envelope in missing.values())
        again = sum(int((envelope & ~rows).sum()) for rows, envelope in missing.values())
        self._write_manifest(RUNNING)
        unrecorded = None
        if self.simulator.capabilities.is_repeatable:
            unrecorded = (
                envelope_states.ENVELOPE_FLIGHTS,
                min(self.most, choose_unrecorded(total, self.workers, self.batch)),
            )
        blocks = cut_blocks(missing, self.batch, self.with_margins, unrecorded)
        calls = ((block, self.samples.rows(block.first, block.stop)) for block in blocks)
        saved = time.monotonic()
        with (
            Progress(
                f"flights ({grouped_digits(again)} again for envelopes)" if again else "flights",
                total,
            ) as progress,
            closing(work_ahead(self.workers, self._fly_block, calls)) as landed,
            closing(
                ProgressPage(self.folder.progress, self.campaign, self.completion, progress)
            ) as page,
        ):
            for block, flown in landed:
                with interrupts_deferred():
                    self._keep(block, flown)
                progress.add(block.flights)
                page.update()
                if time.monotonic() - saved > _SAVE_INTERVAL:
                    self._write_manifest(RUNNING)
                    saved = time.monotonic()

    def _fly_block(self, block: Block, samples: Floats) -> tuple[Block, FlightBlock]:
        recorded = self.cells[block.controller].recording if block.needs_envelope else None
        margins = block.needs_rows and block.first < self.with_margins
        return block, simulate(
            self.campaign, block.controller, samples, recorded, self.fly, margins=margins
        )

    def _keep(self, block: Block, flown: FlightBlock) -> None:
        """Store a finished block and count its flights."""
        if block.needs_envelope:
            collector = self.collectors[block.controller]
            collector.add(block.first, flown)
            collector.covered[block.first : block.stop] &= flown.outcome != Outcome.FAILED_TO_RUN
        if block.needs_rows:
            timing = self.plans[block.controller].timing
            rows = FlightRows(
                controller=block.controller,
                first=block.first,
                names=self.samples.names,
                samples=self.samples.rows(block.first, block.stop),
                outcome=self.campaign.outcomes.of(flown.outcome),
                values=self._make_values(flown),
                columns=self.columns,
                duration=np.inf if timing is None else timing.duration,
                reasons=flown.reason_texts,
            )
            digest = write_block(self.folder.flights, rows, self.schema)
            self.manifest = replace(self.manifest, flown_by=note_flyers(
                self.manifest.flown_by, flown.flown_by, block.controller, block.first, block.stop
            ))  # fmt: skip
            self._count(rows, digest)
            self._note_events(block, flown)
            for flight in rows.flights[flown.outcome == Outcome.FAILED_TO_RUN]:
                notify(f"flight {flight} of controller '{block.controller}' failed to run")

    def _count(self, rows: FlightRows, digest: Digest) -> None:
        self.completion.add(rows, digest)
        if self.stored is not None:
            self.stored.add(rows)

    def _check_stored(self) -> None:
        """Re-run some flights of a custom simulator and record whether their values differ."""
        if self.stored is None:
            return
        size, description = self.stored.run_again(
            self.fly, self.workers, self.samples, self.completion.all_counts
        )
        observed = Repeatability.EXACT if size == 0.0 else Repeatability.ROUNDING
        warnings = list(self.manifest.warnings)
        if size > ROUNDING:
            observed = Repeatability.NOISE
            warnings.append(f"re-run flights differ: {description}; {ESTIMATES}")
        state = weakest([self.campaign.repeatability, observed])
        self.campaign = replace(self.campaign, repeatability=state)
        self.manifest = replace(self.manifest, repeatable=state, warnings=tuple(warnings))

    def _note_events(self, block: Block, flown: FlightBlock) -> None:
        """Store the events and the standard error output of a custom simulator."""
        if flown.events:
            name = block.controller
            events = add_events([self.manifest.simulator_events, {name: flown.events}])
            warnings = *self.manifest.warnings, *self.simulator.describe_events(name, flown.events)
            self.manifest = replace(
                self.manifest,
                simulator_events=events,
                warnings=tuple(dict.fromkeys(warnings)),
            )
        if flown.standard_error:
            append_log(
                self.folder.log,
                f"flights {block.first} to {block.stop - 1} of controller '{block.controller}'",
                flown.standard_error,
            )

    def _make_values(self, flown: FlightBlock) -> Floats:
        """Return the values [flight, value] of a block; margins not computed are NaN."""
        count = len(self.campaign.measured)
        metrics, margins = flown.metrics[:, :count], flown.metrics[:, count:]
        if not self.campaign.margin_flights:
            return np.column_stack([metrics, flown.end_time])
        missing = np.full((len(metrics), len(MARGIN_VALUES)), np.nan)
        return np.column_stack([metrics, flown.end_time, margins if margins.size else missing])

    def _finish(self) -> None:
        """Create envelopes, histories and margins; a shard keeps its data for the merge."""
        if self.sharded:
            self._join_files()
            return
        # Files that will be replaced are first removed from the manifest, because the process may
        # be killed.
        histories = self._list_histories()
        products = (file.product for file in histories)
        current = {product.path for product in products if product.is_current(self.files)}
        self.files.forget(*(set(self.folder.histories.glob("*.parquet")) - current))
        if self.collectors:
            self.files.forget(self.folder.envelopes)
        self._write_manifest(RUNNING)
        if self.collectors:
            times = np.unique(
                np.concatenate([collector.times for collector in self.collectors.values()])
            )
            tables = {name: self.collectors[name].table(times) for name in self.plans}
            # The blocks of a custom simulator contain times after the end of their flights.
            cells = next(iter(self.cells.values()))
            if cells.times is None:
                flown = np.any([table.count.any(axis=1) for table in tables.values()], axis=0)
                times, tables = (
                    times[flown],
                    {name: table.at(flown) for name, table in tables.items()},
                )
            number = min(self.completion.goal(), envelope_states.ENVELOPE_FLIGHTS)
            path, key = self.products.envelopes
            write_envelopes(
                path,
                times,
                cells.channels,
                tables,
                flights=number,
                points=cells.points,
                key=key,
            )
        try:
            failed = write_kept_histories(
                self.folder,
                self.campaign,
                histories,
                self.samples,
                self.fly,
                workers=self.workers,
                hashes=self.files,
            )
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            failed = [f"not all histories were created ({type(error).__name__}: {error})"]
        self.manifest = replace(self.manifest, not_made=tuple(failed))
        for problem in failed:
            print(f"{problem}; run the same command to try again", file=sys.stderr)
        self._write_stability()
        for name, collector in self.collectors.items():
            # In other cases the stored values are needed when failed flights are run again or a
            # campaign of slow simulations is extended.
            if (
                self.simulator.capabilities.is_repeatable
                and not self.completion.all_counts[name].uncomputed.any()
            ):
                collector.finish()
        self._join_files()

    def _join_files(self) -> None:
        """Join small files of flights into large files.

        The joined files are written first, then the manifest, and then the small files are deleted.
        After a kill, the next run deletes the files that are not in the manifest.
        """
        joins = find_joins(
            [path for path in self.files.paths() if path.parent == self.folder.flights]
        )
        for paths in joins:
            join_files(paths)
        small = [path for paths in joins for path in paths]
        self.files.forget(*small)
        if small:
            self._write_manifest(RUNNING)
        for path in small:
            path.unlink()

    def _write_stability(self) -> None:
        """Write the trim margins of all controllers in the folder."""
        if self.simulator.engine.find_stability and not self._has_margins():
            with Waiting("margins"):
                margins = self.simulator.engine.find_stability(self.campaign, self.plans)
            path, key = self.products.margins
            text = json.dumps(margins | {KEY: key}, indent=1, allow_nan=False)
            write_text(path, text + "\n")

    def _list_histories(self) -> list[HistoryFile]:
        return list_histories(
            self.folder,
            replace(self.campaign, runs=self.completion.goal()),
            self.completion.all_counts,
        )

    def _judge(self) -> Manifest:
        """Return the manifest with the verdicts; shards have no verdicts."""
        if self.sharded:
            return self.manifest
        return judge_requirements(self.manifest, self.completion.all_counts, self.campaign)

    def _write_manifest(self, state: str) -> None:
        counted, gapless = count_flights(
            self.manifest, self.completion.all_counts, self.completion.done
        )
        self.manifest = replace(
            counted,
            state=state,
            runs_planned=self.completion.stop - self.completion.first,
            wall_time_s=round(self.wall_before + time.monotonic() - self.start, 3),
            stopped_at=gapless if self.campaign.model.stop and state == COMPLETE else None,
        )
        self.manifest = self.files.write_manifest(self._judge())
