"""Reading of vehicle files and their custom functions, and conversion to arrays.

Arrays are in SI units and radians.
"""

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.io.documents import Document, read_document, validate
from abhv_mc.io.foreign_table import read_foreign_table
from abhv_mc.io.input_files import made_once, read_input
from abhv_mc.io.messages import InputErrors, Refusal, counted
from abhv_mc.io.units import dimension_of, parse_any, parse_quantity, parse_unit, si_unit_of
from abhv_mc_vehicle.kernel.plant.state import MAX_SETTINGS
from abhv_mc_vehicle.kernel.plant.vehicle import (
    COEFFICIENTS,
    FIXED_TABLE_ROWS,
    PARAMETER_NAMES,
    VARIABLES,
    BuildUp,
    Constants,
    Envelope,
    Inlet,
    LoadBounds,
    Sensing,
    Vehicle,
    no_functions,
)
from abhv_mc_vehicle.vehicle.actuator_keys import (
    PROPULSION_TABLES,
    Capture,
    ThrustFunction,
    engine_rows,
    throttle_range,
)
from abhv_mc_vehicle.vehicle.actuators import pack_actuators, pack_effectors
from abhv_mc_vehicle.vehicle.document import (
    REDUCED_RATES,
    AerodynamicsFunction,
    MassPoint,
    MassPoints,
    VehicleDocument,
)
from abhv_mc_vehicle.vehicle.shared_keys import choose_sensing
from abhv_mc_vehicle.vehicle.table_file import (
    Axis,
    Table,
    make_constant,
    pack_tables,
    parse_role,
    read_table,
)
from abhv_mc_vehicle.vehicle.vehicle_code import CustomState, FunctionCode, VehicleCode


def reference_point(content: VehicleDocument) -> tuple[float, float]:
    """Return x and z (m) of the point about which a function states its moments."""
    aerodynamics = content.aerodynamics
    if not isinstance(aerodynamics, AerodynamicsFunction):
        return 0.0, 0.0
    return aerodynamics.reference_point.x, aerodynamics.reference_point.z


def make_code(document: Document, content: VehicleDocument) -> VehicleCode | None:
    """Return the custom code that a vehicle file names, or None; the code is not run.

    Raise InputError if the code is invalid.
    """

    def read(
        section: str, key: str, path: Path, function: str, settings: dict[str, Any]
    ) -> FunctionCode:
        for name, value in settings.items():
            try:
                parse_any(value)
            except Refusal as refusal:
                location = (section, "settings", name)
                raise document.error(location, refusal.found, refusal.expected) from None
        try:
            text = read_input(path).decode()
        except (OSError, UnicodeDecodeError) as error:
            raise document.error(
                (section, key),
                f"'{path.name}' cannot be read ({getattr(error, 'strerror', error)})",
                "a readable Python file",
            ) from None
        return FunctionCode(text, str(path), function, tuple(settings.items()))

    def read_function(section: str, keys: AerodynamicsFunction | ThrustFunction) -> FunctionCode:
        return read(section, "python", Path(keys.python), keys.function, keys.settings)

    air = content.aerodynamics
    engine = content.propulsion
    custom = content.dynamics
    coefficients = (
        read_function("aerodynamics", air) if isinstance(air, AerodynamicsFunction) else None
    )
    thrust = read_function("propulsion", engine) if isinstance(engine, ThrustFunction) else None
    dynamics = (
        read("dynamics", "file", Path(custom.file), "", dict(custom.settings)) if custom else None
    )
    if coefficients is None and thrust is None and dynamics is None:
        return None
    limits = content.state_limits()
    own_states = custom.states if custom else {}
    states = tuple(
        CustomState(
            name,
            si_unit_of(state.unit),
            None if state.start is None else parse_quantity(state.start, dimension_of(state.unit)),
            limits.get(name, math.inf),
        )
        for name, state in own_states.items()
    )
    x, z = reference_point(content)
    frame = air.frame if isinstance(air, AerodynamicsFunction) else "stability"
    mixed = tuple(
        (name, effector.aileron, effector.rudder, effector.elevator)
        for name, effector in content.effectors.items()
    )
    code = VehicleCode(
        aerodynamics=coefficients,
        propulsion=thrust,
        dynamics=dynamics,
        states=states,
        frame=frame,
        engine=(-x, -z),
        effectors=mixed,
        span=content.reference.span,
        chord=content.reference.chord,
        circular=frozenset(name for name, state in own_states.items() if state.circular),
    )
    names = [setting.name for setting in (*code.settings, *code.starts)]
    if duplicates := set(names).intersection(PARAMETER_NAMES):
        duplicate = min(duplicates)
        section = "dynamics" if duplicate.startswith("initial.") else duplicate.partition(".")[0]
        raise document.error(
            (section,), f"'{duplicate}' is the name of a built-in parameter", "another name"
        )
    if len(code.settings) + len(states) > MAX_SETTINGS:
        raise document.error(
            (),
            f"the functions have {counted(len(code.settings), 'setting')} and "
            f"{counted(len(states), 'state')}",
            f"at most {MAX_SETTINGS} in total",
        )
    return code


