"""Import of a JSBSim model as a Python module and a vehicle file.

The mass is that of the empty vehicle, the point masses and the contents of the tanks.
"""

import hashlib
import math
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from abhv_mc import extend
from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import one_of
from abhv_mc.io.xml_reader import Node, fold, read_xml
from abhv_mc_jsbsim.aerodynamics import Aerodynamics
from abhv_mc_jsbsim.expressions import FROM_MATH
from abhv_mc_jsbsim.properties import (
    AREA,
    CHORD,
    CONSTANTS,
    FOOT,
    INCH,
    POUND,
    SLUG,
    SPAN,
    SQUARE_FOOT,
)
from abhv_mc_vehicle.user_code.module import run_module
from abhv_mc_vehicle.user_code.module_text import (
    WIDTH,
    Line,
    declare,
    define,
    free_name,
    import_names,
    lay_out,
    names_in,
    number,
    write_unless_edited,
)

_UNITS = {
    "length": {"FT": FOOT, "IN": INCH, "M": 1.0},
    "area": {"FT2": SQUARE_FOOT, "M2": 1.0},
    "mass": {"LBS": POUND, "KG": 1.0, "SLUG": SLUG},
    "inertia": {"SLUG*FT2": SLUG * SQUARE_FOOT, "KG*M2": 1.0},
}
_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")


def quantity(node: Node | None, kind: str, unit: str) -> float:
    """Return the number in an element in SI units; ``unit`` is the default unit.

    Raise InputError if the number or its unit is invalid.
    """
    if node is None:
        return 0.0
    factors = _UNITS[kind]
    name = node.attributes.get("unit", unit)
    if name not in factors:
        raise node.refuse(f"found the unit '{name}'", one_of(factors, name))
    return node.number(node.text) * factors[name]


def location(node: Node | None) -> Floats:
    """Return a position [axis] in the structural frame (aft, right, up) in metres.

    Raise InputError if the element is invalid.
    """
    if node is None:
        return np.zeros(3)
    factor = _UNITS["length"].get(node.attributes.get("unit", "IN"))
    if factor is None:
        raise node.refuse(f"found the unit '{node.attributes['unit']}'", one_of(_UNITS["length"]))
    return factor * np.array([node.number(node.words(axis) or "0") for axis in "xyz"])


@dataclass(frozen=True)
class Mass:
    """Mass, centre of gravity in the structural frame, and inertia matrix in body axes.

    All values are in SI units. The inertia matrix is about the centre of gravity.
    """

    mass: float
    center: Floats  # position of the centre of gravity [axis]
    inertia: Floats  # inertia matrix [axis, axis]
    added: tuple[str, ...]  # descriptions of masses added to the empty vehicle


def read_mass(balance: Node, propulsion: Node | None) -> Mass:
    """Return the total mass of a model. Raise InputError if it is not positive."""
    empty = quantity(balance.first("emptywt"), "mass", "LBS")
    bodies = [(empty, location(_located(balance, "CG")))]
    own = {axis: quantity(balance.first(f"i{axis}"), "inertia", "SLUG*FT2") for axis in _AXES}
    negated = balance.attributes.get("negated_crossproduct_inertia") != "false"
    inertia = _matrix(own, 1.0 if negated else -1.0)
    added = []
    for point in balance.all("pointmass"):
        mass = quantity(point.first("weight"), "mass", "LBS")
        bodies.append((mass, location(point.first("location"))))
        name = point.attributes.get("name", "point mass")
        form = " (as a point mass)" if point.first("form") is not None else ""
        added.append(f"{name} {mass:.4g} kg{form}")
    for k, tank in enumerate(propulsion.all("tank") if propulsion else ()):
        mass = quantity(tank.first("contents"), "mass", "LBS")
        bodies.append((mass, location(tank.first("location"))))
        radius = quantity(tank.first("radius"), "length", "IN")
        inertia += 0.4 * mass * radius**2 * np.eye(3)
        added.append(f"tank {k} {mass:.4g} kg")
    total = sum(mass for mass, _ in bodies)
    if not total > 0.0:
        raise balance.refuse(f"the mass is {total:g} kg", "a positive mass")
    center = np.sum([mass * position for mass, position in bodies], axis=0) / total
    for mass, position in bodies:
        arm = to_body(position - center)
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(total, center, inertia, tuple(added))


