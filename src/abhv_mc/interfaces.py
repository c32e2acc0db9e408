"""Contracts at the package's boundaries: plans, simulators, executors and stores.

Callers never ask which implementation they have. A feature that needs more than a contract requires
asks for a capability, or calls :meth:`Simulator.check`. The contract of a report's section is
:class:`abhv_mc.topics.Topic`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import Metric
from abhv_mc.flight.outcome import Outcomes
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.user_code.source import UserSource

Recorded = Recording | int | None  # a number: ticks between samples of all channels


class Plan(Protocol):
    """Data that the flights of one system need besides their inputs, sent to worker processes.

    A folder stores it as arrays, which its simulator restores and checks. Plans without a mission
    are not stored.
    """

    @property
    def controller(self) -> str:
        """Name of the system in the campaign."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Columns of the flights' metrics."""

    @property
    def timing(self) -> Timing | None:
        """Control ticks of the mission, None if each flight has its own times."""

    @property
    def sources(self) -> tuple[UserSource, ...]:
        """Custom code of the plan, whose imported packages the manifest names."""


Arrays = dict[str, NDArray[Any]]


class StoredPlans(NamedTuple):
    """Plans in a results folder, read when they are restored."""

    root: Path  # has copies of input files at the paths of Simulator.pack
    # Returns the plan of a system that a function makes of its stored arrays; the function raises
    # KeyError, ValueError or TypeError for damaged ones. Raises InputError.
    read: Callable[[str, Callable[[Arrays], Any]], Any]
    read_campaign: Callable[[], Any]  # model of the folder's campaign file. Raises InputError.


Fly = Callable[[Any, Floats, Recorded], FlightBlock]  # of a Plan and rows [flight, parameter]


class Capabilities(NamedTuple):
    """Optional capabilities of a simulator."""

    can_rerun: bool = True  # flights can be computed, not only read
    is_repeatable: bool = True  # equal inputs give equal bits, so that no check is needed
    has_margins: bool = True  # stability margins in flights and in steady flight
    has_mission: bool = True  # common times, standard channels, a reference, a nominal flight


@dataclass(frozen=True)
class Engine:
    """Functions that make and run a plan; tests replace them by cheap ones.

    A flight depends on its plan and its row only, not on the block that it is in.
    """

    prepare: Any  # makes a plan of vehicle, mission and controller; None without these
    fly: Fly
    source: str  # hash of the code; rows of different code never share a folder
    # Makes the content of margins.json from the campaign and its plans.
    find_stability: Callable[[Any, Any], dict[str, Any]] | None = None
    is_stability_compiled: Callable[[], bool] = lambda: True
    checked: bool = False  # whether ``source`` is identity.code_hash() in every process that flies
    isolation: str = "threads"  # meaning of "auto"; processes need a ``fly`` that can be imported
    # Ends processes started by the engine, which report each lost flight.
    close: Callable[[], None] | None = None


class Simulator(Protocol):
    """Source of a campaign's flights: a program that computes them, or a table of results."""

    kind: str  # noun for a compared system, such as 'controller'
    systems: tuple[str, ...]  # names; the first has to meet the requirements
    outcomes: Outcomes  # possible ends of flights
    channels: tuple[Signal, ...]  # of histories; empty if flights return no history
    capabilities: Capabilities
    independent: bool | None  # whether flights are declared independent; None: by the sampling
    states_noise: bool  # whether flights are declared to have noise besides their inputs
    origin: str  # description of flights computed elsewhere; '' if ``fly`` computes them
    method: str  # sentence with the method's source for the page, or ''

    @property
    def engine(self) -> Engine:
        """Functions that run plans; not needed to read flights."""

    def check(self, feature: str) -> None:
        """Raise InputError if ``feature`` needs a vehicle, mission and controllers."""

    def find_code(self) -> list[tuple[Path, UserSource]]:
        """Return custom code with the file whose hash is trusted. Nothing is run."""

    def pack(self, take: Callable[[Path, str], str], copies: dict[str, Path]) -> dict[str, Any]:
        """Return the campaign file's entries with the paths of its files in a results folder.

        ``take`` copies a file, and the files that it names, to a path; ``copies`` are files by
        path.
        """

    def make_plans(self, names: Sequence[str]) -> Mapping[str, Plan]:
        """Return plans of some systems. Raise InputError."""

    def restore_plans(
        self, stored: StoredPlans, names: Sequence[str], trusted: bool = False
    ) -> Mapping[str, Plan]:
        """Return stored plans of systems. Raise InputError."""

    def add_margins(self, plans: Mapping[str, Any]) -> Mapping[str, Plan]:
        """Return plans with the stability margins that the campaign requests, empty without any."""

    def fit_plans(
        self, plans: Mapping[str, Any], names: Sequence[str], rows: Floats
    ) -> Mapping[str, Plan]:
        """Return plans for ``rows`` of these inputs. Raise InputError for invalid rows."""

    def find_stride(self, plan: Any, output: str) -> int:
        """Return ticks between samples of 'histories' or 'envelopes'. Raise InputError."""

    def find_warnings(self, plans: Mapping[str, Any]) -> list[str]:
        """Return warnings about the mission and unattainable parts of the campaign."""

    def find_reference(self, plan: Any) -> dict[str, Floats]:
        """Return columns of the mission's reference at the rate of the histories."""

    def time_of_flight(self, plans: Sequence[Any]) -> float | None:
        """Return the mean time of the last flights, s, which determines the size of blocks.

        It is 0 before any flight, and None if blocks have a fixed number of flights.
        """

    def prove(self, plan: Any, check: int = 0) -> Any:
        """Return the plan whose blocks are each followed by a proof that no answer is left over.

        ``check`` is the number of separate processes for its flights; 0 uses the campaign's.
        """

    def describe_events(self, system: str, events: Mapping[str, int]) -> list[str]:
        """Return warnings about the events of a system's flights (:attr:`FlightBlock.events`)."""

    def find_undeclared_reads(self, plan: Any, since: float) -> Iterable[str]:
        """Return files that flights read since a time (s) and the campaign does not name."""

    def describe_end(self, system: str, row: Floats, outcome: int) -> str:
        """Return sentences on the end of the flight of ``row`` [1, input]."""

    def find_lacking(self) -> list[InputError]:
        """Return errors for dispersions without effect in this simulator."""

    def try_out(self) -> Iterator[str]:
        """Start everything that needs no flight, and yield warnings. Raise InputError."""


