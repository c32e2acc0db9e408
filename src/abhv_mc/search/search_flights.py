"""Results folder of a search: a campaign's folder with a block for each batch of flights.

The algorithms are deterministic functions of their seed and of the values they receive. Therefore a
search is resumed by running it again: stored batches are read from their blocks, other batches are
simulated. `abhv-mc replay`, `query` and `verify campaign` also read the folder of a search.
"""

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Mask, Singles
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment, Requirement, check_user_code
from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.custom_code.source import trust
from abhv_mc.execution.executor import (
    FlightRunner,
    check_source,
    connect,
    make_ready,
    open_executor,
    simulate,
)
from abhv_mc.execution.first_flights import fly_first
from abhv_mc.execution.progress import Progress
from abhv_mc.flights.metrics import MARGIN_NAMES, MARGIN_VALUES, Metric
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import (
    END_TIME,
    DamagedFileError,
    FlightRows,
    block_path,
    flights_schema,
    write_block,
    write_samples,
)
from abhv_mc.folder.flown_blocks import read_campaign_block
from abhv_mc.folder.inputs import FolderInputs, collect_inputs, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import (
    COMPLETE,
    INTERRUPTED,
    RUNNING,
    ControllerCount,
    Manifest,
    write_manifest,
)
from abhv_mc.folder.opening import FlownFolder, begin_folder, find_stored_plans, open_folder
from abhv_mc.identity import find_commit, find_machine, find_versions
from abhv_mc.interfaces import Engine, Simulator
from abhv_mc.io.input_files import reading_once
from abhv_mc.io.messages import InputError, notify, one_of
from abhv_mc.requests import Paths, SearchRequest
from abhv_mc.search.space import Space, make_space
from abhv_mc.statistics.estimates import Criterion

# Severity of an early termination, to which the missing flight time (s) is added.
ENDED_EARLY = 1e9
# A flight fails if its severity exceeds this value; a flight exactly at a limit (severity 0) fails.
FAILS_ABOVE = -float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Severity:
    """Severity of flights by one metric: larger is worse, and continuous if possible.

    The severity is NaN if a flight failed to run.
    """

    # metric, undesired direction, and limits of a requirement
    criterion: Criterion
    duration: float  # duration in s of a flight that does not terminate early
    early_is_worse: bool = True

    def of(self, rows: FlightRows) -> Floats:
        """Return severities [flight]."""
        excess = self.criterion.excess(rows.column(self.criterion.metric))
        severities = np.where(np.isinf(excess), ENDED_EARLY, excess)
        if self.early_is_worse:
            severities = np.where(
                ended_early(rows), ENDED_EARLY + self.duration - rows.end_time, severities
            )
        return np.where(not_computed(rows), np.nan, severities)

    def ranked(self, rows: FlightRows) -> Floats:
        """Return severities [flight], with -infinity for flights that failed to run."""
        severities = self.of(rows)
        return np.where(np.isnan(severities), -np.inf, severities)


def ended_early(rows: FlightRows) -> Mask:
    """Return a mask [flight] of flights that terminated early."""
    outcome = np.array(rows.outcome)
    return (outcome != Outcome.OK.code) & (outcome != Outcome.FAILED_TO_RUN.code)


def not_computed(rows: FlightRows) -> Mask:
    """Return a mask [flight] of flights that failed to run."""
    return np.array(rows.outcome) == Outcome.FAILED_TO_RUN.code


def rank_distinct(
    severities: Floats, samples: Floats, number: int, min_distance: float = 0.0
) -> list[int]:
    """Return the flights with the largest severities and distinct samples, worst first.

    Each flight is farther than `min_distance` from all worse returned flights (rms over the columns
    of `samples` [flight, parameter], scaled by their range). An infinite value, such as the time of
    a failure that does not occur, is one range away from any finite value.
    """
    order = np.argsort(-severities, kind="stable")
    order = order[np.isfinite(severities[order])]
    comes = np.isfinite(samples)
    low = samples.min(0, where=comes, initial=np.inf)
    span = samples.max(0, where=comes, initial=-np.inf) - low
    scaled = np.where(comes, samples, 0.0)[order] / np.where(span > 0.0, span, 1.0)
    comes = comes[order]
    flights: list[int] = []
    while len(order) and len(flights) < number:
        flights.append(int(order[0]))
        distance = np.where(comes == comes[0], scaled - scaled[0], 1.0)
        is_distinct = np.sqrt(np.mean(distance**2, axis=1)) > min_distance
        order, scaled, comes = order[is_distinct], scaled[is_distinct], comes[is_distinct]
    return flights