def to_body(structural: Floats) -> Floats:
    """Convert a vector from the structural frame to body axes (forward, right, down)."""
    return structural * np.array([-1.0, 1.0, -1.0])


def _located(node: Node, name: str) -> Node | None:
    locations = node.all("location")
    return next(
        (
            node_location
            for node_location in locations
            if node_location.attributes.get("name") == name
        ),
        None,
    )


def reference_point(metrics: Node) -> Floats:
    """Return the reference point (m) of the aerodynamic forces in the structural frame."""
    return location(_located(metrics, "AERORP"))


def _matrix(moments: dict[str, float], sign: float) -> Floats:
    xy, xz, yz = (sign * moments[axis] for axis in ("xy", "xz", "yz"))
    return np.array([[moments["xx"], xy, xz], [xy, moments["yy"], yz], [xz, yz, moments["zz"]]])


_MODULE = "aerodynamics.py"
_VEHICLE = "vehicle.yaml"
_LIMIT = 30.0  # assumed deflection limit, deg; the limits in the model are not read
_ANGLES = (-20.0, 45.0)  # widest range of angles of attack in deg
_LOW_SPEED = {
    "altitude": 0.0,
    "mach": 0.3,
    "density": 1.225,
    "pressure": 101325.0,
    "sound_speed": 340.0,
    "dynamic_pressure": 6373.0,
    "airspeed": 102.0,
    "sideslip": 0.0,
}
_SURFACES = ("aileron", "rudder", "elevator")
_UNREAD = {  # items and description of each section that is not imported
    "ground_reactions": ("contact", "landing gear and contacts"),
    "external_reactions": ("force", "external forces"),
    "buoyant_forces": ("gas_cell", "buoyant forces"),
    "flight_control": ("channel", "flight control"),
    "autopilot": ("channel", "autopilot"),
    "system": ("channel", "system"),
}


@dataclass(frozen=True)
class Imported:
    """Result of an import: files written, and parts of the model that are not imported."""

    paths: tuple[Path, ...]
    left_out: tuple[str, ...]
    settings: tuple[str, ...]  # properties that are constants in the vehicle file
    kept: tuple[Path, ...]  # edited files, next to which new versions are written


def import_jsbsim(path: Path, folder: Path) -> Imported:
    """Import a JSBSim model into a folder. Raise InputError if the model is unsuitable."""
    root, content = read_xml(path, "a JSBSim model")
    if root.name != "fdm_config":
        raise root.refuse(
            f"found the element '{root.name}'", "the element 'fdm_config' of a JSBSim model"
        )
    metrics = _section(root, "metrics")
    node = _section(root, "aerodynamics")
    mass = read_mass(_section(root, "mass_balance"), root.first("propulsion"))
    center = to_body(mass.center - reference_point(metrics))
    properties = _read_metrics(metrics)
    properties |= {"inertia/weight-lbs": mass.mass / POUND, "inertia/mass-slugs": mass.mass / SLUG}
    values = {
        child.text: child.number(child.attributes["value"])
        for parent in (root, node)
        for child in parent.all("property")
        if "value" in child.attributes
    }
    reserved = (*extend.__all__, *FROM_MATH, *CONSTANTS, "SPAN", "CHORD")
    aerodynamics = Aerodynamics(node, properties, values, _full_deflections(root), reserved)
    origin = (
        f"Imported from {fold(path.name)} (JSBSim), SHA-256 {hashlib.sha256(content).hexdigest()}."
    )
    module = _write_module(aerodynamics, origin, properties)
    idle = [
        f"the {name}, which no function uses"
        for name in _SURFACES
        if f"controls.{name}" not in module
    ]
    left_out = (*_left_out(root, mass, center), *aerodynamics.notes, *idle)
    angles = _rising_lift(module, aerodynamics)
    texts = {
        _MODULE: module,
        _VEHICLE: _write_vehicle(
            path, aerodynamics, mass, center, properties, angles=angles, left_out=left_out
        ),
    }
    paths, edited = write_unless_edited(folder, texts)
    return Imported(tuple(paths), left_out, tuple(aerodynamics.settings), edited)


