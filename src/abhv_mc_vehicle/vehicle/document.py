"""Pydantic model of the vehicle file, with the checks that need no other file."""

import math
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator

from abhv_mc.io.documents import CommaKeys, File, StrictModel
from abhv_mc.io.messages import Refusal, one_of
from abhv_mc.io.units import (
    ANGLE,
    AREA,
    FRACTION,
    TIME,
    Angle,
    Area,
    Dimension,
    Inertia,
    Length,
    Mass,
    dimension_of,
    parse_quantity,
    parse_unit,
)
from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, MAX_EFFECTORS
from abhv_mc_vehicle.vehicle.actuator_keys import (
    AXIS_DEFLECTIONS,
    PROPULSION_TABLES,
    Dynamics,
    Effector,
    Number,
    Propulsion,
    PythonFunction,
    Surfaces,
)
from abhv_mc_vehicle.vehicle.shared_keys import (
    AngleRange,
    LoadLimits,
    Positive,
    Range,
    Rising,
    SensingKeys,
    located,
)

REDUCED_RATES = ("roll_rate", "pitch_rate", "yaw_rate")  # p b/(2 V), q c/(2 V), r b/(2 V)
_PLAIN_FACTORS = ("mach", "equivalence_ratio")
_ANGLE_FACTORS = ("angle_of_attack", "sideslip", *AXIS_DEFLECTIONS)
FACTORS = (*_ANGLE_FACTORS, *REDUCED_RATES, *_PLAIN_FACTORS)
# use of a table: name of the table, quantity or variable, and key in the file
Use = tuple[str, str | None, tuple[str | int, ...]]
_Size = Field(ge=1e-6)  # minimum of a reference length or area in SI units


class Reference(StrictModel):
    """Reference area and reference lengths of the aerodynamic coefficients."""

    area: Annotated[Area, _Size]
    """reference area of all coefficients"""
    span: Annotated[Length, _Size]
    """reference length of the rolling and yawing moments"""
    chord: Annotated[Length, _Size]
    """reference length of the pitching moment"""
    nose_radius: Annotated[Length, Positive] | None = None
    """nose radius for the stagnation heat flux"""


class MassPoint(StrictModel):
    """Mass properties at one mass; the centre of gravity is relative to the moment reference."""

    mass: Annotated[Mass, Positive]
    """vehicle mass at which these mass properties apply"""
    inertia_xx: Annotated[Inertia, Positive]
    """moment of inertia about body x (forward)"""
    inertia_yy: Annotated[Inertia, Positive]
    """moment of inertia about body y (right)"""
    inertia_zz: Annotated[Inertia, Positive]
    """moment of inertia about body z (down)"""
    inertia_matrix_element_13: Inertia = 0.0
    """element xz of the inertia matrix: minus the integral of x z dm"""
    center_of_gravity_x: Length = 0.0
    """distance of the centre of gravity forward of the moment reference"""
    center_of_gravity_z: Length = 0.0
    """distance of the centre of gravity below the moment reference"""

    @model_validator(mode="after")
    def _check(self) -> "MassPoint":
        xx = self.inertia_xx
        yy = self.inertia_yy
        zz = self.inertia_zz
        xz = self.inertia_matrix_element_13
        if xz**2 >= xx * zz or max(xx, yy, zz) > (xx + yy + zz) / 2.0 * (1.0 + 1e-9):
            raise Refusal(
                f"the inertias xx {xx:g}, yy {yy:g}, zz {zz:g} and xz {xz:g} kg m2 are physically "
                "impossible",
                "moments of inertia that are each at most the sum of the other two, and xz squared "
                "below xx times zz",
            )
        return self


class MassPoints(StrictModel):
    """Mass properties as functions of mass, linear between the points and constant outside."""

    points: tuple[MassPoint, ...] = ()
    """mass properties in order of increasing mass"""

    @model_validator(mode="after")
    def _check_points(self) -> Self:
        for i, (light, heavy) in enumerate(pairwise(self.points), 1):
            if heavy.mass <= light.mass:
                raise Refusal(
                    f"a mass of {heavy.mass:g} kg follows a mass of {light.mass:g} kg",
                    "increasing masses",
                    ("points", i, "mass"),
                )
        return self


class MassModel(MassPoints):
    """Initial mass of a flight, and mass properties as functions of mass."""

    start: Annotated[Mass, Positive]
    """initial mass of the vehicle, within the mass range of the points"""
    empty: Annotated[Mass, Positive] | None = None
    """mass without fuel, at which the engine stops; default: the engine burns no fuel"""
    file: File | None = None
    """CSV file with one row per point and the columns mass_kg, inertia_xx_kg_m2, ..."""

    @model_validator(mode="after")
    def _check(self) -> "MassModel":
        if bool(self.points) == (self.file is not None):
            raise Refusal(
                "'points' and 'file' are both present"
                if self.points
                else "'points' and 'file' are both missing",
                "exactly one of 'points' and 'file'",
            )
        if self.empty is not None and self.empty > self.start:
            raise Refusal(
                f"the empty mass of {self.empty:g} kg exceeds the initial mass",
                f"at most {self.start:g} kg",
                ("empty",),
            )
        return self


