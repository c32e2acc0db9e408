"""The vehicle file: what may stand in it, and the checks that need no other file."""

import math
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from abhv_mc.io.documents import File, Refusal, StrictModel, one_of
from abhv_mc.io.units import (
    ANGLE,
    AREA,
    FRACTION,
    TIME,
    Acceleration,
    Angle,
    AngularRate,
    Area,
    Dimension,
    Fraction,
    Frequency,
    Inertia,
    Length,
    Mass,
    Time,
    parse_unit,
)
from abhv_mc.vehicle.arrays import COEFFICIENTS
from abhv_mc.vehicle.limits import LoadLimits
from abhv_mc.vehicle.model import Inlet
from abhv_mc.vehicle.sensing import SensingKeys

AXIS_DEFLECTIONS = ("aileron", "rudder", "elevator")
REDUCED_RATES = ("roll_rate", "pitch_rate", "yaw_rate")  # p b/(2 V), q c/(2 V), r b/(2 V)
_PLAIN_FACTORS = ("mach", "equivalence_ratio")
_ANGLE_FACTORS = ("angle_of_attack", "sideslip", *AXIS_DEFLECTIONS)
FACTORS = (*_ANGLE_FACTORS, *REDUCED_RATES, *_PLAIN_FACTORS)

# FIXED_TABLE_ROWS of the propulsion and the keys that name their tables.
PROPULSION_TABLES = {
    "capture_area_ratio": "capture_area_ratio",
    "specific_impulse": "specific_impulse",
    "thrust_area": "area",
}

Positive = Field(gt=0.0)


class Reference(StrictModel):
    """Reference area and lengths of the coefficients."""

    area: Annotated[Area, Positive] = Field(description="reference area of all coefficients")
    span: Annotated[Length, Positive] = Field(description="length of the rolling and yawing moment")
    chord: Annotated[Length, Positive] = Field(description="length of the pitching moment")
    nose_radius: Annotated[Length, Positive] | None = Field(default=None, description="of the stagnation heat flux")


class MassPoint(StrictModel):
    """Mass properties at one mass. The centre of gravity is measured from the moment reference."""

    mass: Annotated[Mass, Positive] = Field(description="at which the following hold")
    inertia_xx: Annotated[Inertia, Positive] = Field(description="moment of inertia about body x (forward)")
    inertia_yy: Annotated[Inertia, Positive] = Field(description="moment of inertia about body y (right)")
    inertia_zz: Annotated[Inertia, Positive] = Field(description="moment of inertia about body z (down)")
    inertia_matrix_element_13: Inertia = Field(
        default=0.0, description="element of the inertia matrix: minus the integral of x z dm"
    )
    center_of_gravity_x: Length = Field(default=0.0, description="forward of the moment reference")
    center_of_gravity_z: Length = Field(default=0.0, description="below the moment reference")

    @model_validator(mode="after")
    def _check(self) -> "MassPoint":
        check_inertia(self)
        return self


def check_inertia(point: MassPoint) -> None:
    """Refuse inertias that no rigid body has: raises :class:`Refusal`."""
    xx, yy, zz, xz = point.inertia_xx, point.inertia_yy, point.inertia_zz, point.inertia_matrix_element_13
    if min(xx, yy, zz) <= 0.0 or xz**2 >= xx * zz or max(xx, yy, zz) > (xx + yy + zz) / 2.0 * (1.0 + 1e-9):
        raise Refusal(
            f"inertias {xx:g}, {yy:g}, {zz:g}, {xz:g} kg m2 that no body has",
            "none above the sum of the two others, and element 13 below the mean of xx and zz",
        )


class MassModel(StrictModel):
    """Mass at the start of a flight and properties against mass: linear between the points, held outside."""

    start: Annotated[Mass, Positive] = Field(description="at the start of a flight, within the points")
    empty: Annotated[Mass, Positive] | None = Field(
        default=None, description="without fuel: the engine stops there; left out: no fuel is burnt"
    )
    points: tuple[MassPoint, ...] | None = Field(
        default=None, min_length=1, description="mass properties by rising mass"
    )
    file: File | None = Field(default=None, description="the points as CSV: mass_kg,inertia_xx_kg_m2,...")

    @model_validator(mode="after")
    def _check(self) -> "MassModel":
        if (self.points is None) == (self.file is None):
            raise Refusal("both points and a file" if self.points else "neither points nor a file", "one of them")
        if self.empty is not None and self.empty > self.start:
            raise Refusal(f"{self.empty:g} kg empty, more than at the start", f"at most {self.start:g} kg", ("empty",))
        for i, (light, heavy) in enumerate(zip((self.points or ())[:-1], (self.points or ())[1:], strict=True)):
            if heavy.mass <= light.mass:
                raise Refusal(f"{heavy.mass:g} kg after {light.mass:g} kg", "rising masses", ("points", i + 1, "mass"))
        return self


