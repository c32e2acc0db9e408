"""Pydantic models of the keys for engine, control surfaces and custom dynamics in vehicle files."""

import keyword
import math
from collections.abc import Collection, Iterable
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from abhv_mc.io.documents import File, StrictModel, YesNo
from abhv_mc.io.messages import Refusal, describe, quoted
from abhv_mc.io.units import (
    Acceleration,
    Angle,
    AngularRate,
    Area,
    Fraction,
    Frequency,
    Length,
    Time,
    check_angle,
    dimension_of,
    parse_any,
    parse_quantity,
)
from abhv_mc_vehicle.kernel.plant.state import MAX_STATES
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ENGINES, Inlet
from abhv_mc_vehicle.vehicle.shared_keys import AngleRange, Positive, Range, Rising, located

# Propulsion quantities in FIXED_TABLE_ROWS, and the vehicle-file keys that name their tables.
PROPULSION_TABLES = {
    "capture_area_ratio": "capture_area_ratio",
    "specific_impulse": "specific_impulse",
    "thrust_area": "area",
}


ActuatorKind = Literal["second_order", "first_order", "ideal"]
_KIND = Field(
    None,
    description=(
        "second_order (default), first_order with time constant 1 / bandwidth, or ideal (position "
        "equal to command)"
    ),
)
_DEAD_ZONE = Field(
    None,
    description=(
        "dead zone: magnitude of the error between command and position below which the actuator "
        "does not move"
    ),
)
_BACKLASH = Field(None, description="total free play between the actuator and the surface")

# Keys that each kind of actuator requires; other dynamics keys are rejected.
DYNAMICS = {
    "second_order": ("bandwidth", "damping", "rate_limit"),
    "first_order": ("bandwidth", "rate_limit"),
    "ideal": (),
}


class Actuator(StrictModel):
    """Dynamic properties of an actuator."""

    bandwidth: Annotated[AngularRate, Positive] | None = None
    """natural frequency of a second-order actuator, or 1 / time constant of a first-order one"""
    damping: Annotated[float, Positive] | None = None
    """damping ratio of a second-order actuator"""
    ideal: bool = False
    """whether the actuator is ideal; 'ideal: true' is equivalent to 'kind: ideal'"""

    def _choose_kind(self, kind: ActuatorKind | None) -> ActuatorKind | None:
        """Return the kind of actuator, or None. Raise Refusal if 'kind' contradicts 'ideal'."""
        if self.ideal and kind not in (None, "ideal"):
            raise Refusal(
                f"'ideal: true' contradicts 'kind: {kind}'", "only one of them", ("ideal",)
            )
        return "ideal" if self.ideal else kind


def _list_keys(keys: Iterable[str]) -> str:
    """Return the names of keys as text, with "and" before the last name."""
    names = list(keys)
    return f"the key{'s' if len(names) > 1 else ''} {quoted(names)}"


def check_dynamics(kind: ActuatorKind, keys: Collection[str], what: str) -> None:
    """Raise Refusal if the dynamics keys do not match the kind of actuator."""
    needed = DYNAMICS[kind]
    if set(keys) != set(needed):
        verb = "have" if what == "surfaces" else "has"
        stated = _list_keys(sorted(keys)) if keys else "no dynamics"
        expected = f"exactly {_list_keys(needed)}" if needed else "no bandwidth, damping or rate"
        raise Refusal(f"{what} of kind '{kind}' {verb} {stated}", expected)


class EngineActuator(Actuator):
    """Actuator dynamics of the throttle."""

    throttle_kind: ActuatorKind | None = _KIND
    damping: Annotated[float, Positive] | None = None
    """damping ratio of a second-order actuator; default: 1"""
    rate_limit: Annotated[Frequency, Positive] | None = None
    """maximum rate of change of the throttle"""
    dead_zone: Annotated[float, Field(ge=0.0)] | None = _DEAD_ZONE
    backlash: Annotated[float, Field(ge=0.0)] | None = _BACKLASH

    @property
    def response(self) -> ActuatorKind:
        """Return the kind of actuator."""
        return self._choose_kind(self.throttle_kind) or "second_order"

    @model_validator(mode="after")
    def _check_actuator(self) -> Self:
        keys = {name for name in DYNAMICS["second_order"] if getattr(self, name) is not None}
        if self.response == "second_order":
            keys.add("damping")
        check_dynamics(self.response, keys, "an engine")
        return self


