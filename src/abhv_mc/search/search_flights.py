"""A search's folder: the shape of a campaign's, with one block of flights for each batch that the search asked for.

The algorithms are functions of their seeds and of the values that they are given. So a search is resumed by running it
again: batches whose flights are stored are answered from their blocks, the others are flown. `abhv-mc replay`, `query`
and `export` read the folder like any campaign's.
"""

import contextlib
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.file.check import CheckedCampaign, read_campaign
from abhv_mc.campaign.file.resolve import ResolvedCampaign, read_held, refuse_changes, resolve_campaign
from abhv_mc.campaign.file.user_code import check_own_code
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.blocks import choose_batch
from abhv_mc.execution.cluster import connect_cluster
from abhv_mc.execution.engine import Engine, check_source
from abhv_mc.execution.executor import Executor, open_executor
from abhv_mc.execution.plans import restore_plan
from abhv_mc.execution.probe_dispersions import fly_probes
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.flights import DamagedFileError, FlightRows, block_path, flights_schema, read_block, write_block
from abhv_mc.folder.hashes import FileHashes, record_hashes, refuse_links
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import COMPLETE, INTERRUPTED, RUNNING, read_whole_manifest, write_manifest
from abhv_mc.folder.plans import write_plan
from abhv_mc.folder.provenance import find_commit, find_machine, find_versions
from abhv_mc.folder.samples import write_samples
from abhv_mc.io.documents import InputError, one_of
from abhv_mc.search.methods.evaluation import Floats
from abhv_mc.search.severity import not_computed, rank_distinct
from abhv_mc.search.space import Space, make_space
from abhv_mc.user_code.trust import trust

_DRAWN = 3  # flights whose histories a page shows
DRAWN_APART = 0.1  # of the range flown, rms over the parameters: so far apart they lie at least
_DRAWN_STEP = 0.1  # s


@dataclass(frozen=True)
class SearchRequest:
    """What every search is asked for."""

    campaign: Path
    out: Path
    controller: str | None = None  # the campaign's first by default
    seed: int | None = None  # the campaign's by default
    workers: int | None = None
    scheduler: str | None = None
    fresh: bool = False


def read_searched(path: Path, controller: str | None, seed: int | None) -> tuple[CheckedCampaign, str]:
    """The campaign and the controller that is searched. Raises InputError."""
    campaign = read_campaign(path, None, seed)
    for source in check_own_code(campaign):
        trust(source)  # his own file: he flies it
    controllers = campaign.model.controllers
    name = controller or next(iter(controllers))
    if name not in controllers:
        raise campaign.document.error(("controllers",), f"no controller '{name}'", one_of(controllers, name))
    return campaign, name


@dataclass(frozen=True)
class DrawnFlights:
    """Histories of some flights, after the nominal one."""

    numbers: tuple[int, ...]
    times: Floats  # [time] s
    history: NDArray[np.float32]  # [1 + flight, time, channel] in the order of CHANNELS; NaN after the end