class TableEntry(StrictModel):
    """One table: a CSV file or a constant."""

    file: File | None = Field(default=None, description="CSV with one column per axis and the column 'value'")
    constant: float | None = Field(default=None, description="one value everywhere, in place of a file")
    unit: str = Field(default="-", description="of the values, such as 1/deg, 1/rad, s, m2")
    scale: float = Field(default=1.0, description="multiplies the values")
    columns: dict[str, str] = Field(
        default_factory=dict, description="names of the columns whose header says something else"
    )

    @model_validator(mode="after")
    def _check(self) -> "TableEntry":
        if (self.file is None) == (self.constant is None):
            raise Refusal("both a file and a constant" if self.file else "neither file nor constant", "one of them")
        if self.columns and self.file is None:
            raise Refusal("columns of a constant", "columns of a file", ("columns",))
        try:
            parse_unit(self.unit)
        except Refusal as refusal:
            raise Refusal(refusal.found, refusal.wanted, ("unit",)) from None
        return self


class Term(StrictModel):
    """A part of a coefficient: table, times a variable where one is named."""

    table: str = Field(description="name of a table")
    times: str | None = Field(default=None, description="variable that multiplies it, such as elevator or pitch_rate")
    scale: float = Field(default=1.0, description="number that multiplies it")


class PythonFunction(StrictModel):
    """A function of the vehicle's own, compiled apart from the flight."""

    python: File = Field(description="Python file, relative to this file")
    settings: dict[str, Any] = Field(default_factory=dict, description="of its class Settings")


class ReferencePoint(StrictModel):
    """Where a function's forces and moments act, from the moment reference."""

    x: Length = Field(0.0, description="forward of the moment reference")
    z: Length = Field(0.0, description="below the moment reference")


class AerodynamicsFunction(PythonFunction):
    """Coefficients as a Python function of the air, the controls and the rates."""

    function: str = Field("coefficients", description="name of the function")
    frame: Literal["body", "stability", "wind"] = Field(
        description="axes of the forces: body CX CY CZ; stability CL CD with CY along body y; wind CL CD CC"
    )
    reference_point: ReferencePoint = Field(ReferencePoint(), description="about which the moments are")
    nodes: dict[Literal["mach", "angle_of_attack", "equivalence_ratio"], tuple[float, ...]] = Field(
        default_factory=dict, description="where the function has kinks, angles in rad: trim tables have nodes there"
    )


class Aerodynamics(StrictModel):
    """Each coefficient is the sum of its terms."""

    force_axes: Literal["stability", "wind"] = Field(
        default="stability", description="of lift and drag; wind: drag opposes the velocity at any sideslip"
    )
    lift: tuple[Term, ...] = Field((), description="terms of the lift coefficient, positive up")
    drag: tuple[Term, ...] = Field((), description="terms of the drag coefficient, positive backwards")
    side_force: tuple[Term, ...] = Field((), description="terms of the side-force coefficient, positive to the right")
    rolling_moment: tuple[Term, ...] = Field((), description="terms of the rolling moment, positive right wing down")
    pitching_moment: tuple[Term, ...] = Field((), description="terms of the pitching moment, positive nose up")
    yawing_moment: tuple[Term, ...] = Field((), description="terms of the yawing moment, positive nose right")


class Effector(StrictModel):
    """Deflection of one surface per deflection of each axis."""

    aileron: float = Field(0.0, description="deflection per aileron command")
    rudder: float = Field(0.0, description="deflection per rudder command")
    elevator: float = Field(0.0, description="deflection per elevator command")


class Surfaces(StrictModel):
    """Second-order actuators of the three axis deflections."""

    bandwidth: Annotated[AngularRate, Positive] = Field(description="natural frequency")
    damping: Annotated[float, Positive] = Field(description="damping ratio")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")
    rate_limit: Annotated[AngularRate, Positive] = Field(description="greatest rate of deflection")


class IdealSurfaces(StrictModel):
    """Deflections that are what is commanded."""

    ideal: Literal[True] = Field(description="no dynamics")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")


class ThrustLine(StrictModel):
    """Where the thrust acts, from the moment reference."""

    inclination: Angle = Field(default=0.0, description="of the thrust, upward")
    offset: Length = Field(default=0.0, description="below the moment reference: positive pitches nose up")


