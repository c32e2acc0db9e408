"""DAVE-ML file as a graph: variables in order of computation, functions, check shots.

Units are in S-119 notation: ``ft_s`` for feet per second, ``_deg`` for one per degree.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.io.messages import InputError, Refusal, one_of
from abhv_mc.io.units import Exponents, parse_unit
from abhv_mc.io.xml_reader import Node, read_xml
from abhv_mc_daveml.formulas import TAKEN, read_formula
from abhv_mc_daveml.look_ups import LookUp, read_look_ups
from abhv_mc_vehicle.user_code.module_text import free_name

_SYMBOLS = {  # symbol of :mod:`abhv_mc.io.units` by spelling in lower case
    **{symbol.lower(): symbol for symbol in (
        "slug", "kPa", "nmi", "lbf", "rad", "deg", "min", "kg", "km", "cm", "mm", "ft", "in", "kt",
        "Pa", "lb", "Hz", "N", "W", "m", "s", "h")},
    "r": "rad", "f": "ft", "sec": "s", "d": "deg", "hr": "h", "lbm": "lb", "nim": "nmi", "kn": "kt",
    "knot": "kt",
}  # fmt: skip
_UNIT = re.compile(  # The longest spelling matches first; spellings such as FT and Deg also match.
    f"({'|'.join(sorted(_SYMBOLS, key=len, reverse=True))})([0-9]?)", re.IGNORECASE
)
_NUMBERS = {"nd": 1.0, "frac": 1.0, "pct": 0.01, "": 1.0}


def parse_s119_unit(text: str) -> tuple[float, Exponents]:
    """Return the factor from a unit to SI, and its exponents. Raise Refusal if unknown."""
    if text.lower() in _NUMBERS:
        return _NUMBERS[text.lower()], (0, 0, 0, 0, 0)
    if _UNIT.sub("", text) not in ("", "_"):
        raise Refusal(
            f"unknown unit '{text}'", "a unit of S-119 such as ft_s, slugft2, _deg, pct or nd"
        )
    above, _, below = text.partition("_")
    symbols = [
        f"{sign}{_SYMBOLS[name.lower()]}{power}"
        for sign, factors in (("", above), ("/", below))
        for name, power in _UNIT.findall(factors)
    ]
    return parse_unit(" ".join(symbols))


_WITHOUT_TOLERANCE = 1e-6  # default tolerance of check values


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of a variable, described by its half-width and sigmas if possible."""

    effect: str  # additive, multiplicative (relative), percentage or absolute
    # half-width; None if defined by a table, other variables or asymmetric bounds
    half_width: float | None
    sigmas: float | None  # half-width in standard deviations; None for a uniform distribution
    # varID and correlation coefficient of each correlated variable
    correlations: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Variable:
    """Variable of a model: an input, a constant, or the result of a formula or look-up."""

    identifier: str  # varID of the variable
    key: str  # name in Python, equal to the identifier if possible
    name: str
    units: str
    sign: str
    description: str
    low: float | None  # bounds to which the value is clipped
    high: float | None
    initial: float | None
    formula: str | None  # Python expression
    look_up: LookUp | None
    needs: tuple[str, ...]  # varIDs of the variables on which the formula depends
    is_input: bool
    is_output: bool
    line: int
    uncertainty: Uncertainty | None = None

    @property
    def computed(self) -> bool:
        """True if the value is computed from other variables."""
        return self.formula is not None or self.look_up is not None

    @property
    def words(self) -> str:
        """Text with the name, units and sign of a variable, and its description in the file."""
        sign = f" ({self.sign})" if self.sign else ""
        return f"{self.name}, {self.units}{sign}" + (
            f": {self.description}" if self.description else ""
        )


@dataclass(frozen=True)
class CheckValue:
    """Expected output of a check shot, or expected internal value, with a tolerance."""

    identifier: str  # varID of the output
    value: float
    tolerance: float
    line: int


@dataclass(frozen=True)
class CheckShot:
    """Check shot: inputs with expected outputs."""

    name: str
    inputs: dict[str, float]  # input values by varID
    outputs: tuple[CheckValue, ...]
    line: int