class SearchFlights:
    """Flies the points of one search, or remembers them; made by :func:`open_search`."""

    def __init__(
        self,
        folder: CampaignFolder,
        campaign: CheckedCampaign,
        plan: FlightPlan,
        executor: Executor,
        threads: ThreadPoolExecutor,
        files: FileHashes,
    ) -> None:
        """``threads``: one more than the executor has workers, for the block that is being written."""
        self._threads, self._writing = threads, Future[Any]()
        self._writing.set_result(None)
        self.folder, self.campaign, self.plan, self.executor = folder, campaign, plan, executor
        self.files = files
        self.space: Space = make_space(campaign)
        self.seed = campaign.model.seed
        self.manifest = read_whole_manifest(folder.manifest)
        provenance = {"seed": str(self.seed), "campaign_hash": self.manifest["campaign_hash"]}
        self.schema = flights_schema(self.space.columns, provenance)
        self.blocks: list[FlightRows] = []
        self.remembered = 0  # flights that were stored already
        self.progress: Progress | None = None

    @property
    def flown(self) -> int:
        """Flights so far, those of earlier runs among them."""
        return self.blocks[-1].stop if self.blocks else 0

    @property
    def failed_to_run(self) -> int:
        """Flights that the machine could not compute."""
        return sum(int(not_computed(rows).sum()) for rows in self.blocks)

    def rows(self) -> FlightRows:
        """All flights so far."""
        names = self.space.columns
        samples = np.concatenate([block.samples for block in self.blocks])
        outcome = tuple(code for block in self.blocks for code in block.outcome)
        return FlightRows(
            self.plan.controller, 0, names, samples, outcome, np.concatenate([block.values for block in self.blocks])
        )

    def fly(self, values: Floats, common_seed: bool) -> FlightRows:
        """The flights of parameter values ``[flight, dimension]``; seeds are one for all, or each flight's own."""
        first = self.flown
        samples = self.space.complete(values, self.seed, None if common_seed else first)
        rows = self._remember(first, samples)
        if rows is None:
            rows = self._fly(first, samples)
            self._writing.result()  # the one before: raises what kept it from being written
            self._writing = self._threads.submit(write_block, self.folder.flights, rows, self.schema)
        else:
            self.remembered += len(samples)
        self.blocks.append(rows)
        if self.progress is not None:
            self.progress.add(len(samples))
        return rows

    def _remember(self, first: int, samples: Floats) -> FlightRows | None:
        """The stored block of exactly these samples; None where there is none, or the machine failed on some of it."""
        path = block_path(self.folder.flights, self.plan.controller, first, first + len(samples))
        with contextlib.suppress(DamagedFileError):
            if path.exists() and (self.files.holds(path) or not self.files.knows(path)):
                rows = read_block(path, self.space.columns)
                if not self.files.knows(path):  # it landed after the last manifest, and holds what it says
                    self.files.note(path, hash_file(path))
                if np.array_equal(rows.samples, samples) and not not_computed(rows).any():
                    return rows
        return None

    def _fly(self, first: int, samples: Floats) -> FlightRows:
        parameters = full_rows(self.space.columns, samples)
        share = choose_batch(len(samples), self.executor.workers)
        pieces = [parameters[start : start + share] for start in range(0, len(samples), share)]
        blocks = list(self._threads.map(lambda piece: self.executor.fly(self.plan, piece, None), pieces))
        outcome = tuple(Outcome(code).code for block in blocks for code in block.outcome)
        values = np.concatenate([np.column_stack([block.metrics, block.end_time]) for block in blocks])
        return FlightRows(self.plan.controller, first, self.space.columns, samples, outcome, values)

    def draw(self, severities: Floats) -> DrawnFlights:
        """Fly the nominal flight and the worst of the first ones again, with their histories.

        ``severities`` [flight] of the flights from 0 on; the worst ones that lie apart from each other are drawn.
        """
        rows = self.rows()
        numbers = rank_distinct(
            severities, rows.samples[: len(severities), : len(self.space.names)], _DRAWN, DRAWN_APART
        )
        nominal = full_rows((), np.empty((1, 0)))
        worst = full_rows(rows.names, rows.samples[numbers])
        every = max(1, round(_DRAWN_STEP / self.plan.timing.tick))
        block = self.executor.fly(self.plan, np.concatenate([nominal, worst]), every)
        return DrawnFlights(tuple(numbers), block.times, block.history)

    def finish(self, result: dict[str, Any]) -> None:
        """Drop blocks that belong to no batch, write what all flights are, and the result into the manifest."""
        self._writing.result()
        names = {
            block_path(self.folder.flights, block.controller, block.first, block.stop).name for block in self.blocks
        }
        for path in self.folder.flights.glob("*.parquet"):
            if path.name not in names:
                path.unlink()
                self.files.forget(path)
        rows = self.rows()
        provenance = {"seed": str(self.seed), "design": self.manifest["search"]["kind"]}
        write_samples(
            self.folder.samples, rows.names, rows.stop, lambda first, stop: rows.samples[first:stop], provenance
        )
        outcomes, counts = np.unique(np.array(rows.outcome), return_counts=True)
        self._write(
            COMPLETE,
            runs_planned=rows.stop,
            runs_done=rows.stop - self.failed_to_run,
            runs_failed=self.failed_to_run,
            controllers={
                self.plan.controller: {
                    "flights_done": rows.stop,
                    "outcomes": dict(zip(outcomes.tolist(), counts.tolist(), strict=True)),
                }
            },
            digest=str(rows.digest()),
            result=result,
        )

    def _write(self, state: str, **entries: Any) -> None:
        self.manifest |= {"state": state, **entries, "files": self.files.listed()}
        write_manifest(self.folder.manifest, self.manifest)


