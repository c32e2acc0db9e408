"""Conversion of MathML calculations to Python expressions with a fixed set of operators.

No text of a file becomes code: names are converted to identifiers, and numbers are parsed and
rewritten.
"""

import math
from collections.abc import Mapping

from abhv_mc.io.messages import one_of
from abhv_mc.io.xml_reader import Node
from abhv_mc_vehicle.imported_vehicle import RESERVED, Operators, power, tidy
from abhv_mc_vehicle.user_code.module_text import number

OUTPUTS = "Outputs"
MODEL = "model"
# names that variables cannot have
TAKEN = RESERVED | {OUTPUTS, MODEL, "Commands", "coefficients", "thrust", "law", "out"}

_LOGIC = ("and", "or", "xor", "not")  # operators on truth values
_RELATIONS = {"gt": ">", "lt": "<", "geq": ">=", "leq": "<=", "eq": "==", "neq": "!="}
_OPERATORS = Operators(
    between={"plus": "+", "times": "*", "and": "and", "or": "or", **_RELATIONS},
    folded={"max": "larger({}, {})", "min": "smaller({}, {})", "xor": "({} != {})"},
    fixed={
        1: {
            **dict.fromkeys(("plus", "times", "and", "or"), "{}"),
            "not": "(not {})",
            **{name: f"{name}({{}})" for name in ("abs", "exp", "floor", "sin", "cos", "tan")},
            "minus": "(-{})",
            "ln": "log({})",
            "log": "(log({}) / log(10.0))",
            "root": "sqrt({})",
            "ceiling": "ceil({})",
            "sec": "(1.0 / cos({}))",
            "csc": "(1.0 / sin({}))",
            "cot": "(1.0 / tan({}))",
            "sinh": "(0.5 * (exp({0}) - exp(-{0})))",
            "cosh": "(0.5 * (exp({0}) + exp(-{0})))",
            "tanh": "(1.0 - 2.0 / (exp(2.0 * {}) + 1.0))",
            "arcsin": "asin({})",
            "arccos": "acos({})",
            "arctan": "atan2({}, 1.0)",
        },
        2: {
            "minus": "({} - {})",
            "divide": "({} / {})",
            "power": "power({}, {})",
            "quotient": "trunc({} / {})",
            "rem": "fmod({}, {})",
            "atan2": "atan2({}, {})",
            "log": "(log({}) / log({}))",
            "root": "power({}, 1.0 / {})",
        },
    },
)
_CONSTANTS = {"pi": math.pi, "exponentiale": math.e}


def _power(base: str, exponent: str) -> str:
    repeated = {"(2.0)": 2, "(3.0)": 3}.get(exponent)
    if exponent == "(0.5)":
        return f"sqrt({base})"
    if repeated and base.isidentifier():
        return f"({' * '.join([base] * repeated)})"
    return power(base, exponent)


def read_formula(node: Node, names: Mapping[str, str]) -> tuple[str, list[str]]:
    """Return the Python expression of a MathML element and the variables (varID) in it.

    Raise InputError for unknown elements, operators or variables.
    """
    needs: list[str] = []

    def leaf(element: Node) -> str:
        text = element.text
        kind = element.attributes.get("type") if element.children else None
        if kind == "rational":
            parts = [element.number(numeral) for numeral in text.split()]
            if len(parts) != 2 or parts[1] == 0.0:
                raise element.refuse(
                    f"found '{' / '.join(text.split())}'", "a numerator and a nonzero denominator"
                )
            return f"({number(parts[0] / parts[1])})"
        if element.children:
            text = ("e" if kind == "e-notation" else "").join(text.split())
        return f"({number(element.number(text))})"

    def piecewise(element: Node) -> str:
        pieces = element.all("piece")
        otherwise = element.first("otherwise")
        sizes = [len(piece.children) for piece in (*pieces, *element.all("otherwise"))]
        if otherwise is None or sizes != [2] * len(pieces) + [1]:
            raise element.refuse(
                "the element 'piecewise' is invalid",
                "pieces with a value and a condition, and 'otherwise' with a value",
            )
        expression = value(otherwise.children[0])
        for piece in reversed(pieces):
            result, condition = piece.children
            expression = f"{value(result)} if {truth(condition)} else {expression}"
        return f"({expression})"

    def apply(element: Node) -> tuple[str, bool]:
        if not element.children:
            raise element.refuse("the element 'apply' is empty", "an operator and operands")
        head, *arguments = element.children
        if head.name == "piecewise" and not arguments:
            return piecewise(head), False
        operator = head.name
        if operator == "csymbol":
            operator = head.text or head.attributes.get("definitionURL", "").rpartition("#")[2]
        if operator not in _OPERATORS.names:
            raise head.refuse(f"unknown operator '{operator}'", one_of(_OPERATORS.names, operator))
        qualifier = {"root": "degree", "log": "logbase"}.get(operator)
        nodes = [child for child in arguments if child.name != qualifier]
        nodes += [
            inner for child in arguments if child.name == qualifier for inner in child.children
        ]
        operands = [(truth if operator in _LOGIC else value)(child) for child in nodes]
        if operator == "power" and len(operands) == 2:
            return _power(*operands), False
        is_truth = operator in _LOGIC or operator in _RELATIONS
        return _OPERATORS.apply(element, operator, operands), is_truth

    def read(element: Node) -> tuple[str, bool]:
        """Return the Python expression, and whether its value is a truth value."""
        kind = element.name
        if kind == "ci":
            if element.text not in names:
                raise element.refuse(
                    f"unknown variable '{element.text}'",
                    one_of(names, element.text),
                )
            needs.append(element.text)
            return names[element.text], False
        if kind == "cn":
            return leaf(element), False
        if kind in _CONSTANTS:
            return number(_CONSTANTS[kind]), False
        if kind in ("true", "false"):
            return kind.capitalize(), True
        if kind == "piecewise":
            return piecewise(element), False
        if kind == "apply":
            return apply(element)
        raise element.refuse(
            f"found the element '{kind}'",
            one_of(("apply", "ci", "cn", "piecewise", *_CONSTANTS), kind),
        )

    def value(element: Node) -> str:
        text, is_truth = read(element)
        return f"(1.0 if {text} else 0.0)" if is_truth else text

    def truth(element: Node) -> str:
        text, is_truth = read(element)
        return text if is_truth else f"({text} != 0.0)"

    return tidy(node, value(node)), needs
