"""Contracts at the package's boundaries: plans, simulators, executors and stores.

Callers do not depend on a particular implementation. A feature that needs more than its contract
guarantees checks a capability, or calls :meth:`Simulator.check`. The contract of a report section
is :class:`abhv_mc.topics.Topic`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource
from abhv_mc.flights.blocks import FlightBlock, Recording
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import Outcome, simulator_outcomes
from abhv_mc.flights.signals import Signal
from abhv_mc.flights.timing import Timing
from abhv_mc.identity import code_hash
from abhv_mc.io.messages import InputError

Recorded = Recording | int | None  # an int is the number of control ticks between samples


class Plan(Protocol):
    """Data for the flights of one system, except their inputs; sent to worker processes.

    A results folder stores a plan as arrays, which its simulator restores and checks. Plans without
    a mission are not stored.
    """

    @property
    def controller(self) -> str:
        """Name of the controller or simulated system in the campaign."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics computed for each flight."""

    @property
    def timing(self) -> Timing | None:
        """Control ticks of the mission, or None if each flight has its own times."""

    @property
    def sources(self) -> tuple[UserSource, ...]:
        """Custom code of the plan; the manifest lists the packages that it imports."""

    @property
    def nominal(self) -> Floats:
        """Row [1, input] of nominal inputs, whose flight determines the time limit."""

    @property
    def must_run_in_child(self) -> bool:
        """Whether a flight could end or block its process, which must not be this one."""

    def lost_outcome(self, hung: bool) -> Outcome:
        """Return the outcome of a flight that twice crashed or hung (``hung``) its process."""


Arrays = dict[str, NDArray[Any]]


REMEDY = "the original file, or a new run with --fresh or in another folder (-o DIR)"


class StoredPlans(NamedTuple):
    """Plans stored in a results folder, which are read only when they are needed."""

    root: Path  # folder that contains the input files copied by Simulator.pack
    # Return the stored arrays of a system, converted by a function. Raise InputError if the
    # function raises KeyError, ValueError or TypeError, which indicate damaged arrays.
    read: Callable[[str, Callable[[Arrays], Any]], Any]
    read_campaign: Callable[[], Any]  # return the campaign model, or raise InputError


Fly = Callable[[Any, Floats, Recorded], FlightBlock]  # arguments: plan, rows of inputs, recording
# Function of rows [flight, input] that returns margins [flight, margin], in the order of
# MARGIN_NAMES, and the reasons for missing ones.
TrimMargins = Callable[[Floats], tuple[Floats, list[str]]]
# Campaigns of at most this number of flights run in threads: starting worker processes would take
# longer than the flights.
FEW_FLIGHTS = 512


class Capabilities(NamedTuple):
    """Optional capabilities of a simulator."""

    can_rerun: bool = True  # The simulator can compute flights, not only read them.
    # Equal inputs give bit-identical results; otherwise, first flights test the repeatability.
    is_repeatable: bool = True


# Defaults of an engine, which is sent to other processes, are functions of a module.
def _yes() -> bool:
    return True


def _say_nothing(_process: int | None) -> str:
    return ""


def _do_nothing() -> None: ...


@dataclass(frozen=True)
class Engine:
    """Functions that make and run a plan; tests replace them with fast functions.

    A flight depends only on its plan and its row of inputs, not on the other flights of a block.
    """

    prepare: Any  # function that makes a plan from vehicle, mission and controller files, or None
    fly: Fly
    source: str  # hash of the code, which must be the same for all flights of a results folder
    # Return the content of margins.json for a campaign and its plans.
    find_stability: Callable[[Any, Any], dict[str, Any]] | None = None
    is_stability_compiled: Callable[[], bool] = _yes
    checked: bool = False  # whether identity.code_hash() must equal ``source`` in each worker
    isolation: str = "threads"  # value that "auto" selects; "processes" needs an importable ``fly``
    # Return a clause on the last flight of a crashed process, by its number, or ''.
    describe_crash: Callable[[int | None], str] = _say_nothing
    # End the processes started by the engine.
    close: Callable[[], None] = _do_nothing
    # Whether ``fly`` records lost flights itself; otherwise the run computes them again.
    records_lost: bool = False


