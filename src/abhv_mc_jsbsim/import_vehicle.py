"""Import of a JSBSim model as a Python module and a vehicle file.

The mass is that of the empty vehicle, the point masses and the contents of the tanks.
"""

import hashlib
import math
import textwrap
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import one_of
from abhv_mc.io.xml_reader import Node, fold, read_xml
from abhv_mc_jsbsim.aerodynamics import Aerodynamics
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
from abhv_mc_vehicle.imported_vehicle import LIMIT, Body, write_module, write_vehicle
from abhv_mc_vehicle.user_code.module import run_module
from abhv_mc_vehicle.user_code.module_text import (
    WIDTH,
    Line,
    declare,
    define,
    number,
    write_unless_edited,
)

_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")


_UNITS = {  # factors to SI by quantity and unit
    "length": {"FT": FOOT, "IN": INCH, "M": 1.0},
    "area": {"FT2": SQUARE_FOOT, "M2": 1.0},
    "mass": {"LBS": POUND, "KG": 1.0, "SLUG": SLUG},
    "inertia": {"SLUG*FT2": SLUG * SQUARE_FOOT, "KG*M2": 1.0},
}


def _in_si(node: Node, text: str, kind: str, unit: str) -> float:
    """Return a number of an element in SI units; ``unit`` is the default unit.

    Raise InputError if the number or its unit is invalid.
    """
    factors = _UNITS[kind]
    name = node.attributes.get("unit", unit)
    if name not in factors:
        raise node.refuse(f"found the unit '{name}'", one_of(factors, name))
    return node.number(text) * factors[name]


def quantity(node: Node | None, kind: str, unit: str) -> float:
    """Return the number in an element in SI units, or 0 if there is no element."""
    return _in_si(node, node.text, kind, unit) if node else 0.0


def location(node: Node | None) -> Floats:
    """Return a position [axis] in the structural frame (aft, right, up) in metres."""
    if node is None:
        return np.zeros(3)
    return np.array([_in_si(node, node.words(axis) or "0", "length", "IN") for axis in "xyz"])


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
    xx, yy, zz, *products = (
        quantity(balance.first(f"i{axis}"), "inertia", "SLUG*FT2") for axis in _AXES
    )
    negated = balance.attributes.get("negated_crossproduct_inertia") != "false"
    xy, xz, yz = (product if negated else -product for product in products)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
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
    locations = (entry for entry in node.all("location") if entry.attributes.get("name") == name)
    return next(locations, None)


_MODULE = "aerodynamics.py"
_VEHICLE = "vehicle.yaml"
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
    root, content = read_xml(path, "a JSBSim model", "fdm_config")
    metrics = _section(root, "metrics")
    node = _section(root, "aerodynamics")
    mass = read_mass(_section(root, "mass_balance"), root.first("propulsion"))
    center = to_body(mass.center - location(_located(metrics, "AERORP")))
    properties = _read_metrics(metrics)
    properties |= {"inertia/weight-lbs": mass.mass / POUND, "inertia/mass-slugs": mass.mass / SLUG}
    values = {
        child.text: child.number(child.attributes["value"])
        for parent in (root, node)
        for child in parent.all("property")
        if "value" in child.attributes
    }
    aerodynamics = Aerodynamics(node, properties, values, _full_deflections(root))
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
    low, high = _rising_lift(module, aerodynamics)
    limits = f"""\
limits: # range in which the lift increases at low speed
  angle_of_attack: [{low:g} deg, {high:g} deg]
  sideslip: 30 deg"""
    body = Body(
        area=properties[AREA] * SQUARE_FOOT,
        span=properties[SPAN] * FOOT,
        chord=properties[CHORD] * FOOT,
        mass=float(mass.mass),
        inertia=mass.inertia[[0, 1, 2, 0], [0, 1, 2, 2]].tolist(),
        center=center[[0, 2]].tolist(),
    )
    texts = {
        _MODULE: module,
        _VEHICLE: write_vehicle(
            path.stem,
            [
                f"Imported from {path.name} (JSBSim). Parts that are not imported:",
                *(f"- {note}" for note in left_out),
                f"The mass is that of {', '.join(('the empty vehicle', *mass.added))}.",
            ],
            body,
            (_write_section(aerodynamics), limits),
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
    for name, key in (
        ("wingarea", AREA),
        ("wingspan", SPAN),
        ("chord", CHORD),
        ("htailarea", "metrics/Sh-sqft"),
        ("htailarm", "metrics/lh-ft"),
        ("vtailarea", "metrics/Sv-sqft"),
        ("vtailarm", "metrics/lv-ft"),
    ):
        node = metrics.first(name)
        if key.endswith("-sqft"):
            properties[key] = quantity(node, "area", "FT2") / SQUARE_FOOT
        else:
            properties[key] = quantity(node, "length", "FT") / FOOT
        if key in (AREA, SPAN, CHORD) and not properties[key] > 0.0:
            raise (node or metrics).refuse(
                f"the {name} is {properties[key]:g}", "a positive number"
            )
    return properties


def _full_deflections(root: Node) -> dict[str, float]:
    """Return full deflections (rad) by output property of flight-control components."""
    deflections = {"": math.radians(LIMIT)}
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
    about = "Constants of the vehicle file."
    lines = [
        *(define("class Settings(NamedTuple):", about, settings) if settings else ()),
        *aerodynamics.tables,
        *define(signature, doc, aerodynamics.body),
    ]
    lengths = {"SPAN": (properties[SPAN] * FOOT, "m"), "CHORD": (properties[CHORD] * FOOT, "m")}
    constants = [
        Line(f"{name} = {number(value)}", unit)
        for name, (value, unit) in (CONSTANTS | lengths).items()
    ]
    return write_module(textwrap.fill(origin, WIDTH), constants, lines)


def _rising_lift(module: str, aerodynamics: Aerodynamics) -> tuple[float, float]:
    """Return the range of angles of attack around 0 (deg) in which the lift increases."""
    function = run_module(UserSource(module, _MODULE)).names["coefficients"]
    settings = SimpleNamespace(**{s.key: s.value for s in aerodynamics.settings.values()})
    rates = ("roll_rate", "pitch_rate", "yaw_rate")
    zero = SimpleNamespace(**dict.fromkeys((*_SURFACES, *rates), 0.0))
    lift = []
    angles = np.arange(_ANGLES[0], _ANGLES[1] + 0.25, 0.5)
    for angle in np.radians(angles):
        air = SimpleNamespace(**_LOW_SPEED, angle_of_attack=float(angle))
        try:
            coefficients = function(air, zero, zero, settings)
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


def _write_section(aerodynamics: Aerodynamics) -> str:
    """Return the section ``aerodynamics`` of the vehicle file."""
    lines = ["aerodynamics:", f"  python: {_MODULE}", f"  frame: {aerodynamics.frame}"]
    if aerodynamics.settings:
        lines.append("  settings: # properties that abhv-mc does not model")
    for name, setting in aerodynamics.settings.items():
        lines.append(f"    {setting.key}: {setting.value!r} # {fold(name)}")
    return "\n".join(lines)