@dataclass(frozen=True)
class Model:
    """Content of a DAVE-ML file: header, and variables in order of computation."""

    path: Path
    name: str
    version: str
    description: str
    digest: str  # SHA-256 of the file
    variables: dict[str, Variable]
    shots: tuple[CheckShot, ...]

    @property
    def inputs(self) -> list[Variable]:
        """Input variables; variables with an initial value come last."""
        inputs = [variable for variable in self.variables.values() if variable.is_input]
        return sorted(inputs, key=lambda variable: variable.initial is not None)

    @property
    def outputs(self) -> list[Variable]:
        """Variables marked as outputs or, without marks, variables that no other variable uses."""
        everything = self.variables.values()
        needed = {name for variable in everything for name in variable.needs}
        left = [
            variable
            for variable in everything
            if variable.identifier not in needed and not variable.is_input
        ]
        return [variable for variable in everything if variable.is_output] or left


def read_model(path: Path) -> Model:
    """Read a DAVE-ML file. Raise InputError, with line and column, if it is invalid."""
    root, content = read_xml(path, "a DAVE-ML file", "DAVEfunc")
    look_ups = read_look_ups(root)
    names = _name_variables(root.all("variableDef"))
    variables = {
        node.attributes["varID"]: _read_variable(node, look_ups, names)
        for node in root.all("variableDef")
    }
    for name, look_up in look_ups.items():
        for used in (name, *(argument.variable for argument in look_up.arguments)):
            if used not in variables:
                raise InputError(
                    path,
                    f"the function '{look_up.name}' uses '{used}', which is not a variable",
                    one_of(variables, used),
                    look_up.line,
                )
    header = root.first("fileHeader") or root
    return Model(
        path=path,
        name=header.attributes.get("name", path.stem),
        version=header.words("fileVersion"),
        description=header.words("description"),
        digest=hashlib.sha256(content).hexdigest(),
        variables=_in_order(path, variables),
        shots=tuple(
            _read_shot(shot, variables)
            for data in root.all("checkData")
            for shot in data.all("staticShot")
        ),
    )


def _name_variables(nodes: Iterable[Node]) -> dict[str, str]:
    """Return a unique Python name for the identifier of each variable."""
    names: dict[str, str] = {}
    for node in nodes:
        identifier = node.attributes.get("varID")
        if identifier is None or identifier in names:
            raise node.refuse(f"'{node.name}' has the varID '{identifier or ''}'", "a unique varID")
        names[identifier] = free_name(identifier, {*TAKEN, *names.values()})
    return names


def _read_variable(node: Node, look_ups: dict[str, LookUp], names: dict[str, str]) -> Variable:
    identifier = node.attributes["varID"]
    look_up = look_ups.get(identifier)
    formula = None
    needs = [argument.variable for argument in look_up.arguments] if look_up else []
    if (calculation := node.first("calculation")) is not None:
        maths = calculation.first("math")
        if maths is None or len(maths.children) != 1 or look_up is not None:
            problem = "a calculation and a function" if look_up else "an invalid calculation"
            raise calculation.refuse(
                f"'{identifier}' has {problem}", "one function, or one MathML element in 'math'"
            )
        formula, needs = read_formula(maths.children[0], names)
    marks = ("isInput", "isControl", "isDisturbance", "isState")
    initial = node.bound("initialValue")
    return Variable(
        identifier=identifier,
        key=names[identifier],
        name=node.attributes.get("name", identifier),
        units=node.attributes.get("units", "nd"),
        sign=node.attributes.get("sign", ""),
        description=node.words("description"),
        low=node.bound("minValue"),
        high=node.bound("maxValue"),
        initial=initial,
        formula=formula,
        look_up=look_up,
        needs=tuple(needs),
        is_input=formula is None
        and look_up is None
        and (bool(node.all(*marks)) or initial is None),
        is_output=bool(node.all("isOutput")),
        line=node.line,
        uncertainty=_read_uncertainty(node),
    )