@dataclass(frozen=True, eq=False)  # Plans are keys of caches by identity.
class SystemPlan:
    """Plan of a simulator without a mission: each flight has its own times."""

    controller: str
    metrics: tuple[Metric, ...]
    inputs: tuple[str, ...]  # names of the columns of ``rows``
    nominal: Floats  # [1, input]
    settings: Mapping[str, Any]  # settings of the system in the campaign file
    channels: tuple[Signal, ...] = ()

    timing: ClassVar = None
    sources: ClassVar[tuple[UserSource, ...]] = ()
    must_run_in_child: ClassVar = False

    @property
    def metric_count(self) -> int:
        """Number of metrics of a flight."""
        return len(self.metrics)

    def lost_outcome(self, hung: bool) -> Outcome:
        """Return ``failed_to_run``."""
        return Outcome.FAILED_TO_RUN


class Mission(Protocol):
    """Questions that only the simulator of a vehicle on a mission answers.

    All flights then have the same times, reference and nominal flight.
    """

    @property
    def reference_channels(self) -> tuple[Signal, ...]:
        """Channels of the reference trajectory."""

    def find_reference(self, plan: Any) -> dict[str, Floats]:
        """Return the reference trajectory as columns, at the rate of the histories."""

    def find_transients(self) -> tuple[tuple[float, float], ...]:
        """Return the time intervals (s) of transients, which some metrics exclude."""

    def add_margins(self, plans: Mapping[str, Any]) -> Mapping[str, Plan]:
        """Return plans that also compute the requested margins; empty if none are requested."""

    def find_compiler(self) -> str:
        """Return the name of the interface that compiled the flight code."""

    def trim_margins(self, names: Sequence[str]) -> Mapping[str, TrimMargins]:
        """Return, for each named system, a function that computes margins of dispersed trims.

        Raise InputError if margins cannot be computed.
        """