class TableEntry(CommaKeys):
    """Table read from a CSV file, or a constant."""

    file: File | None = None
    """CSV file with one column per axis and the column 'value'"""
    constant: float | None = None
    """constant value instead of a file"""
    unit: str = "-"
    """unit of the values, such as 1/deg, 1/rad, s, m2"""
    scale: float = 1.0
    """factor that multiplies the values"""
    columns: dict[str, str] = {}
    """meanings of columns with non-standard headers, such as alpha: angle_of_attack deg"""

    @model_validator(mode="after")
    def _check(self) -> "TableEntry":
        if (self.file is None) == (self.constant is None):
            raise Refusal(
                "'file' and 'constant' are both present"
                if self.file
                else "'file' and 'constant' are both missing",
                "exactly one of 'file' and 'constant'",
            )
        if self.columns and self.file is None:
            raise Refusal(
                "'columns' is combined with 'constant'", "'columns' only with 'file'", ("columns",)
            )
        with located("unit"):
            parse_unit(self.unit)
        return self


class Term(StrictModel):
    """Term of a coefficient: a table, optionally multiplied by a variable."""

    table: str
    """name of a table"""
    times: str | None = None
    """variable that multiplies the table, such as elevator or pitch_rate"""
    scale: float = 1.0
    """factor that multiplies the values of the table"""


class ReferencePoint(StrictModel):
    """Reference point of a function's moments, relative to the moment reference."""

    x: Length = 0.0
    """distance, forward of the moment reference, of the point about which the function's moments
    are defined"""
    z: Length = 0.0
    """distance, below the moment reference, of the point about which the function's moments are
    defined"""


class AerodynamicsFunction(PythonFunction):
    """Coefficients computed by a Python function of air data, controls and rates."""

    function: str = "coefficients"
    """name of the Python function"""
    frame: Literal["body", "stability", "wind"]
    """axes of the force coefficients: body (CX CY CZ), stability (CL CD, CY along body y) or
    wind (CL CD CC)"""
    reference_point: ReferencePoint = ReferencePoint()
    """point about which the moment coefficients are defined"""
    nodes: dict[Literal["mach", "angle_of_attack", "equivalence_ratio"], tuple[float, ...]] = Field(
        default_factory=dict
    )
    """values of variables at which the function has kinks (angles in rad); these values become
    nodes of the trim tables"""


class Aerodynamics(StrictModel):
    """Aerodynamic coefficients, each the sum of its terms."""

    force_axes: Literal["stability", "wind"] = "stability"
    """axes of lift and drag; in wind axes, drag opposes the velocity even with sideslip"""
    lift: tuple[Term, ...] = ()
    """terms of the lift coefficient, positive up"""
    drag: tuple[Term, ...] = ()
    """terms of the drag coefficient, positive rearward"""
    side_force: tuple[Term, ...] = ()
    """terms of the side-force coefficient, positive to the right"""
    rolling_moment: tuple[Term, ...] = ()
    """terms of the rolling-moment coefficient, positive right wing down"""
    pitching_moment: tuple[Term, ...] = ()
    """terms of the pitching-moment coefficient, positive nose up"""
    yawing_moment: tuple[Term, ...] = ()
    """terms of the yawing-moment coefficient, positive nose right"""


def _aerodynamics_kind(value: Any) -> str:
    keys = value if isinstance(value, dict) else getattr(value, "__dict__", {})
    return "python" if "python" in keys else "terms"


class FlightLimits(LoadLimits):
    """Limits of the vehicle; a flight that exceeds a limit ends."""

    angle_of_attack: AngleRange
    """minimum and maximum angle of attack"""
    sideslip: Annotated[Angle, Positive]
    """maximum sideslip in either direction"""
    mach: Range = (-math.inf, math.inf)
    """minimum and maximum Mach number"""
    altitude: Annotated[tuple[Length, Length], Rising] = (-math.inf, math.inf)
    """minimum and maximum altitude"""
    states: dict[str, Number] = {}
    """maximum magnitudes of custom states; the keys have the form state.NAME"""

    # Keys of the form state.NAME are stored in one field.
    model_config = ConfigDict(json_schema_extra={"patternProperties": {r"^state\.": {}}})

    @model_validator(mode="before")
    @classmethod
    def _gather_states(cls, data: Any) -> Any:
        named = (
            [key for key in data if str(key).startswith("state.")] if isinstance(data, dict) else []
        )
        if not named or "states" in data:
            return data
        states = {key.removeprefix("state."): data[key] for key in named}
        return {key: value for key, value in data.items() if key not in named} | {"states": states}


