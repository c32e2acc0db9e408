"""The contracts at the package's boundaries.

What stands above a contract never asks which implementation it has: a feature that needs more than the contract
promises to all asks for a capability, or calls :meth:`Simulator.check`. The contract of a section of the report is
:class:`abhv_mc.topics.Topic`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from abhv_mc.array_types import Floats
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import Metric
from abhv_mc.flight.outcome import Outcomes
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.user_code.source import UserSource

Recorded = Recording | int | None  # a number: samples of every channel so many ticks apart


class Plan(Protocol):
    """Everything that the flights of one system need apart from their inputs; it travels to worker processes.

    A folder stores it as arrays, which its simulator rebuilds and checks; where there is no mission, not at all.
    """

    @property
    def controller(self) -> str:
        """Name of the system in the campaign."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Columns of the flights' metrics."""

    @property
    def timing(self) -> Timing | None:
        """Control ticks of the mission; None where each flight has times of its own."""

    @property
    def sources(self) -> tuple[UserSource, ...]:
        """The user's code in it whose imported packages the manifest names."""


Fly = Callable[[Any, Floats, Recorded], FlightBlock]  # of a Plan and rows [flight, parameter]


class Capabilities(NamedTuple):
    """What a simulator can do beyond what each of them promises."""

    can_rerun: bool = True  # flights can be computed, not read alone
    is_repeatable: bool = True  # equal inputs give equal bits: nobody needs to compute them twice
    has_margins: bool = True  # stability margins, of flights and in steady flight
    has_mission: bool = True  # equal times, the program's channels, a reference, a nominal flight


@dataclass(frozen=True)
class Engine:
    """How a plan is made and flown; tests put cheap ones in the place of the compiled flight.

    Flights depend on their plan and their row alone, whatever block they are in.
    """

    prepare: (
        Any  # a plan of vehicle, mission and controller; None where a simulator has none of these
    )
    fly: Fly
    source: str  # hash of the code: rows of two of them never share a folder
    # What margins.json holds, of the campaign and its plans.
    find_stability: Callable[[Any, Any], dict[str, Any]] | None = None
    checked: bool = False  # whether ``source`` is identity.code_hash() in every process that flies
    isolation: str = "threads"  # where "auto" flies; processes need a ``fly`` that can be imported
    # Ends the processes that it starts itself; they account for each flight that is lost.
    close: Callable[[], None] | None = None


class Simulator(Protocol):
    """What computes the flights of one campaign, or has computed them."""

    kind: str  # what is compared, in a word
    systems: tuple[str, ...]  # what is compared, by name; the first has to meet the requirements
    outcomes: Outcomes  # how flights may end
    channels: tuple[Signal, ...]  # what histories hold; none where flights return no history
    capabilities: Capabilities
    independent: (
        bool | None
    )  # whether flights are stated to be independent; None: the sampling decides
    states_noise: bool  # whether flights are stated to have noise that no input brings
    origin: str  # of flights that were computed elsewhere, in words; '' where ``fly`` computes them
    method: str  # sentence with the method's source, for the page; '' without

    @property
    def engine(self) -> Engine:
        """How plans are flown; reading flights asks for none."""

    def check(self, feature: str) -> None:
        """Raise InputError if ``feature`` needs a vehicle, mission and controllers that there are none of."""

    def find_code(self) -> list[tuple[Path, UserSource]]:
        """The user's code with the file that it is trusted by. Nothing is run."""

    def pack(self, take: Callable[[Path, str], str], copies: dict[str, Path]) -> dict[str, Any]:
        """Entries of the campaign file with the places of its files in a results folder.

        ``take`` copies a file, and those that it names, to a place; ``copies`` are files by place.
        """

    def make_plans(self, names: Sequence[str]) -> Mapping[str, Plan]:
        """Plans of some systems. Raises InputError."""

    def restore_plans(
        self, root: Path, names: Sequence[str], trusted: bool = False
    ) -> Mapping[str, Plan]:
        """Plans of some systems of the folder ``root``, without a design. Raises InputError."""

    def add_margins(self, plans: Mapping[str, Any]) -> Mapping[str, Plan]:
        """Plans with the stability margins that the campaign asks for; empty where it asks for none."""

    def fit_plans(
        self, plans: Mapping[str, Any], names: Sequence[str], rows: Floats
    ) -> Mapping[str, Plan]:
        """Plans for ``rows`` of these inputs. Raises InputError for rows that cannot be flown."""

    def find_stride(self, plan: Any, kept: str) -> int:
        """Ticks between samples of the 'histories' or 'envelopes'. Raises InputError for an odd rate."""

    def find_warnings(self, plans: Mapping[str, Any]) -> list[str]:
        """Sentences on the mission, and on what of the campaign cannot come out."""

    def find_reference(self, plan: Any) -> dict[str, Floats]:
        """Columns of the mission's reference at the rate of the histories."""

    def time_of_flight(self, plans: Sequence[Any]) -> float | None:
        """Mean time of the last flights, s, by which blocks are cut; 0 before any, None: by their number."""

    def prove(self, plan: Any, check: int = 0) -> Any:
        """Return the plan whose blocks are each followed by a proof that no answer is left over.

        ``check``: number of the processes that its flights have for themselves; 0: those of the campaign.
        """

    def describe_events(self, system: str, events: Mapping[str, int]) -> list[str]:
        """Return warnings about the events of a system's flights (:attr:`FlightBlock.events`)."""

    def find_undeclared_reads(self, plan: Any, since: float) -> Iterable[str]:
        """Return files that flights read since a time (s) and the campaign does not name."""

    def describe_end(self, system: str, row: Floats, outcome: int) -> str:
        """Sentences on the end of the flight of ``row`` [1, input]."""

    def find_lacking(self) -> list[InputError]:
        """Dispersions of what the simulator has nothing of, which would change no flight."""

    def try_out(self) -> Iterator[str]:
        """Start what can be started without a flight, and yield warnings. Raises InputError."""