_DRAWN = 3  # number of worst flights whose time histories a page shows
# minimum distance between the plotted flights, as a share of the simulated range (rms over
# parameters)
DRAWN_APART = 0.1
_DRAWN_STEP = 0.1  # time step of the histories in s


def read_searched(
    path: Paths, controller: str | None, seed: int | None, engine: Engine | None = None
) -> tuple[Experiment, str]:
    """Return the campaign and the controller to search, or raise InputError if one is invalid."""
    campaign = read_campaign(Path(path), None, seed, engine=engine)
    for source in check_user_code(campaign):
        # By passing the campaign file directly, the user consents to running its custom code.
        trust(source)
    return campaign, campaign.choose_controller(controller)


def find_metric(
    campaign: Experiment, name: str, make_error: Callable[[str, str], InputError]
) -> Metric:
    """Return a metric of the campaign, or raise the error that `make_error` returns.

    `make_error` receives the problem and the expected input.
    """
    metrics = campaign.metrics
    if name in MARGIN_NAMES and not campaign.margin_flights:
        raise make_error(
            f"'{name}' requires the key 'margins'",
            "'margins: {at: [trim]}' in the campaign, which computes the margins",
        )
    if name not in metrics:
        raise make_error(f"unknown metric '{name}'", one_of(metrics, name))
    return metrics[name]


def binding_requirements(campaign: Experiment, controller: str) -> list[Requirement]:
    """Return the requirements that apply to the searched controller."""
    return [
        item for item in campaign.requirements if not item.named or controller in item.controllers
    ]


@dataclass(frozen=True)
class DrawnFlights:
    """Time histories of the nominal flight and of selected flights, in this order."""

    numbers: tuple[int, ...]
    times: Floats  # times in s
    # [1 + flight, time, channel] in the order of the campaign's channels; NaN after the end
    history: Singles
    campaign: Experiment