# largest plausible specific impulse, s
_LARGEST_IMPULSE = 1e4


@dataclass(frozen=True)
class VehicleFile:
    """Checked vehicle file with all files to which it refers."""

    path: Path
    content: VehicleDocument
    tables: Mapping[str, Table]  # tables in SI units and radians
    code: VehicleCode | None  # code of the custom functions; None if there are none
    mass_points: tuple[MassPoint, ...]
    files: tuple[Path, ...]  # the YAML file, then the other files without duplicates


@made_once
def read_vehicle_file(path: str | Path) -> VehicleFile:
    """Read and check a vehicle file and its tables. Raise InputError if a file is invalid."""
    document = read_document(path)
    content = validate(document, VehicleDocument)
    effectors = tuple(content.effectors)
    tables = {}
    for name, entry in content.tables.items():
        roles = {}
        for column, text in entry.columns.items():
            try:
                roles[column] = parse_role(text, effectors)
            except Refusal as refusal:
                raise document.error(
                    ("tables", name, "columns", column), refusal.found, refusal.expected
                ) from None
        if entry.file is not None:
            table = read_table(entry.file, roles, effectors, entry.comma)
        else:
            table = make_constant(entry.constant or 0.0)
        tables[name] = table.scaled(parse_unit(entry.unit)[0] * entry.scale)
        _check_meaning(document, content, name, tables[name])
    points = content.mass.points or read_mass_points(content.mass.file or Path())
    if len(points) > 1 and not points[0].mass <= content.mass.start <= points[-1].mass:
        raise document.error(
            ("mass", "start"),
            f"the initial mass is {content.mass.start:g} kg",
            f"{points[0].mass:g} to {points[-1].mass:g} kg, the range of the mass properties",
        )
    files = [entry.file for entry in content.tables.values() if entry.file]
    files += [content.mass.file] if content.mass.file else []
    code = make_code(document, content)
    files += [Path(function.file) for function in code.functions()] if code else []
    return VehicleFile(
        document.path, content, tables, code, points, (document.path, *dict.fromkeys(files))
    )


def read_mass_points(path: Path) -> tuple[MassPoint, ...]:
    """Read mass properties from columns such as ``mass_kg`` and ``inertia_xx_kg_m2``.

    Raise InputError if they are invalid.
    """
    table = read_foreign_table(path)
    columns = table.find(MassPoint.model_fields)
    table.check_heads(columns, MassPoint.model_fields)
    numbers = table.numbers([column.position for column in columns.values()])
    points: list[Any] = []
    locations: dict[tuple[str | int, ...], tuple[int, int]] = {(): (table.head_line, 1)}
    for row, line in enumerate(table.lines):
        named = zip(columns.items(), numbers[row].tolist(), strict=True)
        points.append({name: f"{number!r} {column.unit}" for (name, column), number in named})
        locations["points", row] = line, 1
    try:
        return validate(Document(path, {"points": points}, locations, {}), MassPoints).points
    except InputErrors as error:
        # A wrong header causes an error in every row; only the first error is reported.
        raise error.errors[0] from None