def _read_uncertainty(node: Node) -> Uncertainty | None:
    if (stated := node.first("uncertainty")) is None:
        return None
    normal = stated.first("normalPDF")
    uniform = stated.first("uniformPDF")
    law = normal or uniform
    if law is None:
        raise stated.refuse("the uncertainty has no distribution", "normalPDF or uniformPDF")
    bounds = law.all("bounds")
    numbers = [bound.number(bound.text) for bound in bounds if bound.text and not bound.children]
    if len(numbers) == 2 and numbers[0] == -numbers[1]:
        numbers = [abs(numbers[0])]
    return Uncertainty(
        stated.attributes.get("effect", "additive"),
        numbers[0] if len(numbers) == 1 else None,
        normal.number(normal.attributes.get("numSigmas", "1")) if normal else None,
        tuple(
            (entry.attributes.get("varID", ""), entry.number(entry.attributes.get("corrCoef", "")))
            for entry in law.all("correlation")
        ),
    )


def _in_order(path: Path, variables: dict[str, Variable]) -> dict[str, Variable]:
    """Return the variables in an order in which each variable follows its operands."""
    done: dict[str, Variable] = {}

    def add(name: str, dependent: tuple[str, ...]) -> None:
        if name in dependent:
            circle = " of ".join([*dependent[dependent.index(name) :], name])
            raise InputError(
                path,
                f"the definition is circular ({circle})",
                "variables that do not depend on themselves",
                variables[name].line,
            )
        if name not in done:
            for needed in variables[name].needs:
                add(needed, (*dependent, name))
            done[name] = variables[name]

    for name in variables:
        add(name, ())
    return done


def _read_shot(shot: Node, variables: dict[str, Variable]) -> CheckShot:
    def find(signal: Node) -> Variable:
        """Return the variable of a signal; units distinguish variables with the same name."""
        name = signal.words("signalName")
        identifier = signal.words("varID") or signal.words("signalID")
        named = [variable for variable in variables.values() if variable.name == name]
        same = [v for v in named if v.units == signal.words("signalUnits")] or named
        variable = variables.get(identifier) or variables.get(name)
        if identifier not in variables and len(same) == 1:
            variable = same[0]
        if variable is None:
            label = name or identifier
            names = (*(v.name for v in variables.values()), *variables)
            raise signal.refuse(f"unknown signal '{label}'", one_of(dict.fromkeys(names), label))
        return variable

    def read(group: str) -> Iterator[tuple[Node, str, float, float]]:
        """Yield each signal with its variable, its value, and the factor to the units of both."""
        for section in shot.all(group):
            for signal in section.all("signal"):
                variable = find(signal)
                factor = _conversion(signal, variable)
                value = factor * signal.number(signal.words("signalValue"))
                yield signal, variable.identifier, value, factor

    inputs = {variable_id: value for _, variable_id, value, _ in read("checkInputs")}
    outputs = []
    for group in ("internalValues", "checkOutputs"):
        for signal, identifier, value, factor in read(group):
            tolerance = signal.words("tol")
            allowed = (
                abs(factor) * signal.number(tolerance)
                if tolerance
                else _WITHOUT_TOLERANCE * max(1.0, abs(value))
            )
            if tolerance or group == "checkOutputs":
                outputs.append(CheckValue(identifier, value, allowed, signal.line))
    return CheckShot(shot.attributes.get("name", "shot"), inputs, tuple(outputs), shot.line)


def _conversion(signal: Node, variable: Variable) -> float:
    """Return the factor from the units of a signal to the units of its variable."""
    units = signal.words("signalUnits")
    if not units or units == variable.units:
        return 1.0
    with suppress(Refusal):
        factor, dimension = parse_s119_unit(units)
        own_factor, own_dimension = parse_s119_unit(variable.units)
        if dimension == own_dimension:
            return factor / own_factor
    raise signal.refuse(
        f"'{variable.name}' has the unit '{units}'",
        f"'{variable.units}', the units of the variable",
    )