class SurfaceActuator(Actuator):
    """Actuator dynamics of a control surface."""

    kind: ActuatorKind | None = _KIND
    dead_zone: Annotated[Angle, Field(ge=0.0)] | None = _DEAD_ZONE
    backlash: Annotated[Angle, Field(ge=0.0)] | None = _BACKLASH

    @property
    def response(self) -> ActuatorKind | None:
        """Return the kind of actuator, or None if the file does not state it."""
        return self._choose_kind(self.kind)


class PythonFunction(StrictModel):
    """Custom function of a vehicle, which is compiled separately from the simulator."""

    python: File
    """Python file, relative to the vehicle file"""
    settings: dict[str, Any] = {}
    """values for the fields of the class Settings in the Python file"""


class ThrustLine(StrictModel):
    """Thrust line relative to the moment reference."""

    inclination: Angle = 0.0
    """angle of the thrust direction above the body x axis"""
    offset: Length = 0.0
    """distance of the thrust line below the moment reference; a positive value gives a nose-up
    moment"""


class Unstart(StrictModel):
    """Flow conditions in which the inlet stays started; under other conditions it unstarts."""

    angle_of_attack: AngleRange = (-math.inf, math.inf)
    """angles of attack at which the inlet stays started"""
    sideslip: Annotated[Angle, Positive] = math.inf
    """maximum sideslip of a started inlet, in either direction"""
    mach: Range = (-math.inf, math.inf)
    """Mach numbers at which the inlet stays started"""
    restart_delay: Annotated[Time, Field(ge=0.0)] = math.inf
    """time for which all conditions must be met before the inlet restarts; default: no restart"""
    drag_increment: float = 0.0
    """increment of the drag coefficient while the inlet is unstarted"""
    pitching_moment_increment: float = 0.0
    """increment of the pitching moment coefficient while the inlet is unstarted"""

    @model_validator(mode="after")
    def _check(self) -> "Unstart":
        if not self.model_fields_set & {"angle_of_attack", "sideslip", "mach"}:
            raise Refusal("'unstart' has no condition", "angle_of_attack, sideslip or mach")
        return self

    def inlet(self) -> Inlet:
        """Return the unstart conditions as numbers for the kernel."""
        return Inlet(
            1.0,
            *self.angle_of_attack,
            self.sideslip,
            *self.mach,
            self.restart_delay,
            self.drag_increment,
            self.pitching_moment_increment,
        )


class Relight(StrictModel):
    """Recovery of the thrust after an engine failure; the loss follows the throttle's lag."""

    delay: Annotated[Time, Field(ge=0.0)] = 0.0
    """time from the end of the failure until the thrust begins to recover"""
    time_constant: Annotated[Time, Field(ge=0.0)] = 0.0
    """time constant of the thrust recovery; 0 uses the lag of the throttle"""


class Engine(StrictModel):
    """One of several engines of a vehicle, which may fail separately."""

    share: Annotated[Fraction, Positive] | None = None
    """share of this engine in the total thrust; default: equal shares"""
    x: Length = 0.0
    """distance of the engine forward of the thrust line's reference point"""
    y: Length = 0.0
    """distance of the engine to the right of the thrust line"""
    z: Length = 0.0
    """distance of the engine below the thrust line"""


def engine_rows(engines: dict[str, Engine]) -> list[tuple[float, float, float, float]]:
    """Return the thrust share and position (x, y, z) of each engine."""
    return [
        (engine.share or 1.0 / len(engines), engine.x, engine.y, engine.z)
        for engine in engines.values()
    ]