class SearchFlights:
    """Flights of one search, simulated or read from the folder of the search."""

    def __init__(
        self,
        flown: FlownFolder,
        campaign: Experiment,
        executor: FlightRunner,
        writer: ThreadPoolExecutor,
        margins: bool,
    ) -> None:
        """Prepare the flights of a search.

        `campaign` contains only the searched controller; `margins` adds stability margins to every
        flight. `writer` is a thread that writes a block while the next block is simulated.
        """
        self._writer, self._writing = writer, Future[Any]()
        self._writing.set_result(None)
        self.folder, self.manifest, self.files = flown.folder, flown.manifest, flown.files
        self.space: Space = make_space(campaign)
        self.campaign, self.executor = replace(campaign, columns=self.space.columns), executor
        ((self.controller, (self.plan, _)),) = campaign.systems.items()
        self.margins = margins
        signals = (*self.plan.metrics, END_TIME, *(MARGIN_VALUES if margins else ()))
        self.columns = tuple(signal.name for signal in signals)
        self.seed = campaign.model.seed
        provenance = {"seed": str(self.seed), "campaign_hash": self.manifest.campaign_hash}
        tables = campaign.parameters, campaign.outcomes
        self.schema = flights_schema(self.space.columns, provenance, signals, *tables)
        self.blocks: list[FlightRows] = []
        self.progress: Progress | None = None

    @property
    def flown(self) -> int:
        """Number of flights so far, including the flights of earlier runs."""
        return self.blocks[-1].stop if self.blocks else 0

    @property
    def failed_to_run(self) -> int:
        """Number of flights that failed to run."""
        return sum(int(not_computed(rows).sum()) for rows in self.blocks)

    @property
    def duration(self) -> float:
        """Duration (s) of a flight that does not terminate early; 0 if the duration varies."""
        return self.plan.timing.duration if self.plan.timing else 0.0

    def rows(self) -> FlightRows:
        """Return all flights so far."""
        return replace(
            self.blocks[0],
            samples=np.concatenate([block.samples for block in self.blocks]),
            outcome=tuple(code for block in self.blocks for code in block.outcome),
            values=np.concatenate([block.values for block in self.blocks]),
            reasons=(),
        )

    def fly(self, values: Floats, common_seed: bool) -> FlightRows:
        """Simulate flights with the parameter values [flight, dimension], or read stored ones.

        If `common_seed`, all flights have the same seed; otherwise each flight has its own.
        """
        first = self.flown
        samples = self.space.complete(values, self.seed, None if common_seed else first)
        rows = self._remember(first, samples)
        if rows is None:
            rows = self._fly(first, samples)
            self._writing.result()  # Raise any error from writing the previous block.
            self._writing = self._writer.submit(write_block, self.folder.flights, rows, self.schema)
        self.blocks.append(rows)
        if self.progress is not None:
            self.progress.add(len(samples))
        return rows

    def _remember(self, first: int, samples: Floats) -> FlightRows | None:
        """Return the stored block with these samples; None if it is missing or incomplete."""
        path = block_path(self.folder.flights, self.plan.controller, first, first + len(samples))
        with contextlib.suppress(DamagedFileError):
            ((rows, _),) = read_campaign_block(path, self.space.columns, self.files)
            same = rows.columns == self.columns and np.array_equal(rows.samples, samples)
            if same and not not_computed(rows).any():
                return rows
        return None

    def _fly(self, first: int, samples: Floats) -> FlightRows:
        count = len(self.plan.metrics)
        flown = simulate(
            self.campaign,
            self.controller,
            samples,
            None,
            self.executor.fly_parallel,
            margins=self.margins,
        )
        metrics, margins = np.split(flown.metrics, [count], axis=1)
        return FlightRows(
            controller=self.plan.controller,
            first=first,
            names=self.space.columns,
            samples=samples,
            outcome=self.campaign.outcomes.of(flown.outcome),
            values=np.column_stack([metrics, flown.end_time, margins]),
            columns=self.columns,
            reasons=flown.reason_texts,
        )

    def draw(self, severities: Floats) -> DrawnFlights | None:
        """Re-run the nominal flight and the worst distinct flights with time histories.

        `severities` [flight] contains the severities of all flights. Return None if the histories
        have no common times.
        """
        rows = self.rows()
        numbers = rank_distinct(
            severities,
            rows.samples[: len(severities), : len(self.space.names)],
            _DRAWN,
            DRAWN_APART,
        )
        if (timing := self.plan.timing) is None:
            return None
        nominal = [self.campaign.parameters.nominal_of(rows.names)]
        drawn = np.concatenate([nominal, rows.samples[numbers]])
        every = max(1, round(_DRAWN_STEP / timing.tick))
        block = simulate(self.campaign, self.controller, drawn, every, self.executor.fly)
        return DrawnFlights(tuple(numbers), block.times, block.history, self.campaign)

    def finish(self, result: dict[str, Any]) -> None:
        """Delete unused blocks; write samples, outcomes and the result."""
        self._writing.result()
        names = {
            block_path(self.folder.flights, block.controller, block.first, block.stop).name
            for block in self.blocks
        }
        for path in self.folder.flights.glob("*.parquet"):
            if path.name not in names:
                path.unlink()
                self.files.forget(path)
        rows = self.rows()
        write_samples(
            self.folder.samples,
            rows.names,
            rows.stop,
            lambda first, stop: rows.samples[first:stop],
            {"seed": str(self.seed), "design": (self.manifest.search or {})["kind"]},
            table=self.campaign.parameters,
        )
        outcomes, counts = np.unique(np.array(rows.outcome), return_counts=True)
        self._write(
            COMPLETE,
            runs_planned=rows.stop,
            runs_done=rows.stop - self.failed_to_run,
            runs_failed=self.failed_to_run,
            controllers={
                self.plan.controller: ControllerCount(
                    dict(zip(outcomes.tolist(), counts.tolist(), strict=True)), rows.stop
                )
            },
            digest=str(rows.digest()),
            result=result,
        )

    def _write(self, state: str, **entries: Any) -> None:
        self.manifest = self.files.write_manifest(self.manifest, state=state, **entries)