def _section(root: Node, name: str) -> Node:
    """Return a section of the model, which may be in a separate file.

    Raise InputError if the section is missing or empty.
    """
    node = root.first(name)
    if node is not None and (file := node.attributes.get("file")):
        path = root.path.parent / (file if file.endswith(".xml") else f"{file}.xml")
        node = read_xml(path, f"the {name} of a JSBSim model")[0]
    if node is None or not node.children:
        raise (node or root).refuse(f"the element '{name}' is missing", f"a model with '{name}'")
    return node


def _read_metrics(metrics: Node) -> dict[str, float]:
    """Return the metrics by property name, in the units of JSBSim.

    Raise InputError if a metric is invalid.
    """
    properties = {}
    for name, kind, unit, key in (
        ("wingarea", "area", SQUARE_FOOT, AREA),
        ("wingspan", "length", FOOT, SPAN),
        ("chord", "length", FOOT, CHORD),
        ("htailarea", "area", SQUARE_FOOT, "metrics/Sh-sqft"),
        ("htailarm", "length", FOOT, "metrics/lh-ft"),
        ("vtailarea", "area", SQUARE_FOOT, "metrics/Sv-sqft"),
        ("vtailarm", "length", FOOT, "metrics/lv-ft"),
    ):
        node = metrics.first(name)
        properties[key] = quantity(node, kind, {"area": "FT2", "length": "FT"}[kind]) / unit
        if key in (AREA, SPAN, CHORD) and not properties[key] > 0.0:
            raise (node or metrics).refuse(
                f"the {name} is {properties[key]:g}", "a positive number"
            )
    return properties


def _full_deflections(root: Node) -> dict[str, float]:
    """Return full deflections (rad) by output property of flight-control components."""
    deflections = {"": math.radians(_LIMIT)}
    pending = list(root.all("flight_control"))
    while pending:
        node = pending.pop()
        pending += node.children
        limits = node.first("range")
        output = node.words("output")
        if limits is not None and output.endswith("-rad"):
            ends = [abs(limits.number(limits.words(end) or "0")) for end in ("min", "max")]
            deflections[output] = max(ends) or deflections[""]
    return deflections


def _engine(node: Node) -> str:
    thruster = node.first("thruster")
    driven = f" with {thruster.attributes.get('file', '')}" if thruster else ""
    return f"engine {node.attributes.get('file', '')}{driven}"


def _left_out(root: Node, mass: Mass, center: Floats) -> list[str]:
    """Describe the parts of a model that a vehicle file cannot represent."""
    notes = []
    for name, (child, description) in _UNREAD.items():
        for section in root.all(name):
            title = section.attributes.get("name") or section.attributes.get("file") or ""
            names = [fold(item.attributes.get("name", child)) for item in section.all(child)]
            items = ", ".join(filter(None, (fold(title), *names)))
            if section.children or section.attributes:
                notes.append(f"{description}: {items}" if items else description)
    propulsion = root.first("propulsion")
    engines = Counter(map(_engine, propulsion.all("engine") if propulsion else ()))
    notes += [
        f"{engine} ({count} times)" if count > 1 else engine for engine, count in engines.items()
    ]
    if abs(center[1]) > 1e-6:
        notes.append(f"centre of gravity {center[1]:.4g} m to the right of the plane of symmetry")
    for axis, (i, k) in {"xy": (0, 1), "yz": (1, 2)}.items():
        if abs(mass.inertia[i, k]) > 1e-9 * np.trace(mass.inertia):
            notes.append(
                f"element {i + 1}{k + 1} of the inertia matrix ({axis}), "
                f"{mass.inertia[i, k]:.4g} kg m2"
            )
    return notes