class _Inlets(StrictModel):
    unstart: Unstart | None = None
    """flow conditions under which the inlet stays started; default: all conditions"""
    engines: dict[str, Engine] = Field({}, max_length=MAX_ENGINES)
    """engines by name, if the vehicle has several; default: one engine"""

    @model_validator(mode="after")
    def _check_engines(self) -> Self:
        rows = engine_rows(self.engines)
        total = sum(share for share, *_ in rows)
        moments = [sum(row[0] * row[i] for row in rows) for i in (1, 2, 3)]
        has_mixed_shares = len({engine.share is None for engine in self.engines.values()}) > 1
        if rows and (has_mixed_shares or abs(total - 1.0) > 1e-9):
            raise Refusal(
                f"the sum of the thrust shares is {total:g}",
                "shares of all engines with the sum 1, or no shares",
                ("engines",),
            )
        if max(map(abs, moments)) > 1e-6:
            raise Refusal(
                f"the engines' mean position is {', '.join(f'{x:g}' for x in moments)} m from the "
                "thrust line",
                "positions whose weighted mean is 0",
                ("engines",),
            )
        return self


class _Propulsion(EngineActuator, _Inlets):
    specific_impulse: str
    """name of the table that gives the specific impulse"""
    standard_gravity: Annotated[Acceleration, Positive] = 9.80665
    """gravitational acceleration in the definition of the specific impulse"""
    thrust_line: ThrustLine = ThrustLine()
    """position and direction of the thrust; default: along body x"""
    equivalence_ratio: Annotated[tuple[Annotated[float, Field(ge=0.0)], float], Rising]
    """minimum and maximum equivalence ratio"""
    relight: Relight = Relight()
    """recovery of the thrust after an engine failure"""


class Capture(_Propulsion):
    """Thrust as stoichiometric ratio * eta * Isp * g0 * rho * V * capture ratio * cowl area."""

    kind: Literal["capture"]
    """method of computing thrust"""
    stoichiometric_ratio: Annotated[Fraction, Positive]
    """stoichiometric fuel-air ratio by mass"""
    cowl_area: Annotated[Area, Positive]
    """area of the inlet cowl"""
    capture_area_ratio: str
    """name of the table that gives the ratio of captured area to cowl area"""


class ThrustArea(_Propulsion):
    """Thrust as dynamic pressure * thrust area."""

    kind: Literal["thrust_area"]
    """method of computing thrust"""
    area: str
    """name of the table that gives thrust divided by dynamic pressure"""


class ThrustFunction(EngineActuator, PythonFunction, _Inlets):
    """Thrust computed by a Python function of air data and throttle."""

    function: str = "thrust"
    """name of the Python function"""
    throttle: Range = (0.0, 1.0)
    """minimum and maximum throttle"""


def _propulsion_kind(value: Any) -> str:
    keys = value if isinstance(value, dict) else getattr(value, "__dict__", {})
    return "python" if "python" in keys else str(keys.get("kind"))


Propulsion = Annotated[
    Annotated[Capture, Tag("capture")]
    | Annotated[ThrustArea, Tag("thrust_area")]
    | Annotated[ThrustFunction, Tag("python")],
    Discriminator(_propulsion_kind),
]


def throttle_range(engine: Propulsion | None) -> tuple[float, float]:
    """Return the minimum and maximum throttle, or zeros without an engine."""
    if engine is None:
        return 0.0, 0.0
    return engine.throttle if isinstance(engine, ThrustFunction) else engine.equivalence_ratio


AxisDeflection = Literal["aileron", "rudder", "elevator"]
AXIS_DEFLECTIONS = get_args(AxisDeflection)


class Surfaces(SurfaceActuator):
    """Actuator settings that apply to the three axis deflections."""

    limit: Annotated[Angle, Positive]
    """maximum deflection in either direction"""
    limits: dict[AxisDeflection, Annotated[Angle, Positive]] = {}
    """maximum deflections that differ from 'limit', by axis"""
    rate_limit: Annotated[AngularRate, Positive] | None = None
    """maximum deflection rate"""

    @model_validator(mode="after")
    def _check(self) -> "Surfaces":
        keys = {name for name in DYNAMICS["second_order"] if getattr(self, name) is not None}
        check_dynamics(self.response or "second_order", keys, "surfaces")
        for name, limit in self.limits.items():
            if limit > self.limit:
                raise Refusal(
                    f"the limit of the {name} exceeds 'limit'", "a smaller value", ("limits", name)
                )
        return self


