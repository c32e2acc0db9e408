"""MathML calculations as expressions, by a fixed list of operators, and expressions as Python text."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.daveml.xml_reader import Node
from abhv_mc.io.input_error import InputError, one_of


@dataclass(frozen=True)
class Expression:
    """An operator with its operands; ``ci`` names a variable and ``cn`` is a number, both in ``leaf``.

    ``piecewise`` has value, condition, value, condition, ... and last what holds otherwise.
    """

    operator: str
    operands: tuple["Expression", ...] = ()
    leaf: str = ""

    def variables(self) -> Iterator[str]:
        """Every variable that it names, as often as it does."""
        if self.operator == "ci":
            yield self.leaf
        for operand in self.operands:
            yield from operand.variables()


_RELATIONS = {"gt": ">", "lt": "<", "geq": ">=", "leq": "<=", "eq": "==", "neq": "!="}
_LOGIC = ("and", "or", "xor", "not")
TRUTHS = (*_RELATIONS, *_LOGIC, "true", "false")  # operators whose value is true or false
_UNARY = (
    "abs", "exp", "ln", "floor", "ceiling", "sin", "cos", "tan", "sec", "csc", "cot", "sinh", "cosh", "tanh", "arcsin",
    "arccos", "arctan", "not",
)  # fmt: skip
_BINARY = ("divide", "power", "quotient", "rem", "atan2")
_MANY = ("plus", "times", "max", "min", "and", "or", "xor", *_RELATIONS)
OPERATORS = (*_UNARY, *_BINARY, *_MANY, "minus", "log", "root", "piecewise")
_CONSTANTS = {"pi": math.pi, "exponentiale": math.e}


def read_formula(node: Node, path: Path) -> Expression:
    """The expression of a content element of MathML. Raises InputError for what is not in the list."""

    def refuse(at: Node, found: str, expected: str) -> InputError:
        return InputError(path, found, expected, at.line, at.column)

    def leaf(at: Node) -> Expression:
        if at.name == "ci":
            return Expression("ci", leaf=at.text.strip())
        parts = [at.text.strip()] if not at.children else at.text.split()
        kind = at.attributes.get("type", "real")
        try:
            if at.children and kind == "rational":
                value = float(parts[0]) / float(parts[1])
            elif at.children and kind == "e-notation":
                value = float(f"{parts[0]}e{parts[1]}")
            else:
                value = float("".join(parts))
        except (ValueError, IndexError, ZeroDivisionError):
            raise refuse(at, f"'{' '.join(parts)}'", "a number") from None
        return Expression("cn", leaf=repr(value))

    def piecewise(at: Node) -> Expression:
        operands: list[Expression] = []
        for piece in at.all("piece"):
            if len(piece.children) != 2:
                raise refuse(piece, f"a piece of {len(piece.children)} elements", "a value and its condition")
            operands += [read(piece.children[0]), read(piece.children[1])]
        rest = at.first("otherwise")
        if rest is None or len(rest.children) != 1 or not operands:
            raise refuse(at, "a piecewise without a piece or without 'otherwise'", "both: a value everywhere")
        return Expression("piecewise", (*operands, read(rest.children[0])))

    def apply(at: Node) -> Expression:
        if not at.children:
            raise refuse(at, "an empty apply", "an operator and its operands")
        head, *rest = at.children
        if head.name == "piecewise" and not rest:
            return piecewise(head)
        name = head.name
        if name == "csymbol":
            name = head.text.strip() or head.attributes.get("definitionURL", "").rpartition("#")[2]
        if name not in OPERATORS or name == "piecewise":
            raise refuse(head, f"the operator '{name}'", one_of(OPERATORS, name))
        qualifiers = {child.name: child for child in rest if child.name in ("degree", "logbase")}
        operands = [read(child) for child in rest if child.name not in qualifiers]
        for qualifier, child in qualifiers.items():
            if {"degree": "root", "logbase": "log"}[qualifier] != name or len(child.children) != 1:
                raise refuse(child, f"'{qualifier}' in '{name}'", "degree of a root or logbase of a log, one element")
            operands.append(read(child.children[0]))
        fewest, most = (1, 2) if name in ("minus", "log", "root") else (1, 1) if name in _UNARY else (2, 2)
        if name in _MANY:
            fewest, most = (2 if name in _RELATIONS else 1), 10_000
        if not fewest <= len(operands) <= most:
            raise refuse(at, f"'{name}' of {len(operands)} operands", f"{fewest} to {most}")
        if name == "minus" and len(operands) == 1:
            name = "negative"
        return Expression(name, tuple(operands))

    def read(at: Node) -> Expression:
        if at.name in ("ci", "cn"):
            return leaf(at)
        if at.name in _CONSTANTS:
            return Expression("cn", leaf=repr(_CONSTANTS[at.name]))
        if at.name in ("true", "false"):
            return Expression(at.name)
        if at.name == "piecewise":
            return piecewise(at)
        if at.name == "apply":
            return apply(at)
        raise refuse(at, f"the element '{at.name}'", one_of(("apply", "ci", "cn", "piecewise", *_CONSTANTS), at.name))

    return read(node)


# How tightly text binds: an operand that binds less is put in brackets.
_CHOICE, _OR, _AND, _NOT, _COMPARE, _SUM, _PRODUCT, _SIGN, _ATOM = range(9)


def write_formula(expression: Expression, names: Mapping[str, str], used: set[str]) -> str:
    """Python text of an expression with the variables' Python names; adds to ``used`` the functions that it calls."""

    def atom(e: Expression, least: int = _CHOICE) -> str:
        text, binds = number(e)
        return text if binds >= least else f"({text})"

    def call(function: str, *operands: Expression) -> tuple[str, int]:
        used.add(function)
        return f"{function}({', '.join(atom(operand) for operand in operands)})", _ATOM

    def folded(function: str, operands: tuple[Expression, ...]) -> tuple[str, int]:
        used.add(function)
        text = atom(operands[0])
        for operand in operands[1:]:
            text = f"{function}({text}, {atom(operand)})"
        return text, _ATOM

    def product(e: Expression) -> tuple[str, int]:
        first, *rest = e.operands
        return " * ".join([atom(first, _PRODUCT), *(atom(operand, _SIGN) for operand in rest)]), _PRODUCT

    def power(base: Expression, exponent: Expression) -> tuple[str, int]:
        value = float(exponent.leaf) if exponent.operator == "cn" else None
        if value == 0.5:
            return call("sqrt", base)
        if value in (2.0, 3.0) and base.operator == "ci":
            return " * ".join([atom(base, _SIGN)] * int(value)), _PRODUCT
        if value is not None and value == int(value) and abs(value) <= 64:  # real for a negative base, too
            return (
                f"{atom(base, _ATOM)} ** {int(value)}" if value >= 0 else f"{atom(base, _ATOM)} ** ({int(value)})",
                _SIGN,
            )
        return call("power", base, exponent)

    def number(e: Expression) -> tuple[str, int]:
        one = e.operands[0] if e.operands else e
        simple: dict[str, Callable[[], tuple[str, int]]] = {
            "ci": lambda: (names[e.leaf], _ATOM),
            "cn": lambda: (e.leaf, _SIGN if e.leaf.startswith("-") else _ATOM),
            "plus": lambda: (" + ".join([atom(one, _SUM), *(atom(more, _PRODUCT) for more in e.operands[1:])]), _SUM),
            "minus": lambda: (f"{atom(one, _SUM)} - {atom(e.operands[1], _PRODUCT)}", _SUM),
            "negative": lambda: (f"-{atom(one, _SIGN)}", _SIGN),
            "times": lambda: product(e),
            "divide": lambda: (f"{atom(one, _PRODUCT)} / {atom(e.operands[1], _SIGN)}", _PRODUCT),
            "power": lambda: power(*e.operands),
            "root": lambda: root(e),
            "ln": lambda: call("log", one),
            "log": lambda: log(e),
            "floor": lambda: call("floor", one),
            "ceiling": lambda: call("ceil", one),
            "quotient": lambda: (f"{_use(used, 'trunc')}({atom(one, _PRODUCT)} / {atom(e.operands[1], _SIGN)})", _ATOM),
            "rem": lambda: call("fmod", *e.operands),
            "max": lambda: folded("larger", e.operands),
            "min": lambda: folded("smaller", e.operands),
            "arcsin": lambda: call("asin", one),
            "arccos": lambda: call("acos", one),
            "arctan": lambda: (f"{_use(used, 'atan2')}({atom(one)}, 1.0)", _ATOM),
            "sec": lambda: (f"1.0 / {call('cos', one)[0]}", _PRODUCT),
            "csc": lambda: (f"1.0 / {call('sin', one)[0]}", _PRODUCT),
            "cot": lambda: (f"1.0 / {call('tan', one)[0]}", _PRODUCT),
            "sinh": lambda: (f"0.5 * ({call('exp', one)[0]} - exp(-{atom(one, _SIGN)}))", _PRODUCT),
            "cosh": lambda: (f"0.5 * ({call('exp', one)[0]} + exp(-{atom(one, _SIGN)}))", _PRODUCT),
            "tanh": lambda: (f"1.0 - 2.0 / ({_use(used, 'exp')}(2.0 * {atom(one, _SIGN)}) + 1.0)", _SUM),
            "piecewise": lambda: choice(e),
        }  # fmt: skip
        if e.operator in simple:
            return simple[e.operator]()
        if e.operator in TRUTHS:
            return f"1.0 if {truth(e, _OR)} else 0.0", _CHOICE
        if e.operator == "abs":
            return f"abs({atom(one)})", _ATOM
        return call(e.operator, *e.operands)

    def log(e: Expression) -> tuple[str, int]:
        base = atom(e.operands[1]) if e.operands[1:] else "10.0"
        return f"{_use(used, 'log')}({atom(e.operands[0])}) / log({base})", _PRODUCT

    def root(e: Expression) -> tuple[str, int]:
        if len(e.operands) == 1:
            return call("sqrt", e.operands[0])
        return f"{_use(used, 'power')}({atom(e.operands[0])}, 1.0 / {atom(e.operands[1], _SIGN)})", _ATOM

    def choice(e: Expression) -> tuple[str, int]:
        *pieces, otherwise = e.operands
        text = atom(otherwise)
        for value, condition in reversed(list(zip(pieces[::2], pieces[1::2], strict=True))):
            text = f"{atom(value, _OR)} if {truth(condition, _OR)} else {text}"
        return text, _CHOICE

    def truth(e: Expression, least: int) -> str:
        if e.operator in _RELATIONS:
            text, binds = f" {_RELATIONS[e.operator]} ".join(atom(operand, _SUM) for operand in e.operands), _COMPARE
        elif e.operator in ("and", "or"):
            binds = _AND if e.operator == "and" else _OR
            text = f" {e.operator} ".join(truth(operand, binds + 1) for operand in e.operands)
        elif e.operator == "xor":
            text, binds = truth(e.operands[0], _ATOM), _COMPARE
            for operand in e.operands[1:]:
                text = f"({text}) != {truth(operand, _ATOM)}"
        elif e.operator == "not":
            text, binds = f"not {truth(e.operands[0], _COMPARE)}", _NOT
        elif e.operator in ("true", "false"):
            text, binds = e.operator.capitalize(), _ATOM
        else:
            text, binds = f"{atom(e, _SUM)} != 0.0", _COMPARE
        return text if binds >= least else f"({text})"

    return atom(expression)


def _use(used: set[str], function: str) -> str:
    used.add(function)
    return function
