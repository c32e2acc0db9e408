"""Simulation of rows of inputs by executors: worker processes, this process, or packages.

Worker processes are the default for many flights and for custom code, because a crash in compiled
code ends the whole process. Threads start one second faster, but a crash then ends the campaign,
and only exceptions are handled. The option ``--scheduler`` selects the executor of an installed
package. The number of results that wait for the disk is limited.
"""

import contextlib
import multiprocessing
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import PROCESSES, THREADS, Execution
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.entry_points import EXECUTORS, find_entry_points
from abhv_mc.execution.attestation import Attestation, Check, sign
from abhv_mc.execution.retry import (
    FlightLostError,
    UnusableError,
    choose_batch,
    fly_in_batches,
    fly_with_retries,
)
from abhv_mc.flights.blocks import FlightBlock, Recording, join_blocks
from abhv_mc.folder.flights import END_TIME, SampleReader
from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.folder.opening import find_stored_plans
from abhv_mc.identity import count_cores
from abhv_mc.interfaces import Engine, Executor, Fly, OpenExecutor, Plan, Recorded, Simulator
from abhv_mc.io.messages import InputError, check_names, one_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class FlightRunner:
    """Executor with retries of lost flights and checks of blocks."""

    fly: Fly  # thread-safe; flights that cannot be computed get the outcome ``failed_to_run``
    workers: int  # number of simultaneous calls of ``fly``

    def fly_parallel(self, plan: Any, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        """Simulate ``parameters`` [flight, parameter] on all workers."""
        share = choose_batch(len(parameters), self.workers)
        pieces = [parameters[start : start + share] for start in range(0, len(parameters), share)]
        with open_threads(self.workers) as threads:
            return join_blocks(
                list(threads.map(lambda piece: self.fly(plan, piece, recorded), pieces))
            )


@contextlib.contextmanager
def open_threads(number: int) -> Iterator[ThreadPoolExecutor]:
    """Yield a thread pool that does not wait for its flights after an interrupt.

    The executor of the flights ends the flights in progress.
    """
    threads = ThreadPoolExecutor(number)
    try:
        yield threads
    except BaseException:
        threads.shutdown(wait=False, cancel_futures=True)
        raise
    threads.shutdown()


@contextlib.contextmanager
def connect(address: str | None) -> Iterator[OpenExecutor | None]:
    """Yield the function that opens executors on a scheduler, or None if no address is given.

    The scheme of the address selects the package that connects to the scheduler. Raise InputError
    if no installed package supports the scheme.
    """
    if address is None:
        yield None
        return
    scheme, separator, _ = address.partition("://")
    entries = find_entry_points(EXECUTORS)
    entry = entries.get(scheme if separator else "tcp")
    if entry is None:
        expected = one_of([f"{name}://" for name in entries], f"{scheme}://")
        raise InputError("--scheduler", f"no scheduler at '{address}'", expected)
    with entry.load()(address) as opened:
        yield opened


def find_isolation(engine: Engine, execution: Execution) -> str:
    """Return the isolation of flights, 'processes' or 'threads'."""
    return engine.isolation if execution.isolation == "auto" else execution.isolation


@contextlib.contextmanager
def open_executor(
    engine: Engine,
    execution: Execution,
    workers: int | None,
    scheduler: OpenExecutor | None = None,
    check_workers: bool = False,
) -> Iterator[FlightRunner]:
    """Yield the executor selected by the campaign, or the executor of a scheduler.

    The context closes the executor. With ``check_workers``, one flight of each worker is computed
    again in this process, and all bits are compared.
    """
    number = workers or execution.workers or count_cores()
    isolation = find_isolation(engine, execution)
    if isolation == PROCESSES and multiprocessing.current_process().daemon:
        if execution.isolation == PROCESSES:  # Daemonic processes cannot start child processes.
            raise InputError(
                "execution",
                "a process of multiprocessing.Pool cannot start worker processes",
                "'isolation: threads', or concurrent.futures.ProcessPoolExecutor",
            )
        isolation = THREADS
    attestation = Attestation(engine, check_workers)
    executor: Executor
    check: Check | None = attestation.check
    if scheduler is not None:
        executor = scheduler(engine, execution.flight_time_limit)
        number = workers or executor.workers
    elif isolation == PROCESSES:
        # Import late, because the module loads what the vehicle's flights need.
        from abhv_mc.execution.worker_processes import WorkerPool

        executor = WorkerPool(
            engine.fly, number, execution.flight_time_limit, engine.describe_crash
        )
    else:
        executor, check = _ThisProcess(engine, number), None

    def fly(plan: Any, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        def attempt(rows: Floats, recorded: Recorded) -> FlightBlock:
            block = executor.fly(plan, rows, recorded)
            if engine.records_lost:
                return attestation.check_code(block)
            return block if check is None else check(plan, rows, block)

        if not engine.records_lost:
            return fly_with_retries(attempt, plan, parameters, recorded)
        try:
            return attempt(parameters, recorded)
        except FlightLostError:  # The machine, not a flight, caused this error.
            try:
                return attempt(parameters, recorded)
            except FlightLostError as error:
                raise UnusableError(str(error)) from None

    with contextlib.closing(executor):
        yield FlightRunner(fly, number)


class _ThisProcess:
    """Executor that simulates flights in the calling thread."""

    def __init__(self, engine: Engine, workers: int) -> None:
        self._engine, self.workers = engine, workers

    def fly(self, plan: Any, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute a block. Raise FlightLostError if a flight raises an exception."""
        if self._engine.records_lost:
            return sign(self._engine.fly(plan, rows, recorded))
        try:
            return sign(fly_in_batches(self._engine.fly, plan, rows, recorded))
        except Exception as error:
            raise FlightLostError(f"{type(error).__name__}: {error}") from error

    def close(self) -> None:
        """End the processes started by the simulator."""
        self._engine.close()


T = TypeVar("T")


def work_ahead(
    workers: int, work: Callable[..., T], calls: Iterable[tuple[Any, ...]]
) -> Generator[T, None, None]:
    """Yield the result of ``work`` for each of ``calls``, in order of completion.

    At any time, at most two results per worker are in progress or finished but unused. Without
    this limit, workers that are faster than the disk would fill the memory with finished blocks.
    Closing the generator ends all waiting workers.
    """
    from joblib import Parallel, delayed

    slots = threading.Semaphore(2 * workers)
    closed = threading.Event()

    def call(arguments: tuple[Any, ...]) -> T:
        slots.acquire()
        if closed.is_set():
            slots.release()  # Without the slot, the next thread cannot end.
            raise RuntimeError("the results are no longer needed")
        return work(*arguments)

    pool = Parallel(
        n_jobs=workers,
        backend="threading",
        return_as="generator_unordered",
        pre_dispatch="2*n_jobs",
    )
    results = pool(delayed(call)(arguments) for arguments in calls)
    try:
        for result in results:
            yield result
            slots.release()
    finally:
        closed.set()
        slots.release()
        with warnings.catch_warnings():
            # An interrupt leaves unused results, about which joblib warns.
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def check_source(folder: CampaignFolder, manifest: Manifest, simulator: Simulator) -> None:
    """Raise InputError if another version of the code computed the flights of a folder."""
    flown, now = manifest.source_hash, simulator.engine.source
    if flown != now:
        raise InputError(
            folder.root,
            f"another version of the program computed the flights (source {flown}, now {now})",
            "the same version, another folder (-o DIR), or --fresh",
        )


def make_ready(
    experiment: Experiment, plans: Mapping[str, Plan], margins: bool = False
) -> Experiment:
    """Return the experiment with ``plans`` as its systems.

    With ``margins``, plans that compute margins are added if the campaign requests margins. Raise
    InputError if margins cannot be computed.
    """
    mission = experiment.simulator.mission
    margin_plans = mission.add_margins(plans) if margins and mission else {}
    return replace(
        experiment,
        systems={name: System(plan, margin_plans.get(name)) for name, plan in plans.items()},
    )


def with_proofs(experiment: Experiment, check: int = 0) -> Experiment:
    """Return the experiment with the plans of :meth:`Simulator.prove`."""
    systems = {
        name: system._replace(plan=experiment.simulator.prove(system.plan, check=check))
        for name, system in experiment.systems.items()
    }
    return replace(experiment, systems=systems)


def simulate(
    experiment: Experiment,
    system: str,
    rows: Floats,
    recording: Recorded = None,
    executor: Fly | None = None,
    *,
    margins: bool = False,
) -> FlightBlock:
    """Simulate ``rows`` [flight, input] in SI units, with columns ``experiment.inputs``.

    Parameters without a column are nominal. ``recording`` is a Recording, or the number of control
    ticks between samples of all channels. ``executor`` runs the flights, by default in the calling
    thread. ``margins`` adds stability margins if the experiment has plans that compute margins.
    """
    ready = experiment.systems[system]
    plan = ready.with_margins or ready.plan if margins else ready.plan
    return (executor or experiment.simulator.engine.fly)(plan, experiment.rows(rows), recording)


def open_flown(
    folder: CampaignFolder, controllers: Iterable[str], trusted: bool = False
) -> Experiment:
    """Check a results folder and return an experiment that can re-run the folder's flights.

    Raise InputError for an unknown controller, a damaged file or untrusted code.
    """
    read_checked(folder, [folder.campaign, folder.samples, *folder.input_files()])
    experiment = read_folder_campaign(folder)
    flown = list(read_manifest(folder.manifest).controllers)
    names = list(controllers)
    check_names(folder.root, names, flown, "controller")
    for name in names:
        read_checked(folder, [folder.plan(name)])
    plans = experiment.simulator.restore_plans(find_stored_plans(folder), names, trusted)
    return replace(make_ready(experiment, plans), columns=SampleReader(folder.samples).names)


def simulate_table(
    experiment: Experiment,
    inputs: "pd.DataFrame",
    controllers: Sequence[str] | None = None,
    channels: Sequence[str] = (),
    engine: Engine | None = None,
) -> "xr.Dataset":
    """Simulate each row of a table with each controller; see :func:`abhv_mc.simulate`.

    Raise InputError if xarray is not installed or an argument is invalid.
    """
    try:
        import xarray as xr
    except ImportError:
        raise InputError("simulate", "xarray is not installed", "pip install xarray") from None
    names = tuple(map(str, inputs.columns))
    experiment = replace(experiment, engine=engine)
    simulator = experiment.simulator
    channel_index = {
        channel.name: i
        for i, channel in enumerate(experiment.channels)
        if simulator.mission  # All flights then have the same sample times.
    }
    systems = experiment.controllers if controllers is None else tuple(controllers)
    check_names("inputs", names, experiment.parameters.dispersible)
    check_names("controllers", systems, experiment.controllers)
    check_names("channels", channels, tuple(channel_index))
    try:
        rows = inputs.to_numpy(np.float64)
    except (TypeError, ValueError):
        raise InputError(
            "inputs",
            "the table has entries that are not numbers",
            "numbers in SI units, or in the units of the inputs",
        ) from None
    if np.isnan(rows).any() or not (rows.size or len(rows)) or not systems:
        raise InputError(
            "inputs",
            "the table is empty or has empty cells",
            "a number for each flight and input",
        )
    plans = simulator.fit_plans(simulator.make_plans(systems), names, rows)
    recording = None
    if channels:
        every = simulator.find_stride(next(iter(plans.values())), "histories")
        recording = Recording(every, tuple(channel_index[name] for name in channels))
    ready = replace(make_ready(experiment, plans), columns=names)
    with open_executor(simulator.engine, experiment.model.execution, None) as executor:
        blocks = [simulate(ready, name, rows, recording, executor.fly_parallel) for name in systems]
    axes = ("controller", "flight")
    columns = [np.column_stack([block.metrics, block.end_time]).T for block in blocks]
    variables: dict[str, Any] = {
        signal.name: (axes, np.stack([values[i] for values in columns]), {"units": signal.unit})
        for i, signal in enumerate((*experiment.measured, END_TIME))
    }
    for i, name in enumerate(channels):
        history = np.stack([block.history[:, :, i] for block in blocks])
        units = {"units": experiment.channels[channel_index[name]].unit}
        variables[name] = (*axes, "time"), history, units
    outcomes = [experiment.outcomes.of(block.outcome) for block in blocks]
    coordinates = {"controller": list(systems), "flight": inputs.index.to_numpy()}
    if channels:
        coordinates["time"] = blocks[0].times
    dataset = xr.Dataset({"outcome": (axes, np.array(outcomes, object)), **variables}, coordinates)
    return dataset.assign_attrs(campaign=experiment.name)