def _write_module(aerodynamics: Aerodynamics, origin: str, properties: dict[str, float]) -> str:
    settings = [
        declare(setting.key, f"{fold(name)}, of {fold(', '.join(setting.used_by))}")
        for name, setting in aerodynamics.settings.items()
    ]
    signature = "def coefficients(air, controls, rates, settings):"
    doc = f"Coefficients in {aerodynamics.frame} axes, moments about the model's reference point."
    lines = [
        *(
            define("class Settings(NamedTuple):", "Constants of the vehicle file.", settings)
            if settings
            else ()
        ),
        *aerodynamics.tables,
        *define(signature, doc, aerodynamics.body),
    ]
    used = names_in(lines)
    modules = (("math", FROM_MATH), ("typing", ("NamedTuple",)), ("abhv_mc.extend", extend.__all__))
    lengths = {"SPAN": (properties[SPAN] * FOOT, "m"), "CHORD": (properties[CHORD] * FOOT, "m")}
    constants = [
        Line(f"{name} = {number(value)}", unit)
        for name, (value, unit) in (CONSTANTS | lengths).items()
        if name in used
    ]
    return lay_out(textwrap.fill(origin, WIDTH), [*import_names(used, modules), *constants, *lines])


def _rising_lift(module: str, aerodynamics: Aerodynamics) -> tuple[float, float]:
    """Return the range of angles of attack around 0 (deg) in which the lift increases."""
    function = run_module(UserSource(module, _MODULE)).names["coefficients"]
    settings = SimpleNamespace(
        **{setting.key: setting.value for setting in aerodynamics.settings.values()}
    )
    controls, rates = (
        SimpleNamespace(**dict.fromkeys(names, 0.0))
        for names in (_SURFACES, ("roll_rate", "pitch_rate", "yaw_rate"))
    )
    lift = []
    angles = np.arange(_ANGLES[0], _ANGLES[1] + 0.25, 0.5)
    for angle in np.radians(angles):
        air = SimpleNamespace(**_LOW_SPEED, angle_of_attack=float(angle))
        try:
            coefficients = function(air, controls, rates, settings)
        # A function may divide by an angle of 0, for example.
        except (ArithmeticError, ValueError):
            return _ANGLES
        lift.append(
            coefficients.CL + coefficients.CX * np.sin(angle) - coefficients.CZ * np.cos(angle)
        )
    middle = int(np.argmin(np.abs(angles)))
    falls = np.flatnonzero(np.diff(lift) <= 0.0)
    first = max(falls[falls < middle], default=-1) + 1
    last = min(falls[falls >= middle], default=len(angles) - 1)
    return (float(angles[first]), float(angles[last])) if first < last else _ANGLES


def _write_vehicle(
    path: Path,
    aerodynamics: Aerodynamics,
    mass: Mass,
    center: Floats,
    properties: dict[str, float],
    *,
    angles: tuple[float, float],
    left_out: Sequence[str],
) -> str:
    inertia = mass.inertia
    settings = [
        f"    {setting.key}: {setting.value!r} # {fold(name)}"
        for name, setting in aerodynamics.settings.items()
    ]
    lines = [
        f"# Imported from {fold(path.name)} (JSBSim). Parts that are not imported:",
        *(f"# - {fold(note)}" for note in left_out),
        f"name: {free_name(path.stem.lower())}",
        "",
        "reference:",
        f"  area: {properties[AREA] * SQUARE_FOOT!r} m2",
        f"  span: {properties[SPAN] * FOOT!r} m",
        f"  chord: {properties[CHORD] * FOOT!r} m",
        "",
        f"mass: # the empty vehicle{''.join(f', {fold(note)}' for note in mass.added)}",
        f"  start: {float(mass.mass)!r} kg",
        "  points:",
        f"    - mass: {float(mass.mass)!r} kg",
        *(
            f"      inertia_{axis * 2}: {float(inertia[k, k])!r} kg m2"
            for k, axis in enumerate("xyz")
        ),
        f"      inertia_matrix_element_13: {float(inertia[0, 2])!r} kg m2",
        f"      center_of_gravity_x: {float(center[0])!r} m",
        f"      center_of_gravity_z: {float(center[2])!r} m",
        "",
        "surfaces: # the flight control of the model is not imported",
        "  ideal: true",
        f"  limit: {_LIMIT:g} deg",
        "",
        "aerodynamics:",
        f"  python: {_MODULE}",
        f"  frame: {aerodynamics.frame}",
        *(["  settings: # properties that abhv-mc does not model", *settings] if settings else ()),
        "",
        "limits: # range in which the lift increases at low speed",
        f"  angle_of_attack: [{angles[0]:g} deg, {angles[1]:g} deg]",
        "  sideslip: 30 deg",
    ]
    return "\n".join(lines) + "\n"
