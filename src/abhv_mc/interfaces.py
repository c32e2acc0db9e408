"""The contracts at the package's boundaries.

What stands above a contract never asks which implementation it has: a feature that needs more than the contract
promises to all asks for a capability, or calls :meth:`Simulator.check`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
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

    def describe_end(self, system: str, row: Floats, outcome: int) -> str:
        """Sentences on the end of the flight of ``row`` [1, input]."""

    def find_lacking(self) -> list[InputError]:
        """Dispersions of what the simulator has nothing of, which would change no flight."""

    def try_out(self) -> Iterator[str]:
        """Start what can be started without a flight, and yield warnings. Raises InputError."""
