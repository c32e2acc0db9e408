"""A search's folder: the shape of a campaign's, with one block of flights for each batch that the search asked for.

The algorithms are functions of their seeds and of the values that they are given. So a search is resumed by running it
again: batches whose flights are stored are answered from their blocks, the others are flown. `abhv-mc replay`, `query`
and `verify campaign` read the folder like any campaign's.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.campaign.file.requirement_set import describe_requirement_changes
from abhv_mc.execution.executor import FlightRunner, connect, open_executor
from abhv_mc.execution.first_flights import FirstFlights, fly_first
from abhv_mc.execution.probe_dispersions import fly_probes
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.metrics import MARGIN_NAMES, MARGIN_VALUES, Metric
from abhv_mc.folder.flights import (
    END_TIME,
    DamagedFileError,
    FlightRows,
    block_path,
    flights_schema,
    write_block,
)
from abhv_mc.folder.flown_blocks import read_own_block
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
from abhv_mc.folder.opening import FlownFolder, begin_folder, open_folder
from abhv_mc.folder.samples import write_samples
from abhv_mc.identity import find_commit, find_machine, find_versions
from abhv_mc.interfaces import Engine, Simulator
from abhv_mc.io.documents import InputError, one_of
from abhv_mc.io.input_files import reading_once
from abhv_mc.requests import Paths, SearchRequest
from abhv_mc.search.severity import not_computed, rank_distinct
from abhv_mc.search.space import Space, make_space
from abhv_mc.simulators.campaign_code import check_user_code
from abhv_mc.simulators.engine import check_source, make_ready, simulate
from abhv_mc.user_code.trust import trust

_DRAWN = 3  # flights whose histories a page shows
DRAWN_APART = 0.1  # of the range flown, rms over the parameters: so far apart they lie at least
_DRAWN_STEP = 0.1  # s


def read_searched(
    path: Paths, controller: str | None, seed: int | None, engine: Engine | None = None
) -> tuple[Experiment, str]:
    """The campaign and the controller that is searched. Raises InputError."""
    campaign = read_campaign(Path(path), None, seed, engine=engine)
    for source in check_user_code(campaign):
        trust(source)  # his own file: he flies it
    controllers = campaign.controllers
    name = controller or next(iter(controllers))
    if name not in controllers:
        raise campaign.document.error(
            ("controllers",), f"no controller '{name}'", one_of(controllers, name)
        )
    return campaign, name


def find_metric(campaign: Experiment, name: str, place: Callable[[str, str], InputError]) -> Metric:
    """What the campaign knows of a metric; raises what ``place`` makes of what was found and what was expected."""
    metrics = campaign.metrics
    if name in MARGIN_NAMES and campaign.model.margins is None:
        raise place(
            f"'{name}' without 'margins'",
            "'margins: {at: [trim]}' in the campaign, which finds them",
        )
    if name not in metrics:
        raise place(f"unknown metric '{name}'", one_of(metrics, name))
    return metrics[name]


def binding_requirements(
    campaign: Experiment, controller: str, metric: str
) -> tuple[Requirement, ...]:
    """Return the campaign's requirements on a metric that hold for a searched controller."""
    return tuple(
        item
        for item in campaign.requirements
        if item.metric == metric and (not item.named or controller in item.controllers)
    )


@dataclass(frozen=True)
class DrawnFlights:
    """Histories of some flights, after the nominal one."""

    numbers: tuple[int, ...]
    times: Floats  # [time] s
    history: NDArray[
        np.float32
    ]  # [1 + flight, time, channel] in the order of CHANNELS; NaN after the end