@contextlib.contextmanager
def open_search(
    request: SearchRequest,
    settings: dict[str, Any],
    flights: int,
    engine: Engine | None = None,
    with_margins: bool = False,
) -> Iterator[SearchFlights]:
    """Open the folder of a search, lock it and start the executor.

    `settings` determines the result of the search. If `with_margins`, stability margins are
    computed for every flight. Raise InputError, before any file is written, if the folder does not
    contain the beginning of the same search.
    """
    with ExitStack() as stack:
        stack.enter_context(reading_once())
        campaign, name = read_searched(request.campaign, request.controller, request.seed, engine)
        simulator = campaign.simulator
        make_space(campaign)
        folder, inputs = CampaignFolder(Path(request.output)), collect_inputs(campaign)
        settings = {**settings, "controller": name}
        flown = open_folder(folder, request.fresh, stack)
        if flown is not None:
            _check_same(flown, settings, inputs, simulator)
            manifest, files = flown.manifest, flown.files
            plan = simulator.restore_plans(find_stored_plans(folder), [name])[name]
        else:
            plan = simulator.make_plans([name])[name]
            first = fly_first(make_ready(campaign, {name: plan}), request.workers, {})
            for warning in first.warnings:
                notify(f"warning: {warning}")
            files = begin_folder(folder, inputs, {name: plan}, stack)
            manifest = Manifest(
                name=campaign.model.name,
                state=RUNNING,
                search=settings,
                campaign_hash=inputs.identity,
                inputs=inputs.hashes,
                seed=campaign.model.seed,
                source_hash=simulator.engine.source,
                versions=find_versions(),
                commit=find_commit(),
                machine=find_machine(),
                files=files.listed(),
                warnings=first.warnings,
            )
            write_manifest(folder.manifest, manifest)
        scheduler = stack.enter_context(connect(request.scheduler))
        executor = stack.enter_context(
            open_executor(simulator.engine, campaign.model.execution, request.workers, scheduler)
        )
        writer = stack.enter_context(ThreadPoolExecutor(1))
        ready = make_ready(campaign, {name: plan}, with_margins)
        search = SearchFlights(
            FlownFolder(folder, manifest, files), ready, executor, writer, with_margins
        )
        with Progress("flights", flights) as search.progress:
            try:
                yield search
            except KeyboardInterrupt:
                search._write(INTERRUPTED)
                raise


def _check_same(
    flown: FlownFolder, settings: dict[str, Any], inputs: FolderInputs, simulator: Simulator
) -> None:
    """Raise InputError if the folder does not contain the beginning of the same search."""
    root, manifest = flown.folder.root, flown.manifest
    before = manifest.search
    expected = "the folder of this search, another folder (-o DIR), or --fresh (worst, rare)"
    if before is None:
        raise InputError(root, "the folder already contains the flights of a campaign", expected)
    both = (inputs, stored := read_folder_inputs(flown.folder, manifest))
    axes = [
        list(item.data.get("dispersions") or ()) for item in both
    ]  # names of the dispersions; their order is the order of the search's dimensions
    limits = [
        str(change)
        for change in find_requirement_changes(stored.data, inputs.data)
        if change.key not in ("controllers", "under_test", "family")
    ]
    if limits and before["kind"] == "rare":
        raise InputError(
            root,
            f"the folder contains a search with other requirements ({'; '.join(limits)})",
            "another folder (-o DIR), because new limits require a new search",
        )
    if stored.identity != inputs.identity or axes[0] != axes[1]:
        raise InputError(root, "the folder contains a search of another campaign", expected)
    changes = [
        f"{key}: {before.get(key)} -> {value}"
        for key, value in settings.items()
        if before.get(key) != value
    ]
    if changes:
        raise InputError(
            root, f"the folder contains another search ({'; '.join(changes)})", expected
        )
    check_source(flown.folder, manifest, simulator)