class Simulator(ABC):
    """Source of a campaign's flights: a program that computes them, or a table of results.

    A simulator defines :meth:`make_plans` and :meth:`fly`. The defaults of all other members are
    those of a simulator without a mission, without code of the campaign, and with repeatable
    flights. A package registers the class in the group ``abhv_mc.simulators``.
    """

    kind: str = "system"  # noun for a compared system, such as 'controller'
    capabilities: Capabilities = Capabilities()
    mission: Mission | None = None
    independent: bool | None = None  # declared independence; None: the sampling design determines
    states_noise: bool = False  # whether the flights are declared to have noise that is no input
    origin: str = ""  # source of flights computed elsewhere; '' if ``fly`` computes them
    method: str = ""  # sentence on the method and its source for the report page, or ''

    def __init__(self, experiment: Any) -> None:
        """Prepare the simulator of an :class:`abhv_mc.campaign.file.experiment.Experiment`."""
        self.experiment, model = experiment, experiment.model
        self.systems = tuple(model.systems)
        self.outcomes = simulator_outcomes(model.outcomes)
        # channels of histories; empty if flights return none
        self.channels = model.returned_channels

    @abstractmethod
    def make_plans(self, names: Sequence[str]) -> Mapping[str, Any]:
        """Return the plans of the named systems. Raise InputError if an input is invalid."""

    @staticmethod
    @abstractmethod
    def fly(plan: Any, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute the flights of ``rows`` [flight, input], in any process."""

    def plan_of(self, name: str) -> SystemPlan:
        """Return the plan of a system with the entries of the campaign file."""
        experiment = self.experiment
        inputs = tuple(record.name for record in experiment.parameters.records)
        nominal = np.array([experiment.parameters.nominal_of(inputs)])
        settings = experiment.model.systems[name]
        return SystemPlan(
            name, experiment.measured, inputs, nominal, settings, channels=self.channels
        )

    @cached_property
    def engine(self) -> Engine:
        """Functions that make and run plans; not needed to read stored flights.

        The code on which flights depend is that of abhv_mc and of all registered simulators.
        """
        is_large = self.experiment.runs * len(self.systems) > FEW_FLIGHTS
        isolation = "processes" if is_large else "threads"
        return Engine(None, self.fly, code_hash(), checked=True, isolation=isolation)

    def check(self, feature: str) -> None:
        """Raise InputError if ``feature`` needs a vehicle, mission and controllers."""
        raise self.experiment.document.error(
            (),
            f"this campaign has a custom simulator, which does not support {feature}",
            "a campaign with vehicle, mission and controllers",
        )

    def find_code(self) -> list[tuple[Path, UserSource]]:
        """Return each piece of custom code and its file, without running the code."""
        return []

    def pack(self, take: Callable[..., str], copies: dict[str, Path]) -> dict[str, Any]:
        """Return the entries of the campaign file with paths inside a results folder.

        ``take(file, path, references)`` copies a file, and the files to which it refers, to a path
        in the folder, and returns the path of the copy. ``copies``
        maps each path in the folder to the file that is copied there.
        """
        return {"systems": self.experiment.model.systems}

    def restore_plans(
        self, stored: StoredPlans, names: Sequence[str], trusted: bool = False
    ) -> Mapping[str, Any]:
        """Return the stored plans of the named systems. Raise InputError if one is invalid."""
        return self.make_plans(names)

    def fit_plans(
        self, plans: Mapping[str, Any], names: Sequence[str], rows: Floats
    ) -> Mapping[str, Any]:
        """Return plans for ``rows`` [flight, input] of the inputs ``names``.

        Raise InputError if a row is invalid.
        """
        return plans

    def find_stride(self, plan: Any, output: str) -> int:
        """Return the number of control ticks between samples of 'histories' or 'envelopes'.

        Raise InputError if the requested rate is invalid.
        """
        return 1

    def find_warnings(self, plans: Mapping[str, Any]) -> list[str]:
        """Return warnings on the plans, beside those on requirements and dispersions."""
        return []

    def time_of_flight(self, plans: Sequence[Any]) -> float | None:
        """Return the mean computing time of recent flights, s, which determines block sizes.

        The result is 0 before the first flight, and None if blocks have a fixed number of flights.
        """
        return None

    def prove(self, plan: Any, check: int = 0) -> Any:
        """Return a plan that checks after each block that the simulator sent no extra reply.

        ``check`` is the number of a separate process for the flights; 0 selects the processes of
        the campaign, and -1 a new process for each flight.
        """
        return plan

    def describe_events(self, system: str, events: Mapping[str, int]) -> list[str]:
        """Return warnings about events in a system's flights (``FlightBlock.events``)."""
        return []

    def find_undeclared_reads(self, plan: Any, since: float) -> Iterable[str]:
        """Return undeclared files that flights have read since the time ``since`` (s)."""
        return ()

    def describe_end(self, system: str, row: Floats, outcome: int) -> str:
        """Return sentences that explain how the flight with inputs ``row`` [1, input] ended."""
        return self.outcomes.sentences[self.outcomes.codes[outcome]]

    def find_lacking(self) -> list[InputError]:
        """Return errors for dispersions that have no effect in this simulator."""
        return []

    def try_out(self) -> Iterator[str]:
        """Start the simulator without simulating flights, and yield warnings.

        Raise InputError if the start fails.
        """
        yield from ()


class Executor(Protocol):
    """Resource that computes blocks of flights, such as worker processes or a cluster.

    An executor must promise:

    - **Whole blocks.** :meth:`fly` returns every row of a block, in its order, as the simulator's
      ``Engine.fly`` computes it, or raises an exception. Each process signs the blocks that it
      computes with :func:`abhv_mc.execution.attestation.sign`, so that a worker with other code is
      rejected with an error that names the worker. The function
      :func:`abhv_mc.execution.worker.compute` computes and signs a block.
    - **Threads.** Up to ``workers`` threads of the run call :meth:`fly` at the same time, with one
      block each. Blocks may finish in any order; no result depends on the order.
    - **Crashes and hangs.** If flights raise an exception, end their process or exceed the time
      limit, :meth:`fly` raises ``FlightLostError``. The run then computes the block again in
      smaller pieces, and records each flight that is lost even when computed alone as
      ``failed_to_run``. If the error states that the process of a flight alone ended
      (``process=True``) or hung (``hung=True``), a flight with a control law in C or an FMU gets
      the outcome ``law_crashed`` or ``law_hung``. The executor starts a new worker in place of a
      lost one. An external simulator records its lost flights itself; if a block is lost, the run
      computes the block once more, and then stops.
    - **Failure of the machine.** If no worker can be started, :meth:`fly` raises ``UnusableError``:
      the run stops, and completed flights are kept. The run raises the same error if no flight of a
      large block can be computed. Both errors are in :mod:`abhv_mc.execution.retry`.
    - **Interrupts.** :meth:`close` does not wait for flights, leaves no process behind, and may be
      called while other threads are in :meth:`fly`, which then raises an exception.
    - **Memory.** A returned block belongs to the caller; the run holds at most two blocks for each
      worker.

    The run handles retries, checks and files.
    """

    @property
    def workers(self) -> int:
        """Number of blocks to compute at the same time."""

    def fly(self, plan: Any, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute the flights of ``rows`` [flight, parameter]."""

    def close(self) -> None:
        """End all workers."""


# Function that opens an executor for an engine and a time limit for 16 flights (s). If the limit is
# None, the executor chooses one.
OpenExecutor = Callable[[Engine, float | None], Executor]
# Function that connects to the scheduler at an address before any file is written; it raises
# InputError if the connection fails.
Connect = Callable[[str], AbstractContextManager[OpenExecutor]]


class Store(Protocol):
    """Storage of campaign folders: a local folder, or a remote store with an address.

    Every command works in a local folder, which the store fills and copies back to the address. A
    store must promise:

    - **Whole files.** A reader gets each file as it was written, or not at all. ``manifest.json``
      lists the SHA-256 of the other files and is copied last, so that a reader never misses a
      listed file.
    - **One writer.** While one process is in :meth:`writing`, any other process, on any host, gets
      an InputError that names the writer. The claim of a process that died expires, by the clock
      of the store if the store has a clock. On a file system without ``flock``, however, the lease
      of another host or container must be removed by hand. A local folder is locked by the command
      that writes, not by the store. A process whose claim was taken over is interrupted and writes
      nothing more.
    - **No loss.** :meth:`writing` begins with the content of the store, so that an interrupted run
      can resume. When the context ends, even by an error or an interrupt, the content of the local
      folder is copied to the store, or kept in a local folder that ``StorageFullError``
      (:mod:`abhv_mc.folder.layout`) names.
      During a run, new files are copied every few seconds.
    - **Safety.** File names that point outside the folder are rejected. No content of a folder is
      executed or unpickled.

    For every store, abhv-mc adds the following guarantees. Readers check all hashes and name a
    damaged file. Stored flights are never replaced by flights of other code or inputs. All other
    files (envelopes, histories, margins, pages) are derived from the flights and are created again
    if they are missing.

    A package registers the class for the scheme of its addresses in the group ``abhv_mc.stores``;
    the constructor takes an :class:`abhv_mc.io.address.Address`.
    """

    @property
    def local(self) -> Path | None:
        """Local folder of the campaign, or None if the store is remote."""

    def reading(self, pattern: str = "*") -> AbstractContextManager[Path]:
        """Provide a local folder with the files that match ``pattern``, in which '*' matches '/'.

        Raise InputError if a remote store cannot be read.
        """

    def writing(self, staging: Path | None = None) -> AbstractContextManager[Path]:
        """Provide a local folder that is saved to the store.

        ``staging`` is the parent of the local folder of a remote store, by default the temporary
        folder of the system. Content without ``manifest.json`` is not saved.
        """

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return the process that writes to the folder ``name``, if any, and the size in bytes."""
