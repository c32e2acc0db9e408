"""Import of a JSBSim model as a Python module and a vehicle file."""

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
from abhv_mc.io.xml_reader import Node, fold, read_xml
from abhv_mc_jsbsim.aerodynamics import Aerodynamics
from abhv_mc_jsbsim.expressions import FROM_MATH
from abhv_mc_jsbsim.mass import Mass, quantity, read_mass, reference_point, to_body
from abhv_mc_jsbsim.properties import AREA, CHORD, CONSTANTS, FOOT, POUND, SLUG, SPAN, SQUARE_FOOT
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

_MODULE, _VEHICLE = "aerodynamics.py", "vehicle.yaml"
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
    metrics, node = _section(root, "metrics"), _section(root, "aerodynamics")
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
        limits, output = node.first("range"), node.words("output")
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