class SearchFlights:
    """Flies the points of one search, or remembers them; made by :func:`open_search`."""

    def __init__(
        self,
        flown: FlownFolder,
        campaign: Experiment,
        executor: FlightRunner,
        writer: ThreadPoolExecutor,
        margins: bool,
    ) -> None:
        """``campaign``: with the one controller ready to fly that is searched, ``margins`` with stability margins.

        ``writer``: a thread that writes a block while the next one flies.
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
        """Flights so far, those of earlier runs among them."""
        return self.blocks[-1].stop if self.blocks else 0

    @property
    def failed_to_run(self) -> int:
        """Flights that the machine could not compute."""
        return sum(int(not_computed(rows).sum()) for rows in self.blocks)

    @property
    def duration(self) -> float:
        """Of a flight that does not end early, s; 0 where flights have times of their own."""
        return self.plan.timing.duration if self.plan.timing else 0.0

    def rows(self) -> FlightRows:
        """All flights so far."""
        names = self.space.columns
        samples = np.concatenate([block.samples for block in self.blocks])
        outcome = tuple(code for block in self.blocks for code in block.outcome)
        values = np.concatenate([block.values for block in self.blocks])
        return FlightRows(self.plan.controller, 0, names, samples, outcome, values, self.columns)

    def fly(self, values: Floats, common_seed: bool) -> FlightRows:
        """The flights of parameter values ``[flight, dimension]``; seeds are one for all, or each flight's own."""
        first = self.flown
        samples = self.space.complete(values, self.seed, None if common_seed else first)
        rows = self._remember(first, samples)
        if rows is None:
            rows = self._fly(first, samples)
            self._writing.result()  # the one before: raises what kept it from being written
            self._writing = self._writer.submit(write_block, self.folder.flights, rows, self.schema)
        self.blocks.append(rows)
        if self.progress is not None:
            self.progress.add(len(samples))
        return rows

    def _remember(self, first: int, samples: Floats) -> FlightRows | None:
        """The stored block of exactly these samples; None where there is none, or the machine failed on some of it."""
        path = block_path(self.folder.flights, self.plan.controller, first, first + len(samples))
        with contextlib.suppress(DamagedFileError):
            ((rows, _),) = read_own_block(path, self.space.columns, self.files)
            same = rows.columns == self.columns and np.array_equal(rows.samples, samples)
            if same and not not_computed(rows).any():
                return rows
        return None

    def _fly(self, first: int, samples: Floats) -> FlightRows:
        names, count = self.space.columns, len(self.plan.metrics)
        flown = simulate(
            self.campaign,
            self.controller,
            samples,
            None,
            self.executor.fly_side_by_side,
            margins=self.margins,
        )
        outcome = self.campaign.outcomes.of(flown.outcome)
        values = np.column_stack(
            [flown.metrics[:, :count], flown.end_time, flown.metrics[:, count:]]
        )
        return FlightRows(
            controller=self.plan.controller,
            first=first,
            names=names,
            samples=samples,
            outcome=outcome,
            values=values,
            columns=self.columns,
            reasons=flown.reason_texts,
        )

    def draw(self, severities: Floats) -> DrawnFlights | None:
        """Fly the nominal flight and the worst of the first ones again, with histories; None where flights have no
        common times.

        ``severities`` [flight] of the flights from 0 on; the worst ones that lie apart from each other are drawn.
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
        return DrawnFlights(tuple(numbers), block.times, block.history)

    def finish(self, result: dict[str, Any]) -> None:
        """Drop blocks that belong to no batch, write what all flights are, and the result into the manifest."""
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
        provenance = {"seed": str(self.seed), "design": (self.manifest.search or {})["kind"]}
        write_samples(
            self.folder.samples,
            rows.names,
            rows.stop,
            lambda first, stop: rows.samples[first:stop],
            provenance,
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
        self.manifest = replace(self.manifest, state=state, **entries, files=self.files.listed())
        write_manifest(self.folder.manifest, self.manifest)


@contextlib.contextmanager
def open_search(
    request: SearchRequest,
    settings: dict[str, Any],
    flights: int,
    engine: Engine | None = None,
    with_margins: bool = False,
) -> Iterator[SearchFlights]:
    """The folder of a search, locked, and its executor; ``settings`` are what the search's result depends on.

    Every flight has its stability margins ``with_margins``. Raises InputError, before anything is written, where the
    folder holds anything else than the beginning of the same search.
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
            plan = simulator.restore_plans(folder.root, [name])[name]
        else:
            plan = simulator.make_plans([name])[name]
            ready = make_ready(campaign, {name: plan})
            first = FirstFlights()
            if plan.timing is None:
                first = fly_first(ready, request.workers)
                for words in first.warnings:
                    print(f"warning: {words}", file=sys.stderr, flush=True)
            else:
                fly_probes(ready, plan.timing.ticks)
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
    flown: FlownFolder, settings: dict[str, Any], asked: FolderInputs, simulator: Simulator
) -> None:
    """Raise InputError where the folder does not hold the beginning of the same search."""
    root, manifest = flown.folder.root, flown.manifest
    before = manifest.search
    wish = "the same search, another folder (-o DIR), or --fresh to delete what was flown"
    if before is None:
        raise InputError(root, "a folder that holds a campaign's flights", wish)
    parts = (asked, held := read_folder_inputs(flown.folder, manifest))
    axes = [
        list(part.data.get("dispersions") or ()) for part in parts
    ]  # of the search, in their order
    limits = [*describe_requirement_changes(held.data, asked.data)]
    if limits and before["kind"] == "rare":
        found = f"a search with other requirements: {'; '.join(limits)}"
        raise InputError(root, found, "another folder (-o DIR): other limits are a new search")
    if held.identity != asked.identity or axes[0] != axes[1]:
        raise InputError(root, "a folder that holds a search of another campaign", wish)
    changes = [
        f"{key}: {before.get(key)} -> {value}"
        for key, value in settings.items()
        if before.get(key) != value
    ]
    if len(changes) == 1 and changes[0].startswith("flights:"):
        wish = "another folder (-o DIR): where a search goes depends on how many flights it has from its beginning"
    if changes:
        raise InputError(root, "a folder that holds another search: " + ", ".join(changes), wish)
    check_source(flown.folder, manifest, simulator)