@contextlib.contextmanager
def open_search(
    request: SearchRequest, settings: dict[str, Any], flights: int, engine: Engine
) -> Iterator[SearchFlights]:
    """The folder of a search, locked, and its executor; ``settings`` are what the search's result depends on.

    Raises InputError before anything is written where something is wrong, or the folder holds anything else than the
    beginning of the same search.
    """
    with ExitStack() as stack:
        folder = CampaignFolder(request.out)
        campaign, name = read_searched(request.campaign, request.controller, request.seed)
        make_space(campaign)
        started = folder.manifest.exists()
        if not started:
            folder.refuse_strange(request.fresh)
        resolved = resolve_campaign(campaign)
        settings = {**settings, "controller": name}
        if started:
            stack.enter_context(hold_lock(folder.lock))
        refuse_links(folder.root)
        model = campaign.model

        def prepare() -> FlightPlan:
            return engine.prepare(model.vehicle, model.mission, model.controllers[name], name)

        if started and not request.fresh:
            held = _check_same(folder, settings, resolved, engine)
            files = stack.enter_context(record_hashes(folder.root, held or {}))
            if held is None:
                files.adopt()
            folder.sweep()
            if not all(files.holds(path) for path in (folder.campaign, *map(folder.root.joinpath, resolved.hashes))):
                resolved.write(folder)
            plan = restore_plan(folder, name, files, prepare)
        else:
            plan = prepare()
            fly_probes(campaign, {name: plan}, engine.fly, plan.timing.ticks)
            refuse_changes(campaign, resolved)
            if not started:
                stack.enter_context(hold_lock(folder.lock))
            folder.clear()
            files = stack.enter_context(record_hashes(folder.root, {}))
            resolved.write(folder)
            write_plan(folder.plan(name), plan)
            manifest = {
                "name": campaign.model.name,
                "state": RUNNING,
                "search": settings,
                "campaign_hash": resolved.identity,
                "inputs": resolved.hashes,
                "seed": campaign.model.seed,
                "source_hash": engine.source,
                "versions": find_versions(),
                "commit": find_commit(),
                "machine": find_machine() | {"device": engine.device},
                "files": files.listed(),
            }
            write_manifest(folder.manifest, manifest)
        cluster = stack.enter_context(connect_cluster(request.scheduler, engine)) if request.scheduler else None
        executor = stack.enter_context(open_executor(engine, campaign.model.execution, request.workers, cluster))
        threads = stack.enter_context(ThreadPoolExecutor(executor.workers + 1))
        search = SearchFlights(folder, campaign, plan, executor, threads, files)
        with Progress("flights", flights) as search.progress:
            try:
                yield search
            except KeyboardInterrupt:
                search._write(INTERRUPTED)
                raise


def _check_same(
    folder: CampaignFolder, settings: dict[str, Any], wanted: ResolvedCampaign, engine: Engine
) -> dict[str, str] | None:
    """Raise InputError where the folder does not hold the beginning of the same search; gives its files' hashes."""
    manifest = read_whole_manifest(folder.manifest)
    held = manifest.get("search")
    wish = "the same search, another folder (-o DIR), or --fresh to delete what was flown"
    if not isinstance(held, dict):
        raise InputError(folder.root, None, None, "a folder that holds a campaign's flights", wish)
    same = manifest.get("campaign_hash") == wanted.identity
    with contextlib.suppress(InputError):  # a damaged file, which is written anew
        before, now = (list(of.data.get("dispersions") or ()) for of in (read_held(folder, manifest), wanted))
        same = same and before == now  # also in their order: they are the axes of the search
    if not same:
        raise InputError(folder.root, None, None, "a folder that holds a search of another campaign", wish)
    changes = [f"{key}: {held.get(key)} -> {value}" for key, value in settings.items() if held.get(key) != value]
    if changes and changes[0].startswith("flights:") and len(changes) == 1:
        wish = "another folder (-o DIR): where a search goes depends on how many flights it has from its beginning"
    if changes:
        raise InputError(folder.root, None, None, "a folder that holds another search: " + ", ".join(changes), wish)
    check_source(folder, manifest, engine)
    return manifest.get("files")
