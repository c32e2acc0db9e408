"""Python module and vehicle file of an imported vehicle, as all importers write them."""

import ast
import functools
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

from abhv_mc import extend
from abhv_mc.io.messages import counted
from abhv_mc.io.xml_reader import Node, fold
from abhv_mc_vehicle.user_code.module_text import Line, free_name, import_names, lay_out, names_in

FROM_MATH = ("ceil", "floor", "fmod", "trunc")
RESERVED = frozenset((*extend.__all__, *FROM_MATH, "NamedTuple", "DEGREE", "SPAN", "CHORD"))
LIMIT = 30.0  # assumed deflection limit, deg; the imported files do not describe actuators
_MODULES = (("math", FROM_MATH), ("typing", ("NamedTuple",)), ("abhv_mc.extend", extend.__all__))


def tidy(node: Node, text: str) -> str:
    """Return the expression of an element without superfluous brackets.

    Raise InputError if the expression is nested too deeply for Python.
    """
    try:
        return ast.unparse(ast.parse(text, mode="eval"))
    # These errors may be raised by Python's parser.
    except (SyntaxError, RecursionError, MemoryError):
        raise node.refuse(
            "the calculation is nested too deeply", "intermediate results as separate variables"
        ) from None


def power(base: str, exponent: str) -> str:
    """Return the expression of a power; an integer exponent is valid for a negative base."""
    try:
        value = float(ast.literal_eval(exponent))
    except ValueError:
        return f"power({base}, {exponent})"
    is_integer = abs(value) <= 64 and value == int(value)
    return f"({base} ** {int(value)})" if is_integer else f"power({base}, {exponent})"


class Operators(NamedTuple):
    """Python expressions of the operators of a file format."""

    between: Mapping[str, str]  # Python operator between two or more operands
    folded: Mapping[str, str]  # pattern of two operands, applied to the first and each further one
    fixed: Mapping[int, Mapping[str, str]]  # patterns by number of operands

    @property
    def names(self) -> list[str]:
        """Names of the operators."""
        return list(dict.fromkeys(chain(self.between, self.folded, *self.fixed.values())))

    def apply(self, node: Node, name: str, operands: Sequence[str]) -> str:
        """Return an operator's expression. Raise InputError for a wrong number of operands."""
        count = len(operands)
        if name in self.between and count > 1:
            return f"({f' {self.between[name]} '.join(operands)})"
        if name in self.folded and count:
            return functools.reduce(self.folded[name].format, operands)
        if pattern := self.fixed.get(count, {}).get(name):
            return pattern.format(*operands)
        raise node.refuse(
            f"'{name}' has {counted(count, 'operand')}",
            "the number of operands that the operator requires",
        )


def write_module(docstring: str, constants: Iterable[Line], lines: Sequence[Line]) -> str:
    """Return the text of a module with its imports, and with those constants that it uses."""
    used = names_in(lines)
    defined = [line for line in constants if line.text.partition(" ")[0] in used]
    return lay_out(docstring, [*import_names(used, _MODULES), *defined, *lines])


class Body(NamedTuple):
    """Reference dimensions and mass properties in SI units and body axes."""

    area: float
    span: float
    chord: float
    mass: float
    inertia: Sequence[float]  # elements 11, 22, 33 and 13 of the inertia matrix
    center: Sequence[float]  # x and z of the centre of gravity from the moment reference


def write_vehicle(name: str, comments: Iterable[str], body: Body, sections: Iterable[str]) -> str:
    """Return the text of a vehicle file; ``sections`` follow the mass and the surfaces."""
    head = "".join(f"# {fold(comment)}\n" for comment in comments)
    xx, yy, zz, element_13 = body.inertia
    x, z = body.center
    fixed = f"""\
{head}name: {free_name(name.lower())}

reference:
  area: {body.area!r} m2
  span: {body.span!r} m
  chord: {body.chord!r} m

mass:
  start: {body.mass!r} kg
  points:
    - mass: {body.mass!r} kg
      inertia_xx: {xx!r} kg m2
      inertia_yy: {yy!r} kg m2
      inertia_zz: {zz!r} kg m2
      inertia_matrix_element_13: {element_13!r} kg m2 # minus the product of inertia
      center_of_gravity_x: {x!r} m
      center_of_gravity_z: {z!r} m

surfaces: # actuators are not imported
  ideal: true
  limit: {LIMIT:g} deg"""
    return "\n\n".join((fixed, *sections)) + "\n"
