"""MathML calculations as Python expressions, by a fixed list of operators."""

import ast
import functools
import math
from collections.abc import Iterator
from typing import Any

from abhv_mc.daveml.python_nodes import fill, name, number
from abhv_mc.daveml.xml_reader import Node
from abhv_mc.io.input_error import one_of

VARIABLE = "$"  # begins the name of a variable of the file, which no name of Python does

_RELATIONS = {"gt": ast.Gt, "lt": ast.Lt, "geq": ast.GtE, "leq": ast.LtE, "eq": ast.Eq, "neq": ast.NotEq}
_LOGIC = {"and": "a and b", "or": "a or b", "xor": "a != b", "not": "not a"}
_UNARY = {
    **{name: f"{name}(a)" for name in ("abs", "exp", "floor", "sin", "cos", "tan")},
    "ln": "log(a)",
    "ceiling": "ceil(a)",
    "sec": "1.0 / cos(a)",
    "csc": "1.0 / sin(a)",
    "cot": "1.0 / tan(a)",
    "sinh": "0.5 * (exp(a) - exp(-a))",
    "cosh": "0.5 * (exp(a) + exp(-a))",
    "tanh": "1.0 - 2.0 / (exp(2.0 * a) + 1.0)",
    "arcsin": "asin(a)",
    "arccos": "acos(a)",
    "arctan": "atan2(a, 1.0)",
}
_BINARY = {
    "divide": "a / b",
    "power": "power(a, b)",
    "quotient": "trunc(a / b)",
    "rem": "fmod(a, b)",
    "atan2": "atan2(a, b)",
}
_MANY = {"plus": "a + b", "times": "a * b", "max": "larger(a, b)", "min": "smaller(a, b)"}
_ONE_OR_TWO = {"minus": "a - b", "log": "log(a) / log(b)", "root": "power(a, 1.0 / b)"}
_WITHOUT_SECOND = {"minus": "-a", "log": "log(a) / log(10.0)", "root": "sqrt(a)"}
_PYTHON = {**_UNARY, **_BINARY, **_MANY, **_ONE_OR_TWO, **_LOGIC}
OPERATORS = (*_PYTHON, *_RELATIONS, "piecewise")
_MOST = 200  # operands: Python nests them
_CONSTANTS = {"pi": math.pi, "exponentiale": math.e}


def variables_of(formula: ast.expr) -> Iterator[str]:
    """The identifier of every variable that it names, as often as it does."""
    names = (node.id for node in ast.walk(formula) if isinstance(node, ast.Name))
    return (name.removeprefix(VARIABLE) for name in names if name.startswith(VARIABLE))


def read_formula(node: Node) -> ast.expr:
    """The number that a content element of MathML gives. Raises InputError for what is not in the list."""

    def leaf(at: Node) -> ast.expr:
        text, kind = at.text, at.attributes.get("type") if at.children else None
        if kind == "rational":
            above, _, below = text.partition(" ")
            divisor = at.number(below)
            text = repr(at.number(above) / divisor) if divisor else text
        elif at.children:
            text = ("e" if kind == "e-notation" else "").join(text.split())
        return number(at.number(text))

    def piecewise(at: Node) -> ast.expr:
        pieces, rest = at.all("piece"), at.first("otherwise")
        for piece in pieces:
            if len(piece.children) != 2:
                raise piece.refuse(f"a piece of {len(piece.children)} elements", "a value and its condition")
        if rest is None or len(rest.children) != 1 or not pieces:
            raise at.refuse("a piecewise without a piece or without 'otherwise'", "both: a value everywhere")
        found = value(rest.children[0])
        for piece in reversed(pieces):
            found = fill("a if c else b", a=value(piece.children[0]), b=found, c=truth(piece.children[1]))
        return found

    def power(base: Any, exponent: Any) -> ast.expr:
        try:
            known = float(ast.literal_eval(exponent))
        except ValueError:
            return fill("power(a, b)", a=base, b=exponent)
        if known == 0.5:
            return fill("sqrt(a)", a=base)
        if known in (2.0, 3.0) and isinstance(base, ast.Name):
            return fill("a * a" if known == 2.0 else "a * a * a", a=base)
        if abs(known) <= 64 and known == int(known):  # real for a negative base, too
            return fill("a ** b", a=base, b=number(int(known)))
        return fill("power(a, b)", a=base, b=exponent)

    def apply(at: Node) -> Any:
        if not at.children:
            raise at.refuse("an empty apply", "an operator and its operands")
        head, *rest = at.children
        if head.name == "piecewise" and not rest:
            return piecewise(head)
        operator = head.name
        if operator == "csymbol":
            operator = head.text or head.attributes.get("definitionURL", "").rpartition("#")[2]
        if operator not in OPERATORS or operator == "piecewise":
            raise head.refuse(f"the operator '{operator}'", one_of(OPERATORS, operator))
        qualifiers = {child.name: child for child in rest if child.name in ("degree", "logbase")}
        given = [child for child in rest if child.name not in qualifiers]
        for qualifier, child in qualifiers.items():
            if {"degree": "root", "logbase": "log"}[qualifier] != operator or len(child.children) != 1:
                found = f"'{qualifier}' in '{operator}'"
                raise child.refuse(found, "degree of a root or logbase of a log, one element")
            given.append(child.children[0])
        fewest = 2 if operator in _BINARY or operator in _RELATIONS else 1
        most = 2 if operator in _BINARY or operator in _ONE_OR_TWO else _MOST
        most = 1 if operator in _UNARY or operator == "not" else most
        if not fewest <= len(given) <= most:
            raise at.refuse(f"'{operator}' of {len(given)} operands", f"{fewest} to {most}")
        operands = list(map(truth if operator in _LOGIC else value, given))
        if operator in _RELATIONS:
            return ast.Compare(operands[0], [_RELATIONS[operator]()] * (len(given) - 1), operands[1:])
        if operator == "power":
            return power(*operands)
        if most == _MOST:
            return functools.reduce(lambda a, b: fill(_PYTHON[operator], a=a, b=b), operands)
        template = _WITHOUT_SECOND.get(operator) if len(operands) == 1 else None
        return fill(template or _PYTHON[operator], **dict(zip("ab", operands, strict=False)))

    def read(at: Node) -> Any:
        if at.name == "ci":
            return name(VARIABLE + at.text)
        if at.name == "cn":
            return leaf(at)
        if at.name in _CONSTANTS:
            return number(_CONSTANTS[at.name])
        if at.name in ("true", "false"):
            return ast.Constant(at.name == "true")
        if at.name == "piecewise":
            return piecewise(at)
        if at.name == "apply":
            return apply(at)
        raise at.refuse(f"the element '{at.name}'", one_of(("apply", "ci", "cn", "piecewise", *_CONSTANTS), at.name))

    def value(at: Node) -> ast.expr:
        found = read(at)
        return fill("1.0 if a else 0.0", a=found) if _is_truth(found) else found

    def truth(at: Node) -> ast.expr:
        found = read(at)
        return found if _is_truth(found) else fill("a != 0.0", a=found)

    return value(node)


def _is_truth(node: Any) -> bool:
    """Whether an expression is true or false and no number."""
    if isinstance(node, ast.UnaryOp | ast.Constant):
        return isinstance(getattr(node, "value", None), bool) or isinstance(getattr(node, "op", None), ast.Not)
    return isinstance(node, ast.Compare | ast.BoolOp)
