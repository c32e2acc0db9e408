"""The mass of a JSBSim model as the file states it: the empty vehicle, its point masses and what its tanks hold."""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import one_of
from abhv_mc.io.xml_reader import Node
from abhv_mc_jsbsim.properties import FOOT, INCH, POUND, SLUG, SQUARE_FOOT

_UNITS = {
    "length": {"FT": FOOT, "IN": INCH, "M": 1.0},
    "area": {"FT2": SQUARE_FOOT, "M2": 1.0},
    "mass": {"LBS": POUND, "KG": 1.0, "SLUG": SLUG},
    "inertia": {"SLUG*FT2": SLUG * SQUARE_FOOT, "KG*M2": 1.0},
}
_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")


def quantity(node: Node | None, kind: str, unit: str, missing: float = 0.0) -> float:
    """The number of an element in SI; ``unit`` where it names none. Raises InputError."""
    if node is None:
        return missing
    known, given = _UNITS[kind], node.attributes.get("unit", unit)
    if given not in known:
        raise node.refuse(f"the unit '{given}'", one_of(known, given))
    return node.number(node.text) * known[given]


def location(node: Node | None) -> Floats:
    """A place ``[axis]`` in the structural frame, m: aft, right, up. Raises InputError."""
    if node is None:
        return np.zeros(3)
    factor = _UNITS["length"].get(node.attributes.get("unit", "IN"))
    if factor is None:
        raise node.refuse(f"the unit '{node.attributes['unit']}'", one_of(_UNITS["length"]))
    return factor * np.array([node.number(node.words(axis) or "0") for axis in "xyz"])


@dataclass(frozen=True)
class Mass:
    """Mass, centre of gravity in the structural frame and inertia matrix about it in body axes, SI."""

    mass: float
    center: Floats  # [axis]
    inertia: Floats  # [axis, axis]
    added: tuple[str, ...]  # what is in it beside the empty vehicle


def read_mass(balance: Node, propulsion: Node | None) -> Mass:
    """Add up the mass of a model. Raises InputError."""
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
        form = " (as a point, without its form)" if point.first("form") is not None else ""
        added.append(f"{name} {mass:.4g} kg{form}")
    for k, tank in enumerate(propulsion.all("tank") if propulsion else ()):
        mass = quantity(tank.first("contents"), "mass", "LBS")
        bodies.append((mass, location(tank.first("location"))))
        radius = quantity(tank.first("radius"), "length", "IN")
        inertia += 0.4 * mass * radius**2 * np.eye(3)
        added.append(f"tank {k} {mass:.4g} kg")
    total = sum(mass for mass, _ in bodies)
    if not total > 0.0:
        raise balance.refuse(f"a mass of {total:g} kg", "one above 0")
    center = np.sum([mass * place for mass, place in bodies], axis=0) / total
    for mass, place in bodies:
        arm = to_body(place - center)
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(total, center, inertia, tuple(added))


def to_body(structural: Floats) -> Floats:
    """Forward, right, down of aft, right, up."""
    return structural * np.array([-1.0, 1.0, -1.0])


def _located(node: Node, name: str) -> Node | None:
    places = node.all("location")
    return next((place for place in places if place.attributes.get("name") == name), None)


def reference_point(metrics: Node) -> Floats:
    """Where the aerodynamic forces act, in the structural frame, m."""
    return location(_located(metrics, "AERORP"))


def _matrix(of: dict[str, float], sign: float) -> Floats:
    xy, xz, yz = (sign * of[axis] for axis in ("xy", "xz", "yz"))
    return np.array([[of["xx"], xy, xz], [xy, of["yy"], yz], [xz, yz, of["zz"]]])
