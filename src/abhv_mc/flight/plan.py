"""What one controller's flights need, as plain values: made once by the launching process."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Singles
from abhv_mc.flight.channels import CHANNELS, Channel, effector_channels, state_channels
from abhv_mc.flight.metrics import METRICS, NO_METRICS, Metric, unpack_metrics
from abhv_mc.flight.outcome import Limits
from abhv_mc.identity import Flyer
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.kernel.flight.sensors import MAX_DELAY_TICKS
from abhv_mc.kernel.plant.air_data import no_profile
from abhv_mc.kernel.plant.parameter_names import ALL_SENSORS, PARAMETER_INDEX
from abhv_mc.kernel.plant.slopes import Effectiveness
from abhv_mc.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc.kernel.world.earth import Earth
from abhv_mc.user_code.source import UserSource
from abhv_mc.vehicle.actuators import has_slack, name_effectors
from abhv_mc.vehicle.vehicle_code import VehicleCode, name_states

NO_SOURCES: NDArray[np.str_] = np.empty((0, 2), dtype=np.str_)


class Recording(NamedTuple):
    """What is recorded of flights."""

    every: int  # control ticks between samples, 0 for none
    channels: tuple[int, ...] = tuple(range(len(CHANNELS)))  # of the plan's
    extremes: bool = False  # over every control tick around each sample, of all flights together

    def count_samples(self, timing: "Timing") -> int:
        """Samples of a whole flight."""
        return timing.ticks // self.every + 1 if self.every else 0


def recording_of(asked: Recording | int | None, plan: "FlightPlan") -> Recording:
    """What is asked for; a number stands for samples of every channel so many control ticks apart, None for nothing."""
    return (
        asked
        if isinstance(asked, Recording)
        else Recording(asked or 0, tuple(range(len(plan.channels))))
    )


# Beginnings of the names of dispersions that a lean flight does not know.
NOT_LEAN = (
    *("wind.", "sensor.", "failure.", "atmosphere.density_at_", "control.effector_"),
    *("thrust.", "atmosphere.temperature"),
)


SENSOR_TIMES = (
    "sensor.delay",
    *(f"sensor.{name}_{what}" for name in ALL_SENSORS for what in ("lag", "interval")),
)


def find_late(parameters: Floats, tick: float) -> tuple[str, str] | None:
    """A delay, lag or interval among ``parameters`` [flight, parameter] that no sensor has at a control period (s), and
    what there is, in words; None where there is none."""
    for name in SENSOR_TIMES:
        most = (MAX_DELAY_TICKS + 0.5) * tick if name == "sensor.delay" else np.inf
        values = parameters[:, PARAMETER_INDEX[name]]
        for wrong in values[(values < 0.0) | (values > most)]:
            known = f"0 to {1e3 * MAX_DELAY_TICKS * tick:g} ms, {MAX_DELAY_TICKS} control periods"
            return f"{name} of {1e3 * wrong:g} ms", known if most < np.inf else "0 or more"
    return None


@dataclass(frozen=True)
class FlightPlan:
    """Everything that a worker needs to fly one controller, apart from the dispersions."""

    controller: str  # its name in the campaign
    law: str  # which compiled law flies it: "tlc", "lqr", "recorded", "python", "c" or "fmu"
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    limits: Limits
    initial_state: Floats  # [state] nominal start, see abhv_mc.kernel.plant.state
    reference: Floats  # [tick, column] see abhv_mc.kernel.laws.columns
    gains: Floats  # [tick, gain] columns as the law names them
    settings: Floats  # the law's constants (differentiator bandwidths, command limits)
    profile: Floats = field(
        default_factory=no_profile
    )  # [knot, column] nominal air, see abhv_mc.kernel.plant.air_data
    warnings: NDArray[np.str_] = field(
        default_factory=lambda: np.empty(0, dtype=np.str_)
    )  # sentences for the user
    gain_names: NDArray[np.str_] = field(
        default_factory=lambda: np.empty(0, dtype=np.str_)
    )  # of a user law
    declared: NDArray[np.str_] = field(
        default_factory=NO_METRICS.copy
    )  # metrics of a campaign, as pack_metrics gives
    user_sources: NDArray[np.str_] = field(
        default_factory=NO_SOURCES.copy
    )  # [channel, 2] name and unit
    period: int = (
        0  # ticks after which a user law says that it does the same again; 0 where it does not say
    )
    around: str = (
        ""  # the law of the program, "tlc" or "lqr", whose measurement a user's code filters
    )
    law_parameters: NDArray[np.str_] = field(
        default_factory=lambda: np.empty(0, dtype=np.str_)
    )  # settings of laws among the campaign's parameters, behind those of the vehicle
    filter_settings: Floats = field(default_factory=lambda: np.empty(0))  # of that code
    source_hash: str = ""  # of its text, "" for the laws of the program
    channels_hash: str = ""  # of the text of user channels
    source: UserSource | None = field(
        default=None, metadata={"stored": False}
    )  # its text: travels, is not stored
    channels_source: UserSource | None = field(default=None, metadata={"stored": False})
    vehicle_code: VehicleCode | None = field(
        default=None, metadata={"stored": False}
    )  # of vehicle.foreign's digest
    lean: bool = field(
        default=False, metadata={"stored": False}
    )  # flown by less code with the same bits, see lean_for

    def lean_for(self, names: Collection[str]) -> "Self":
        """The plan for flights with dispersions of these names, whatever their values: processes compile the same."""
        vehicle, foreign = self.vehicle, self.vehicle.foreign
        plain = self.law in ("tlc", "lqr") and not (self.channels_hash or foreign.digest.any())
        whole = not (vehicle.constants.inlet.unstarts or vehicle.constants.driven)
        whole &= not has_slack(vehicle)
        calm = len(self.profile) == 0 and not any(name.startswith(NOT_LEAN) for name in names)
        return replace(self, lean=bool(plain and whole and calm))

    @property
    def commanding_law(self) -> str:
        """The law that commands: a filter's is the one of the program around it."""
        return self.around or self.law

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The columns of its flights' metrics: those of the program, then the declared ones."""
        return (*METRICS, *unpack_metrics(self.declared))

    @property
    def sources(self) -> tuple[UserSource, ...]:
        """The user's code of its law and channels."""
        return tuple(source for source in (self.source, self.channels_source) if source)

    @property
    def effectors(self) -> tuple[str, ...]:
        """The names of effectors that have actuators; none where the three axes have them."""
        return name_effectors(self.vehicle) if self.vehicle.constants.driven else ()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What its histories may record."""
        own = effector_channels(self.effectors), state_channels(self.custom_states)
        return (*CHANNELS, *own[0], *own[1])

    @property
    def custom_states(self) -> tuple[tuple[str, str], ...]:
        """Names and units of the vehicle's custom states."""
        return name_states(self.vehicle_code)


