"""Mass of a JSBSim model: empty vehicle, point masses and contents of the tanks."""

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
    """Return the number in an element in SI units; ``unit`` is the default unit.

    Raise InputError if the number or its unit is invalid.
    """
    if node is None:
        return missing
    factors, name = _UNITS[kind], node.attributes.get("unit", unit)
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