class Executor(Protocol):
    """Resource that computes blocks of flights: worker processes, this process, a cluster.

    An executor must promise:

    - **Whole blocks.** :meth:`fly` returns every row of a block, in its order, as the simulator's
      ``Engine.fly`` computes it, or raises. Each process that computes signs its block with
      :func:`abhv_mc.execution.attestation.sign`, so that a worker with other code is rejected by
      name; :func:`abhv_mc.execution.worker.compute` does both.
    - **Threads.** Up to ``workers`` threads of the run call :meth:`fly` at the same time, with one
      block each. Blocks may finish in any order: no result depends on it.
    - **Crashes and hangs.** Flights that raise, end their process or exceed the time limit raise
      ``FlightLostError``. The run then computes the block again in smaller pieces, and records a
      flight that is lost alone as ``failed_to_run``. A lost worker is replaced by the executor.
    - **Failure of the machine.** ``UnusableError`` if no flight can be computed at all: the run
      stops, and completed flights are kept. Both errors are in :mod:`abhv_mc.execution.retry`.
    - **Interrupts.** :meth:`close` waits for no flight, leaves no process behind, and may be called
      while other threads are in :meth:`fly`, which then raises.
    - **Memory.** A block belongs to the caller once it is returned; the run has at most two for
      each worker.

    Retries, checks, the time between blocks and everything on disk are the run's.
    """

    @property
    def workers(self) -> int:
        """Number of blocks to compute at the same time."""

    def fly(self, plan: Any, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute the flights of ``rows`` [flight, parameter]."""

    def close(self) -> None:
        """End all workers."""


# Opens an executor for an engine and a limit of the processor time of 16 flights, s, or None.
OpenExecutor = Callable[[Engine, float | None], Executor]
# Connects to the scheduler at an address, before any file is written. Raises InputError. It is an
# entry point of the group ``abhv_mc.executors``, named after the scheme of the address.
Connect = Callable[[str], AbstractContextManager[OpenExecutor]]


class Store(Protocol):
    """Storage of campaign folders: a local folder, or an address.

    Every command works in a local folder, which the store fills and copies back. A store must
    promise:

    - **Whole files.** A reader gets each file as it was written, or not at all. ``manifest.json``
      names the SHA-256 of the others and is copied after them, so that a reader never misses a file
      that it names.
    - **One writer.** While one process is in :meth:`writing`, another one gets an InputError that
      names the first, on any host. The claim of a process that died ends by itself, by the store's
      clock if it has one; but on a file system without ``flock`` the lease of another host must
      be removed by hand. A local folder is locked by the command that writes, not by the store.
      A process whose claim was taken over is interrupted and writes nothing more.
    - **Nothing lost.** :meth:`writing` begins with the content of the store, so that a run resumes.
      What is in the local folder when it ends, by an error or an interrupt too, is in the store, or
      is kept in a local folder that ``StorageFullError`` names. During a run new files are copied
      every few seconds.
    - **Safety.** Names that lead out of the folder are rejected. No content of a folder is executed
      or unpickled.

    The package adds the following to each store: readers check every hash and name a damaged file;
    flights are evidence and are never replaced by those of other code or inputs; all other files
    (envelopes, histories, margins, pages) follow from them and are remade if they are missing.

    A package registers the class for the scheme of its addresses in the group ``abhv_mc.stores``;
    it is made of an
    :class:`abhv_mc.io.address.Address`.
    """

    @property
    def local(self) -> Path | None:
        """The folder, if it is on this machine."""

    def reading(self, pattern: str = "*") -> AbstractContextManager[Path]:
        """Give a local folder with the files whose names match ``pattern``. Raise InputError."""

    def writing(self, staging: Path | None = None) -> AbstractContextManager[Path]:
        """Give a local folder that is saved to the store; ``staging`` is the folder of a copy."""

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return the process that writes to the folder ``name``, and its size in bytes."""