class Effector(SurfaceActuator):
    """Control surface: deflection per axis command and, optionally, an actuator of its own."""

    aileron: float = 0.0
    """deflection per unit of aileron command"""
    rudder: float = 0.0
    """deflection per unit of rudder command"""
    elevator: float = 0.0
    """deflection per unit of elevator command"""
    limits: tuple[Angle, Angle] | None = None
    """minimum and maximum deflection"""
    rate: Annotated[AngularRate, Positive] | None = None
    """maximum deflection rate"""

    @property
    def driven(self) -> bool:
        """Whether the surface has its own actuator, with missing values from ``surfaces``."""
        return bool(self.model_fields_set - set(AXIS_DEFLECTIONS))

    @model_validator(mode="after")
    def _check(self) -> "Effector":
        if self.limits is not None and not self.limits[0] <= 0.0 <= self.limits[1]:
            raise Refusal(
                f"the limits {list(self.limits)} rad exclude 0",
                "a minimum of at most 0 and a maximum of at least 0",
                ("limits",),
            )
        if self.response == "ideal" and (self.rate or self.bandwidth or self.damping):
            raise Refusal(
                "an ideal effector has a rate, a bandwidth or a damping",
                "either an ideal effector, or rate, bandwidth and damping",
                ("ideal" if self.ideal else "kind",),
            )
        return self

    def complete(self, surfaces: Surfaces) -> tuple[ActuatorKind, dict[str, float]]:
        """Return the actuator's kind and dynamics, with missing values taken from ``surfaces``.

        Raise Refusal if values are missing.
        """
        own = {"bandwidth": self.bandwidth, "damping": self.damping, "rate_limit": self.rate}
        moves = self.rate is not None or self.bandwidth is not None
        kind = self.response or surfaces.response or "second_order"
        if moves and self.response is None and kind == "ideal":
            kind = "second_order"
        dynamics = {}
        for name in DYNAMICS[kind]:
            value = own[name] if own[name] is not None else getattr(surfaces, name)
            if value is not None:
                dynamics[name] = value
        unused = {name for name, value in own.items() if value is not None} - {*DYNAMICS[kind]}
        check_dynamics(kind, {*dynamics, *unused}, "an effector")
        return kind, dynamics


Number = float | str


class CustomState(StrictModel):
    """Custom state: its unit and, if it has no equilibrium, its initial value."""

    unit: str
    """SI unit of the state, such as m, rad/s or K; - if dimensionless"""
    start: Number | None = None
    """initial value of the state; default: its equilibrium value in trim"""

    circular: YesNo = False
    """whether the state is an angle of which a full turn changes nothing"""

    @model_validator(mode="after")
    def _check(self) -> "CustomState":
        dimension_of(self.unit)
        if self.circular:
            check_angle(self.unit)
        if self.start is not None:
            parse_quantity(self.start, dimension_of(self.unit))
        return self


class Dynamics(StrictModel):
    """Custom dynamics: states that cause forces and moments and affect the sensors."""

    file: File
    """path of a Python file with one function decorated with @dynamics, relative to the vehicle
    file"""
    states: dict[
        str,
        Annotated[
            CustomState,
            BeforeValidator(
                lambda value: {"unit": value} if isinstance(value, str) else value,
                json_schema_input_type=str | CustomState,
            ),
        ],
    ] = Field(min_length=1, max_length=MAX_STATES)
    """custom states by name, each with its unit"""
    settings: dict[str, Number] = {}
    """numbers passed to the function; a campaign may disperse them"""

    @model_validator(mode="after")
    def _check(self) -> "Dynamics":
        for key in ("states", "settings"):
            for name in getattr(self, key):
                if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
                    raise Refusal(
                        f"invalid name {describe(name)}",
                        "an identifier such as mode_1",
                        (key, name),
                    )
        for name, value in self.settings.items():
            with located("settings", name):
                parse_any(value)
        return self