class VehicleDocument(StrictModel):
    """Content of a vehicle file: constants, tables, and build-up of the coefficients."""

    name: str
    """name of the vehicle"""
    description: str = ""
    """description of the vehicle and the source of its data"""
    reference: Reference
    """reference area and lengths of the coefficients"""
    mass: MassModel
    """mass, inertia and centre of gravity"""
    surfaces: Surfaces | None = None
    """actuators of the control surfaces; default: none"""
    effectors: dict[str, Effector] = Field({}, max_length=MAX_EFFECTORS)
    """control surfaces, each driven by a mix of aileron, rudder and elevator"""
    propulsion: Propulsion | None = None
    """engine of the vehicle; default: none"""
    sensing: SensingKeys = SensingKeys()
    """reference for the measured quantities; a mission may override it"""
    limits: FlightLimits | None = None
    """limits that end a flight; default: no limits"""
    tables: dict[str, TableEntry] = {}
    """tables by name; each table must be used"""
    aerodynamics: Annotated[
        Annotated[Aerodynamics, Tag("terms")] | Annotated[AerodynamicsFunction, Tag("python")],
        Discriminator(_aerodynamics_kind),
    ] = Aerodynamics()
    """terms of the six coefficients, or a function"""

    dynamics: Dynamics | None = None
    """custom states, integrated with the vehicle; default: none"""

    def state_limits(self) -> dict[str, float]:
        """Return the limits of each custom state. Raise Refusal if a limit is invalid."""
        states = self.dynamics.states if self.dynamics else {}
        limits = {}
        for name, value in (self.limits.states if self.limits else {}).items():
            with located("limits", f"state.{name}"):
                if name not in states:
                    raise Refusal(f"a limit names the unknown state '{name}'", one_of(states, name))
                limits[name] = parse_quantity(value, dimension_of(states[name].unit))
                if limits[name] <= 0.0:
                    raise Refusal(f"the limit is {value}", "a positive limit")
        return limits

    def uses(self) -> list[Use]:
        """Return each use of a table as (table, quantity, key in the file).

        The quantity is the propulsion quantity that the table contains, or the variable by which a
        term multiplies the table (its key ``times``).
        """
        uses: list[Use] = []
        for quantity, key in PROPULSION_TABLES.items():
            if table := getattr(self.propulsion, key, None):
                uses.append((table, quantity, ("propulsion", key)))
        for coefficient in COEFFICIENTS:
            for i, term in enumerate(getattr(self.aerodynamics, coefficient, ())):
                uses.append((term.table, term.times, ("aerodynamics", coefficient, i, "table")))
        return uses

    @model_validator(mode="after")
    def _check(self) -> "VehicleDocument":
        self.state_limits()
        for name, effector in self.effectors.items():
            if name in FACTORS or not name.isidentifier():
                raise Refusal(
                    f"invalid effector name '{name}'",
                    "an identifier that is not the name of another variable",
                    ("effectors", name),
                )
            if effector.driven and self.surfaces is None:
                raise Refusal(
                    "an effector has an actuator, but the file has no 'surfaces'",
                    "the key 'surfaces', whose limit applies to aileron, rudder and elevator",
                    ("effectors", name),
                )
            if self.surfaces:
                with located("effectors", name):
                    effector.complete(self.surfaces)
        factors = (*FACTORS, *self.effectors)
        for table, quantity, key in self.uses():
            if table not in self.tables:
                raise Refusal(f"unknown table '{table}'", one_of(self.tables, table), key)
            if key[0] == "aerodynamics" and quantity is not None and quantity not in factors:
                raise Refusal(
                    f"unknown variable '{quantity}'",
                    one_of(factors, quantity),
                    (*key[:-1], "times"),
                )
            self._check_unit(table, quantity)
        used = {table for table, _, _ in self.uses()}
        for table in self.tables:
            if (
                table not in used and self.propulsion is not None
            ):  # The file of a glider may contain engine tables that are not used.
                raise Refusal(
                    f"the table '{table}' is not used",
                    "only tables that a coefficient or the propulsion uses",
                    ("tables", table),
                )
        return self

    def _check_unit(self, table: str, quantity: str | None) -> None:
        unit = self.tables[table].unit
        expected: tuple[Dimension, ...]
        if quantity in _ANGLE_FACTORS or quantity in self.effectors:
            expected = (ANGLE,)
        elif quantity in REDUCED_RATES:
            expected = (ANGLE, FRACTION)  # The tables are slopes per radian.
        else:
            expected = (
                {"specific_impulse": TIME, "thrust_area": AREA}.get(quantity or "", FRACTION),
            )
        sign = -1 if expected[0] is ANGLE else 1
        if parse_unit(unit)[1] not in [
            tuple(sign * e for e in dimension.exponents) for dimension in expected
        ]:
            expected_text = (
                "1/deg or 1/rad" if expected[0] is ANGLE else f"a unit like '{expected[0].unit}'"
            )
            use = f"for {quantity}" if quantity else "for a term without 'times'"
            raise Refusal(
                f"a table {use} has the unit '{unit}'", expected_text, ("tables", table, "unit")
            )