@dataclass(frozen=True)
class FlightBlock:
    """The flights of one call of :func:`abhv_mc.flight.fly.fly`, in the order of their parameters."""

    outcome: NDArray[np.int64]  # [flight] values of Outcome
    end_time: Floats  # [flight] s
    metrics: Floats  # [flight, metric] in the order of the plan's metrics
    history: Singles  # [flight, time, channel] the recorded channels; NaN after the end
    times: Floats  # [time] s
    states: Floats = field(
        default_factory=lambda: np.empty((0, 0, 0))
    )  # [flight, time, state], where asked for
    low: Singles | None = (
        None  # [time, channel] least and greatest value of these flights at any control tick from
    )
    high: Singles | None = (
        None  # the time before to the one after, NaN where nobody flew; None where not asked for
    )
    flown_by: tuple[Flyer, ...] = ()  # processes, where it has been signed
    reasons: Mapping[int, str] = field(default_factory=dict)  # why a flight failed to run, by row
    # Of a user's simulator: how often there was "surplus" output or a process restarted
    # ("restarts"), flights computed again ("repeated"); and an excerpt of its standard error.
    events: Mapping[str, int] = field(default_factory=dict)
    standard_error: str = ""

    @property
    def reason_texts(self) -> tuple[str, ...]:
        """The reason of each flight, '' without one; empty if no flight has one."""
        if not self.reasons:
            return ()
        return tuple(self.reasons.get(row, "") for row in range(len(self.outcome)))

    @property
    def extremes(self) -> tuple[Singles, Singles]:
        """Least and greatest values ``[time, channel]``: of every tick, or of the samples where it has no others."""
        if self.low is None or self.high is None:
            return np.fmin.reduce(self.history, axis=0), np.fmax.reduce(self.history, axis=0)
        return self.low, self.high


def join_blocks(blocks: "list[FlightBlock]") -> FlightBlock:
    """Blocks one after another as one; whole states, which a failed flight has none of, are left out."""
    parts = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in ("outcome", "end_time", "metrics", "history")
    }
    low = _reduce(np.fmin, [block.low for block in blocks if block.low is not None])
    high = _reduce(np.fmax, [block.high for block in blocks if block.high is not None])
    flyers = tuple(dict.fromkeys(flyer for block in blocks for flyer in block.flown_by))
    reasons, first = dict[int, str](), 0
    for block in blocks:
        reasons |= {first + row: reason for row, reason in block.reasons.items()}
        first += len(block.outcome)
    return FlightBlock(
        **parts,
        times=blocks[0].times,
        low=low,
        high=high,
        flown_by=flyers,
        reasons=reasons,
        events=sum((Counter(block.events) for block in blocks), Counter()),
        standard_error="".join(block.standard_error for block in blocks),
    )


def _reduce(extreme: np.ufunc, ends: list[Singles]) -> Singles | None:
    return extreme.reduce(ends) if ends else None