class Executor(Protocol):
    """Place where blocks of flights are computed: worker processes, this process, a cluster.

    An executor must promise:

    - **Whole blocks.** :meth:`fly` returns every row of a block, in its order, as the simulator's ``Engine.fly``
      computes it, or raises. Each process that computes signs its block with
      :func:`abhv_mc.execution.attestation.sign`, so that a worker with other code is rejected by name;
      :func:`abhv_mc.execution.worker.compute` does both.
    - **Threads.** Up to ``workers`` threads of the run call :meth:`fly` at the same time, with one block each. Blocks
      may finish in any order: no result depends on it.
    - **Crashes and hangs.** Flights that raise, end their process or exceed the time limit raise ``FlightLostError``.
      The run then computes the block again in smaller pieces, and records a flight that is lost alone as
      ``failed_to_run``. A lost worker is replaced by the executor.
    - **Failure of the machine.** ``UnusableError`` if no flight can be computed at all: the run stops, and completed
      flights are kept. Both errors are in :mod:`abhv_mc.execution.retry`.
    - **Interrupts.** :meth:`close` waits for no flight, leaves no process behind, and may be called while other threads
      are in :meth:`fly`, which then raises.
    - **Memory.** A block belongs to the caller once it is returned; the run has at most two for each worker.

    Retries, checks, the time between blocks and everything on disk are the run's.
    """

    @property
    def workers(self) -> int:
        """Blocks to have under way."""

    def fly(self, plan: Any, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute the flights of ``rows`` [flight, parameter]."""

    def close(self) -> None:
        """End all workers."""


# Opens an executor: of an engine, and the processor time (s) that 16 flights may take, None where the file sets none.
OpenExecutor = Callable[[Engine, float | None], Executor]
# Connects to the scheduler at an address, before anything is written. Raises InputError. An entry point of the group
# ``abhv_mc.executors``, whose name is the scheme of the address.
Connect = Callable[[str], AbstractContextManager[OpenExecutor]]


class Store(Protocol):
    """Place of campaign folders: a local folder, or an address.

    Every command works in a local folder, which the store fills and copies back. A store must promise:

    - **Whole files.** A reader gets each file as it was written, or not at all. ``manifest.json`` names the SHA-256 of
      the others and is copied after them, so that a reader never misses a file that it names.
    - **One writer.** While one process is in :meth:`writing`, another one gets an InputError that names the first, on
      any host. The claim of a process that died ends by itself, by the store's clock if it has one. A process whose
      claim was taken over is interrupted and writes nothing more.
    - **Nothing lost.** :meth:`writing` begins with the content of the store, so that a run resumes. What is in the
      local folder when it ends, by an error or an interrupt too, is in the store, or is kept in a local folder that
      ``StorageFullError`` names. During a run new files are copied every few seconds.
    - **No surprises.** Names that lead out of the folder are rejected. Nothing of a folder is executed or unpickled.

    What the package adds is the same in each store: readers check every hash and name a damaged file; flights are
    evidence and are never replaced by those of other code or inputs; all else (envelopes, histories, margins, pages)
    follows from them and is remade if it is missing.

    A package registers the class for the scheme of its addresses in the group ``abhv_mc.stores``; it is made of an
    :class:`abhv_mc.io.address.Address`.
    """

    @property
    def local(self) -> Path | None:
        """The folder, if it is on this machine."""

    def reading(self, pattern: str = "*") -> AbstractContextManager[Path]:
        """Give a local folder with the files whose names fit ``pattern``. Raises InputError."""

    def writing(self, staging: Path | None = None) -> AbstractContextManager[Path]:
        """Give a local folder that is kept in the store; ``staging`` is where a copy is made."""

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return who writes to the folder ``name`` inside, and its size in bytes."""