def _check_meaning(document: Document, content: VehicleDocument, name: str, table: Table) -> None:
    """Raise InputError for a table with implausible numbers, which usually means a wrong unit."""
    for axis in table.axes:
        low, high = axis.grid[[0, -1]]
        if VARIABLES[axis.variable] == "mass" and not low <= content.mass.start <= high:
            raise document.error(
                ("tables", name),
                f"the table covers masses from {low:g} to {high:g} kg",
                f"an axis that includes the initial mass, {content.mass.start:g} kg; check its "
                "unit",
            )
    if any(quantity == "specific_impulse" and used == name for used, quantity, _ in content.uses()):
        low = float(table.values.min())
        high = float(table.values.max())
        if low < 0.0 or high > _LARGEST_IMPULSE:
            raise document.error(
                ("tables", name),
                f"the specific impulse ranges from {low:g} to {high:g} s",
                f"0 to {_LARGEST_IMPULSE:g} s; check its unit",
            )


def pack_vehicle(file: VehicleFile, factor_index: Mapping[str, int]) -> Vehicle:
    """Return a vehicle for the kernel; ``factor_index`` maps parameter names to indices."""
    content = file.content
    entries: list[Table] = []
    entry_of: dict[tuple[str, float], int] = {}

    def use(name: str, scale: float = 1.0) -> int:
        """Return the index of a table among the entries, in which each table occurs only once."""
        if (name, scale) not in entry_of:
            entry_of[name, scale] = len(entries)
            entries.append(file.tables[name].scaled(scale))
        return entry_of[name, scale]

    terms: list[list[tuple[int, int, int, int]]] = [
        [] for _ in COEFFICIENTS
    ]  # Each term is (coefficient, table entry, variable, factor).
    for c, coefficient in enumerate(COEFFICIENTS):
        for term in getattr(content.aerodynamics, coefficient, ()):
            variable = _variable(term.times, tuple(content.effectors))
            factor = factor_index.get(f"aero.{coefficient}.{term.times}", 0)
            terms[c].append((c, use(term.table, term.scale), VARIABLES.index(variable), factor))
    fixed = {}
    for quantity, key in PROPULSION_TABLES.items():
        if used := getattr(content.propulsion, key, None):
            fixed[quantity] = use(used)
    for name, table in _mass_tables(file.mass_points, reference_point(content)).items():
        fixed[name] = len(entries)
        entries.append(table)

    if isinstance(content.aerodynamics, AerodynamicsFunction) and content.aerodynamics.nodes:
        # The nodes of a table of zeros are the kinks of a custom function.
        axes = tuple(
            Axis(VARIABLES.index(name), np.array(grid))
            for name, grid in content.aerodynamics.nodes.items()
        )
        entries.append(Table(axes, np.zeros([axis.grid.size for axis in axes])))
    tables, rows = pack_tables(entries, fixed)
    # Terms of different coefficients alternate, because consecutive additions are then independent.
    turns = [term for turn in itertools.zip_longest(*terms) for term in turn if term is not None]
    columns = np.array(turns, np.int64).reshape(-1, 4).T
    build_up = BuildUp(columns[0].copy(), rows[columns[1]], columns[2].copy(), columns[3].copy())
    foreign = file.code.pack() if file.code else no_functions()
    constants = _make_constants(content)
    named = {VARIABLES[i] for i in (*build_up.variable, *tables.axis_variable)}
    for function in file.code.functions() if file.code else ():
        named |= set(re.findall(r"\w+", function.text))
    mix, effectors, letters = pack_effectors(content.effectors, named)
    actuators = pack_actuators(content, effectors.mix)
    engines = np.array(
        engine_rows(content.propulsion.engines) if content.propulsion else []
    ).reshape(-1, 4)
    return Vehicle(
        constants=constants,
        tables=tables,
        build_up=build_up,
        effector_mix=mix,
        effectors=effectors,
        actuators=actuators,
        effector_names=letters,
        engines=engines,
        foreign=foreign,
    )