class Unstart(StrictModel):
    """Flow in which the inlet stays started. Outside of it the engine fails as ``failure.engine`` says."""

    angle_of_attack: tuple[Angle, Angle] = Field(default=(-math.inf, math.inf), description="least and greatest")
    sideslip: Annotated[Angle, Positive] = Field(default=math.inf, description="greatest, to either side")
    mach: tuple[float, float] = Field(default=(-math.inf, math.inf), description="least and greatest")
    restart_delay: Annotated[Time, Field(ge=0.0)] = Field(
        default=math.inf, description="time inside until it starts again; left out: never"
    )
    drag_increment: float = Field(default=0.0, description="added to the drag coefficient meanwhile")
    pitching_moment_increment: float = Field(default=0.0, description="likewise to the pitching moment's")

    @model_validator(mode="after")
    def _check(self) -> "Unstart":
        for name in ("angle_of_attack", "mach"):
            low, high = getattr(self, name)
            if low >= high:
                raise Refusal("an empty range", "least and greatest", (name,))
        if not self.model_fields_set & {"angle_of_attack", "sideslip", "mach"}:
            raise Refusal("an unstart without a condition", "angle_of_attack, sideslip or mach")
        return self

    def inlet(self) -> Inlet:
        """The condition as numbers."""
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
    """How an engine comes back after a failure; its flame-out follows the lag of the equivalence ratio."""

    delay: Annotated[Time, Field(ge=0.0)] = Field(0.0, description="time until it begins to come back")
    time_constant: Annotated[Time, Field(ge=0.0)] = Field(
        0.0, description="time constant of its thrust; 0: the lag of the equivalence ratio"
    )


class _Propulsion(StrictModel):
    specific_impulse: str = Field(description="name of the table of the specific impulse")
    standard_gravity: Annotated[Acceleration, Positive] = Field(
        default=9.80665, description="gravity in the specific impulse"
    )
    thrust_line: ThrustLine = Field(ThrustLine(), description="where the thrust acts; left out: along body x")
    equivalence_ratio: tuple[float, float] = Field(description="least and greatest")
    bandwidth: Annotated[AngularRate, Positive] = Field(description="natural frequency of the equivalence ratio")
    damping: Annotated[float, Positive] = Field(description="damping ratio of the equivalence ratio")
    rate_limit: Annotated[Frequency, Positive] = Field(description="greatest rate of the equivalence ratio")
    relight: Relight = Field(Relight(), description="how it comes back after a failure")
    unstart: Unstart | None = Field(
        default=None, description="flow outside which the engine fails; left out: the inlet stays started in any flow"
    )

    @model_validator(mode="after")
    def _check(self) -> "_Propulsion":
        if not 0.0 <= self.equivalence_ratio[0] < self.equivalence_ratio[1]:
            raise Refusal(f"{list(self.equivalence_ratio)}", "least and greatest, from 0 up", ("equivalence_ratio",))
        return self


class Capture(_Propulsion):
    """T = stoichiometric ratio * eta * Isp * g0 * rho * V * capture area ratio * cowl area."""

    kind: Literal["capture"] = Field(description="how thrust is computed")
    stoichiometric_ratio: Annotated[Fraction, Positive] = Field(description="fuel to air, by mass")
    cowl_area: Annotated[Area, Positive] = Field(description="of the inlet")
    capture_area_ratio: str = Field(description="name of the table of captured area over cowl area")


class ThrustArea(_Propulsion):
    """T = dynamic pressure * thrust area."""

    kind: Literal["thrust_area"] = Field(description="how thrust is computed")
    area: str = Field(description="name of the table of thrust over dynamic pressure")


class ThrustFunction(PythonFunction):
    """Thrust as a Python function of the air and the throttle."""

    function: str = Field("thrust", description="name of the function")
    throttle: tuple[float, float] = Field((0.0, 1.0), description="least and greatest")
    ideal: bool = Field(False, description="the throttle is what is commanded")
    bandwidth: Annotated[AngularRate, Positive] | None = Field(default=None, description="of the throttle")
    damping: Annotated[float, Positive] = Field(default=1.0, description="damping ratio of the throttle")
    rate_limit: Annotated[Frequency, Positive] | None = Field(default=None, description="greatest rate of the throttle")
    unstart: Unstart | None = Field(
        default=None, description="flow outside which the engine fails; left out: the inlet stays started in any flow"
    )

    @model_validator(mode="after")
    def _check(self) -> "ThrustFunction":
        if not self.throttle[0] < self.throttle[1]:
            raise Refusal(f"{list(self.throttle)}", "least and greatest", ("throttle",))
        if self.ideal == (self.bandwidth is not None and self.rate_limit is not None):
            raise Refusal("an engine that is ideal and has dynamics, or neither", "ideal, or bandwidth and rate_limit")
        return self


def _propulsion_kind(value: Any) -> str:
    given = value if isinstance(value, dict) else vars(value)
    return "python" if "python" in given else str(given.get("kind"))


Propulsion = Annotated[
    Annotated[Capture, Tag("capture")]
    | Annotated[ThrustArea, Tag("thrust_area")]
    | Annotated[ThrustFunction, Tag("python")],
    Discriminator(_propulsion_kind),
]


def _aerodynamics_kind(value: Any) -> str:
    return "python" if "python" in (value if isinstance(value, dict) else vars(value)) else "terms"


