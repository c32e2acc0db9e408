"""Flight plan of one controller as arrays, and outcomes and limits of flights.

Outcomes have codes and sentences; limits terminate flights early.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import may_run_here
from abhv_mc.custom_code.source import UserSource
from abhv_mc.flights.metrics import NO_METRICS, Metric, unpack_metrics
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.signals import Channel
from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.control.law_file import NATIVE
from abhv_mc_vehicle.flight.channels import all_channels
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.flight.plan_arrays import stored_arrays
from abhv_mc_vehicle.kernel.flight.sensors import MAX_DELAY_TICKS
from abhv_mc_vehicle.kernel.plant.aerodynamics import Effectiveness
from abhv_mc_vehicle.kernel.plant.air_data import no_profile
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ALL_SENSORS,
    PARAMETER_INDEX,
    LoadBounds,
    Tables,
    Vehicle,
)
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from abhv_mc_vehicle.vehicle.actuators import has_slack, name_effectors
from abhv_mc_vehicle.vehicle.vehicle_code import VehicleCode, name_states

_ANY = -math.inf, math.inf


class EndBounds(NamedTuple):
    """Ranges in SI units and radians; leaving a range completes the mission."""

    altitude: tuple[float, float] = _ANY
    speed: tuple[float, float] = _ANY
    mach: tuple[float, float] = _ANY
    dynamic_pressure: tuple[float, float] = _ANY
    flight_path_angle: tuple[float, float] = _ANY
    mass: tuple[float, float] = _ANY


class Limits(NamedTuple):
    """Limits that end a flight, in SI units and radians."""

    altitude_min: float
    altitude_max: float
    angle_of_attack_min: float
    angle_of_attack_max: float
    sideslip_max: float
    loads: LoadBounds = LoadBounds()
    end: EndBounds = EndBounds()
    fuel_min: float = -math.inf  # minimum mass of fuel, kg
    speed_max: float = math.inf
    mach: tuple[float, float] = _ANY


@dataclass(frozen=True)
class Limit:
    """Limit that ends a flight with ``outcome`` when ``source`` leaves its bounds.

    Sources are defined in :mod:`abhv_mc_vehicle.flight.channels`.
    """

    outcome: Outcome
    source: str
    bounds: Callable[[Limits], tuple[float, float]]


# Names of quantities in the lane memory, if they differ from the names of the limits.
_SOURCES = {
    "dynamic_pressure": "q_bar",
    "flight_path_angle": "gamma",
}


def _end(name: str) -> Limit:
    """Return the limit for a range of :class:`EndBounds`."""
    return Limit(Outcome.OK, _SOURCES.get(name, name), lambda limits: getattr(limits.end, name))


# Latitude limit 560 m from a pole, where at Mach 10 the longitude changes by 0.05 rad per step.
NEAREST_POLE = math.radians(89.995)
_RIPPLES = ("bank_ripple", "angle_of_attack_ripple", "sideslip_ripple")
_DEG = 180.0 / math.pi


def _above(outcome: Outcome, source: str, name: str, factor: float = 1.0) -> Limit:
    """Return the limit for a field of :class:`LoadBounds`, multiplied by ``factor``."""
    return Limit(outcome, source, lambda limits: (-math.inf, factor * getattr(limits.loads, name)))


# If two limits are exceeded at the same tick, the later entry determines the outcome.
LIMITS = (
    Limit(Outcome.POLE_LIMIT, "latitude", lambda limits: (-NEAREST_POLE, NEAREST_POLE)),
    Limit(Outcome.FUEL_OUT, "fuel_left_kg", lambda limits: (limits.fuel_min, math.inf)),
    *map(_end, EndBounds._fields),
    *(_above(Outcome.OSCILLATION_LIMIT, f"{name}_deg", name, _DEG) for name in _RIPPLES),
    Limit(Outcome.BANK_LIMIT, "bank", lambda limits: (-limits.loads.bank, limits.loads.bank)),
    Limit(Outcome.SPEED_LIMIT, "speed", lambda limits: (-math.inf, limits.speed_max)),
    Limit(Outcome.MACH_LIMIT, "mach", lambda limits: limits.mach),
    _above(Outcome.HEAT_FLUX_LIMIT, "stagnation_heat_flux_w_m2", "heat_flux"),
    _above(Outcome.LOAD_FACTOR_LIMIT, "load_factor_g", "load_factor"),
    _above(Outcome.DYNAMIC_PRESSURE_LIMIT, "q_bar", "dynamic_pressure"),
    Limit(
        Outcome.SIDESLIP_LIMIT,
        "sideslip",
        lambda limits: (-limits.sideslip_max, limits.sideslip_max),
    ),
    Limit(
        Outcome.ANGLE_OF_ATTACK_LIMIT,
        "angle_of_attack",
        lambda limits: (limits.angle_of_attack_min, limits.angle_of_attack_max),
    ),
    Limit(
        Outcome.ALTITUDE_LIMIT,
        "altitude",
        lambda limits: (limits.altitude_min, limits.altitude_max),
    ),
)


_NO_NAMES = np.empty(0, np.str_)
NO_SOURCES = np.empty((0, 2), np.str_)


# Prefixes of dispersed parameters that lean kernels do not support.
NOT_LEAN = (
    "wind.",
    "sensor.",
    "failure.",
    "atmosphere.density_at_",
    "control.effector_",
    "thrust.",
    "atmosphere.temperature",
    "atmosphere.uniform",
)


SENSOR_TIMES = (
    "sensor.delay",
    *(f"sensor.{name}_{what}" for name in ALL_SENSORS for what in ("lag", "interval")),
)


def find_invalid_sensor_time(parameters: Floats, tick: float) -> tuple[str, str] | None:
    """Return an invalid sensor delay, lag or interval and its valid range, or None.

    ``parameters`` has shape [flight, parameter]; ``tick`` is the control period in s.
    """
    for name in SENSOR_TIMES:
        limit = (MAX_DELAY_TICKS + 0.5) * tick if name == "sensor.delay" else np.inf
        values = parameters[:, PARAMETER_INDEX[name]]
        for value in values[(values < 0.0) | (values > limit)]:
            delay_range = (
                f"0 to {1e3 * MAX_DELAY_TICKS * tick:g} ms ({MAX_DELAY_TICKS} control periods)"
            )
            return f"'{name}' is {1e3 * value:g} ms", delay_range if limit < np.inf else "0 or more"
    return None


@dataclass(frozen=True, eq=False)  # Plans are keys of caches by identity.
class FlightPlan:
    """Input data for the flights of one controller, except the dispersed parameters."""

    controller: str  # name of the controller in the campaign
    law: str  # kind of control law: "tlc", "lqr", "recorded", "python", "c", "fmu" or "process"
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    limits: Limits
    initial_state: Floats  # [state] nominal initial state, see kernel.plant.state
    reference: Floats  # [tick, column], see kernel.laws.columns
    gains: Floats  # [tick, gain], in the order of the gain names
    settings: Floats  # constants of the control law (differentiator bandwidths, command limits)
    # [knot, column] nominal atmosphere
    profile: Floats = field(default_factory=no_profile)
    warnings: NDArray[np.str_] = field(default_factory=_NO_NAMES.copy)
    # names of the gains of a custom control law
    gain_names: NDArray[np.str_] = field(default_factory=_NO_NAMES.copy)
    # declared metrics, packed by pack_metrics
    declared: NDArray[np.str_] = field(default_factory=NO_METRICS.copy)
    # [channel, 2] name and unit of custom channels
    user_sources: NDArray[np.str_] = field(default_factory=NO_SOURCES.copy)
    period: int = 0  # declared period of a custom control law in ticks; 0 if undeclared
    # built-in law ("tlc" or "lqr") whose measurement is filtered by custom code
    around: str = ""
    # dispersed settings of control laws, after the vehicle's settings in parameter arrays
    law_parameters: NDArray[np.str_] = field(default_factory=_NO_NAMES.copy)
    filter_settings: Floats = field(
        default_factory=lambda: np.empty(0)
    )  # settings of a custom measurement filter
    source_hash: str = ""  # hash of the custom law's source; "" for built-in laws
    channels_hash: str = ""  # hash of the custom channels' source
    # The following fields are sent to workers but not stored.
    source: UserSource | None = field(default=None, metadata={"stored": False})
    channels_source: UserSource | None = field(default=None, metadata={"stored": False})
    # custom code of the vehicle, whose digest is in vehicle.foreign
    vehicle_code: VehicleCode | None = field(default=None, metadata={"stored": False})
    # whether to use a smaller kernel with bit-identical results, see lean_for
    lean: bool = field(default=False, metadata={"stored": False})

    def lean_for(self, names: Collection[str]) -> "Self":
        """Return the plan, lean if possible, for flights that disperse the named parameters.

        The result depends only on the names, so that all processes compile the same kernel.
        """
        vehicle = self.vehicle
        foreign = self.vehicle.foreign
        is_builtin = self.law in ("tlc", "lqr") and not (self.channels_hash or foreign.digest.any())
        is_fixed = not (vehicle.constants.inlet.unstarts or vehicle.constants.driven)
        is_fixed = is_fixed and not has_slack(vehicle)
        is_calm = len(self.profile) == 0 and not any(name.startswith(NOT_LEAN) for name in names)
        return replace(self, lean=bool(is_builtin and is_fixed and is_calm))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that a results folder stores."""
        return stored_arrays(self)

    @property
    def nominal(self) -> Floats:
        """Row [1, parameter] of nominal parameters."""
        return np.array([[parameter.nominal for parameter in PARAMETERS]])

    @property
    def must_run_in_child(self) -> bool:
        """Whether the control law is native code that this process must not run."""
        return self.law in NATIVE and not may_run_here()

    def lost_outcome(self, hung: bool) -> Outcome:
        """Return the outcome of a flight that twice crashed or hung (``hung``) its process.

        If the control law is native code, it is assumed to be the cause.
        """
        if self.law not in NATIVE:
            return Outcome.FAILED_TO_RUN
        return Outcome.LAW_HUNG if hung else Outcome.LAW_CRASHED

    @property
    def commanding_law(self) -> str:
        """Control law that computes the commands; with a custom filter, the built-in law."""
        return self.around or self.law

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics in column order: built-in metrics, then declared metrics."""
        return (*METRICS, *unpack_metrics(self.declared))

    @property
    def sources(self) -> tuple[UserSource, ...]:
        """Custom code of the control law and of the channels."""
        return tuple(source for source in (self.source, self.channels_source) if source)

    @property
    def metric_count(self) -> int:
        """Number of metrics of a flight."""
        return len(self.metrics)

    @property
    def members(self) -> int:
        """Number of members of the mission's ensemble of atmospheres."""
        return int(np.count_nonzero(np.diff(self.profile[:, 0]) < 0.0))

    @property
    def effectors(self) -> tuple[str, ...]:
        """Names of effectors with actuators; empty if only the three axes have actuators."""
        return name_effectors(self.vehicle) if self.vehicle.constants.driven else ()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels that histories may record."""
        return all_channels(self.effectors, self.custom_states)

    @property
    def custom_states(self) -> tuple[tuple[str, str, bool], ...]:
        """Names and units of the vehicle's custom states."""
        return name_states(self.vehicle_code)
