"""MathML calculations as the text of Python expressions, by a fixed list of operators.

Nothing that a file says becomes code: its names become identifiers, its numbers are read and written anew.
"""

import ast
import functools
import math
from collections.abc import Mapping

from abhv_mc import extend
from abhv_mc.io.input_error import one_of
from abhv_mc.io.xml_reader import Node
from abhv_mc.user_code.module_text import number

FROM_MATH = ("ceil", "floor", "fmod", "trunc")
OUTPUTS, MODEL = "Outputs", "model"
_OWN = (
    OUTPUTS,
    MODEL,
    "NamedTuple",
    "DEGREE",
    "SPAN",
    "CHORD",
    "Commands",
    "coefficients",
    "thrust",
    "law",
    "out",
)
TAKEN = frozenset((*extend.__all__, *FROM_MATH, *_OWN))  # names that no variable has

_LOGIC = ("and", "or", "xor", "not")  # of truths
_RELATIONS = {"gt": ">", "lt": "<", "geq": ">=", "leq": "<=", "eq": "==", "neq": "!="}
_BETWEEN = {
    "plus": "+",
    "times": "*",
    "and": "and",
    "or": "or",
    **_RELATIONS,
}  # of any number of operands
_ONE = {
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
}
_TWO = {
    "minus": "({} - {})",
    "divide": "({} / {})",
    "power": "power({}, {})",
    "quotient": "trunc({} / {})",
    "rem": "fmod({}, {})",
    "atan2": "atan2({}, {})",
    "log": "(log({}) / log({}))",
    "root": "power({}, 1.0 / {})",
}
_MANY = {"max": "larger({}, {})", "min": "smaller({}, {})", "xor": "({} != {})"}
OPERATORS = (*_ONE, *_TWO, *_MANY, *_BETWEEN, "piecewise")
_CONSTANTS = {"pi": math.pi, "exponentiale": math.e}


def read_formula(node: Node, names: Mapping[str, str]) -> tuple[str, list[str]]:
    """The Python of a content element of MathML, a number, and the variables (varID) in it. Raises InputError."""
    needs: list[str] = []

    def leaf(at: Node) -> str:
        text, kind = at.text, at.attributes.get("type") if at.children else None
        if kind == "rational":
            parts = [at.number(part) for part in text.split()]
            if len(parts) != 2 or parts[1] == 0.0:
                raise at.refuse(
                    f"'{' / '.join(text.split())}'", "a numerator and a denominator that is not 0"
                )
            return f"({number(parts[0] / parts[1])})"
        if at.children:
            text = ("e" if kind == "e-notation" else "").join(text.split())
        return f"({number(at.number(text))})"

    def piecewise(at: Node) -> str:
        pieces, rest = at.all("piece"), at.first("otherwise")
        if rest is None or [len(each.children) for each in (*pieces, rest)] != [2] * len(pieces) + [
            1
        ]:
            raise at.refuse(
                "a piecewise", "pieces of a value and its condition, and 'otherwise' with a value"
            )
        found = value(rest.children[0])
        for piece in reversed(pieces):
            found = f"{value(piece.children[0])} if {truth(piece.children[1])} else {found}"
        return f"({found})"

    def power(base: str, exponent: str) -> str:
        try:
            known = float(ast.literal_eval(exponent))
        except ValueError:
            return f"power({base}, {exponent})"
        if known == 0.5:
            return f"sqrt({base})"
        if known in (2.0, 3.0) and base.isidentifier():
            return f"({' * '.join([base] * int(known))})"
        if abs(known) <= 64 and known == int(known):  # real for a negative base, too
            return f"({base} ** {int(known)})"
        return f"power({base}, {exponent})"

    def apply(at: Node) -> tuple[str, bool]:
        if not at.children:
            raise at.refuse("an empty apply", "an operator and its operands")
        head, *rest = at.children
        if head.name == "piecewise" and not rest:
            return piecewise(head), False
        operator = head.name
        if operator == "csymbol":
            operator = head.text or head.attributes.get("definitionURL", "").rpartition("#")[2]
        if operator not in OPERATORS or operator == "piecewise":
            raise head.refuse(f"the operator '{operator}'", one_of(OPERATORS, operator))
        qualifier = {"root": "degree", "log": "logbase"}.get(operator)
        given = [child for child in rest if child.name != qualifier]
        given += [part for child in rest if child.name == qualifier for part in child.children]
        operands = [(truth if operator in _LOGIC else value)(child) for child in given]
        is_truth = operator in _LOGIC or operator in _RELATIONS
        if operator in _BETWEEN and len(operands) > (operator in _RELATIONS):
            return f"({f' {_BETWEEN[operator]} '.join(operands)})", is_truth
        if operator in _MANY and operands:
            return functools.reduce(_MANY[operator].format, operands), is_truth
        if operator == "power" and len(operands) == 2:
            return power(*operands), False
        patterns = {1: _ONE, 2: _TWO}.get(len(operands), {})
        if operator not in patterns:
            raise at.refuse(f"'{operator}' of {len(operands)} operands", "as many as it takes")
        return patterns[operator].format(*operands), is_truth

    def read(at: Node) -> tuple[str, bool]:
        """The Python, and whether it is true or false and no number."""
        if at.name == "ci":
            if at.text not in names:
                raise at.refuse(
                    f"a value computed of '{at.text}', which there is not", one_of(names, at.text)
                )
            needs.append(at.text)
            return names[at.text], False
        if at.name == "cn":
            return leaf(at), False
        if at.name in _CONSTANTS:
            return number(_CONSTANTS[at.name]), False
        if at.name in ("true", "false"):
            return at.name.capitalize(), True
        if at.name == "piecewise":
            return piecewise(at), False
        if at.name == "apply":
            return apply(at)
        raise at.refuse(
            f"the element '{at.name}'",
            one_of(("apply", "ci", "cn", "piecewise", *_CONSTANTS), at.name),
        )

    def value(at: Node) -> str:
        text, is_truth = read(at)
        return f"(1.0 if {text} else 0.0)" if is_truth else text

    def truth(at: Node) -> str:
        text, is_truth = read(at)
        return text if is_truth else f"({text} != 0.0)"

    try:
        return ast.unparse(ast.parse(value(node), mode="eval")), needs
    except (SyntaxError, RecursionError, MemoryError):  # as Python's parser says it
        raise node.refuse(
            "a calculation too deep for Python", "parts of it as variables of their own"
        ) from None