def _surfaces_kind(value: Any) -> str:
    return "ideal" if "ideal" in (value if isinstance(value, dict) else vars(value)) else "actuators"


class FlightLimits(LoadLimits):
    """Where a flight ends."""

    angle_of_attack: tuple[Angle, Angle] = Field(description="least and greatest")
    sideslip: Annotated[Angle, Positive] = Field(description="greatest, to either side")

    @model_validator(mode="after")
    def _check(self) -> "FlightLimits":
        if self.angle_of_attack[0] >= self.angle_of_attack[1]:
            raise Refusal("an empty range", "least and greatest", ("angle_of_attack",))
        return self


class VehicleDocument(StrictModel):
    """A vehicle: its numbers, its tables and how its coefficients are built from them."""

    name: str = Field(description="name of the vehicle")
    description: str = Field("", description="what it is and where its numbers come from")
    reference: Reference = Field(description="area and lengths of the coefficients")
    mass: MassModel = Field(description="mass, inertia and centre of gravity")
    surfaces: (
        Annotated[
            Annotated[Surfaces, Tag("actuators")] | Annotated[IdealSurfaces, Tag("ideal")],
            Discriminator(_surfaces_kind),
        ]
        | None
    ) = Field(default=None, description="actuators of the control surfaces; left out: none")
    effectors: dict[str, Effector] = Field(
        default_factory=dict, max_length=4, description="surfaces of its own, mixed from aileron, rudder and elevator"
    )
    propulsion: Propulsion | None = Field(default=None, description="the engine; left out: none")
    sensing: SensingKeys = Field(SensingKeys(), description="what its instruments measure; a mission may say otherwise")
    limits: FlightLimits | None = Field(
        default=None, description="attitudes outside which a flight ends; left out: any attitude"
    )
    tables: dict[str, TableEntry] = Field(default_factory=dict, description="tables by name; each must be used")
    aerodynamics: Annotated[
        Annotated[Aerodynamics, Tag("terms")] | Annotated[AerodynamicsFunction, Tag("python")],
        Discriminator(_aerodynamics_kind),
    ] = Field(Aerodynamics(), description="terms of the six coefficients, or a function")

    def uses(self) -> list[tuple[str, str | None, tuple[str | int, ...]]]:
        """Every use of a table: its name, what it is (a propulsion quantity or the ``times`` of a term), the place."""
        found: list[tuple[str, str | None, tuple[str | int, ...]]] = []
        for quantity, key in PROPULSION_TABLES.items():
            if table := getattr(self.propulsion, key, None):
                found.append((table, quantity, ("propulsion", key)))
        for coefficient in COEFFICIENTS:
            for i, term in enumerate(getattr(self.aerodynamics, coefficient, ())):
                found.append((term.table, term.times, ("aerodynamics", coefficient, i, "table")))
        return found

    @model_validator(mode="after")
    def _check(self) -> "VehicleDocument":
        for name in self.effectors:
            if name in FACTORS or not name.isidentifier():
                raise Refusal(f"an effector '{name}'", "a word that names no other variable", ("effectors", name))
        factors = (*FACTORS, *self.effectors)
        for table, quantity, place in self.uses():
            if table not in self.tables:
                raise Refusal(f"'{table}', which is no table of this file", one_of(self.tables, table), place)
            if place[0] == "aerodynamics" and quantity is not None and quantity not in factors:
                raise Refusal(f"times '{quantity}'", one_of(factors, quantity), (*place[:-1], "times"))
            self._check_unit(table, quantity)
        used = {table for table, _, _ in self.uses()}
        for table in self.tables:
            if table not in used and self.propulsion is not None:  # a glider's file may keep its engine's tables
                raise Refusal(
                    f"the table '{table}', which nothing uses", "a use of it, or none of it", ("tables", table)
                )
        return self

    def _check_unit(self, table: str, quantity: str | None) -> None:
        unit = self.tables[table].unit
        wanted: tuple[Dimension, ...]
        if quantity in _ANGLE_FACTORS or quantity in self.effectors:
            wanted = (ANGLE,)
        elif quantity in REDUCED_RATES:
            wanted = (ANGLE, FRACTION)  # per radian
        else:
            wanted = ({"specific_impulse": TIME, "thrust_area": AREA}.get(quantity or "", FRACTION),)
        sign = -1 if wanted[0] is ANGLE else 1
        if parse_unit(unit)[1] not in [tuple(sign * e for e in dimension.exponents) for dimension in wanted]:
            words = "1/deg or 1/rad" if wanted[0] is ANGLE else f"a unit like '{wanted[0].unit}'"
            use = f"for {quantity}" if quantity else "for a whole part of a coefficient"
            raise Refusal(f"a table in '{unit}' {use}", words, ("tables", table, "unit"))