def _variable(times: str | None, effectors: tuple[str, ...]) -> str:
    if times is None:
        return "one"
    if times in REDUCED_RATES:
        return f"{times}_hat"
    return f"effector_{effectors.index(times)}" if times in effectors else times


def _mass_tables(points: tuple[MassPoint, ...], reference: tuple[float, float]) -> dict[str, Table]:
    """Return the mass properties as tables that depend on the mass."""
    _, *fields = MassPoint.model_fields  # The mass is followed by the fields of the last rows.
    values = {
        name: np.array([getattr(point, field) for point in points])
        for name, field in zip(FIXED_TABLE_ROWS[-len(fields) :], fields, strict=True)
    }
    for name, offset in zip(("center_of_gravity_x", "center_of_gravity_z"), reference, strict=True):
        values[name] = values[name] - offset if offset else values[name]
    if len(points) == 1:
        return {name: make_constant(float(column[0])) for name, column in values.items()}
    axis = Axis(VARIABLES.index("mass"), np.array([point.mass for point in points]))
    return {name: Table((axis,), column) for name, column in values.items()}


def _make_constants(content: VehicleDocument) -> Constants:
    """Return a vehicle's constants, with neutral values if engine or surfaces are missing."""
    engine = content.propulsion
    surfaces = content.surfaces
    limits = content.limits
    capture = engine if isinstance(engine, Capture) else None
    jet = None if isinstance(engine, ThrustFunction) else engine
    eta_min, eta_max = throttle_range(engine)
    alpha_min, alpha_max = limits.angle_of_attack if limits else (-math.pi, math.pi)
    inclination = jet.thrust_line.inclination if jet else 0.0
    _, below = reference_point(content)
    return Constants(
        area=content.reference.area,
        span=content.reference.span,
        chord=content.reference.chord,
        capture_thrust=capture.stoichiometric_ratio * capture.cowl_area * capture.standard_gravity
        if capture
        else 0.0,
        standard_gravity=jet.standard_gravity if jet else 9.80665,
        thrust_cos=math.cos(inclination),
        thrust_sin=math.sin(inclination),
        thrust_offset_z=jet.thrust_line.offset - below if jet else 0.0,
        mass_start=content.mass.start,
        mass_empty=content.mass.start if content.mass.empty is None else content.mass.empty,
        burns_fuel=0.0 if content.mass.empty is None else 1.0,
        surface_limit=surfaces.limit if surfaces else 0.0,
        equivalence_ratio_min=eta_min,
        equivalence_ratio_max=eta_max,
        angle_of_attack_min=alpha_min,
        angle_of_attack_max=alpha_max,
        sideslip_max=limits.sideslip if limits else math.pi,
        drag_in_wind_axes=1.0
        if getattr(content.aerodynamics, "force_axes", "stability") == "wind"
        else 0.0,
        nose_radius=content.reference.nose_radius or 0.0,
        inlet=engine.unstart.inlet() if engine and engine.unstart else Inlet(),
        bounds=limits.bounds() if limits else LoadBounds(),
        sensing=choose_sensing(content.sensing, Sensing()),
        relight_delay=jet.relight.delay if jet else 0.0,
        relight_time_constant=jet.relight.time_constant if jet else 0.0,
        driven=float(any(effector.driven for effector in content.effectors.values())),
        envelope=Envelope(*limits.altitude, *limits.mach) if limits else Envelope(),
    )
