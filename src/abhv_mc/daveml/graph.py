"""A DAVE-ML file as its graph: variables in the order in which they can be computed, functions, check shots."""

import ast
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.daveml.formulas import read_formula, variables_of
from abhv_mc.daveml.look_ups import LookUp, read_look_ups
from abhv_mc.daveml.s119_units import parse_s119_unit
from abhv_mc.daveml.xml_reader import Node, read_xml
from abhv_mc.io.input_error import InputError, Refusal, one_of


@dataclass(frozen=True)
class Variable:
    """A variable: where its value comes from is its formula or its look-up, else its initial value, else the caller."""

    identifier: str  # varID
    name: str
    units: str
    sign: str
    description: str
    low: float | None  # its value is held within
    high: float | None
    initial: float | None
    formula: ast.expr | None  # with the variables by their identifiers behind formulas.VARIABLE
    look_up: LookUp | None
    is_input: bool
    is_output: bool
    line: int

    @property
    def computed(self) -> bool:
        """Whether its value follows from others."""
        return self.formula is not None or self.look_up is not None

    def needs(self) -> Iterator[str]:
        """Identifiers of the variables that it is computed of."""
        if self.formula is not None:
            yield from variables_of(self.formula)
        elif self.look_up is not None:
            yield from (argument.variable for argument in self.look_up.arguments)


@dataclass(frozen=True)
class CheckValue:
    """One signal of a check shot; ``tolerance`` None where the file gives none."""

    identifier: str  # varID
    value: float
    tolerance: float | None
    line: int


@dataclass(frozen=True)
class CheckShot:
    """Inputs and the outputs that they must give."""

    name: str
    inputs: tuple[CheckValue, ...]
    internals: tuple[CheckValue, ...]
    outputs: tuple[CheckValue, ...]


@dataclass(frozen=True)
class Model:
    """A file: its header, and its variables each behind those that it needs."""

    path: Path
    name: str
    version: str
    description: str
    digest: str  # SHA-256 of the file
    variables: dict[str, Variable]
    shots: tuple[CheckShot, ...]

    @property
    def inputs(self) -> list[Variable]:
        """What the caller gives; those with an initial value last."""
        found = [variable for variable in self.variables.values() if variable.is_input]
        return sorted(found, key=lambda variable: variable.initial is not None)

    @property
    def outputs(self) -> list[Variable]:
        """What the file marks as outputs; without marks whatever nothing else is computed of."""
        marked = [variable for variable in self.variables.values() if variable.is_output]
        needed = {name for variable in self.variables.values() for name in variable.needs()}
        return marked or [
            variable for name, variable in self.variables.items() if name not in needed and not variable.is_input
        ]


def read_model(path: Path) -> Model:
    """Read a DAVE-ML file. Raises :class:`abhv_mc.io.input_error.InputError` with line and column."""
    root, content = read_xml(path)
    if root.name != "DAVEfunc":
        raise root.refuse(f"the element '{root.name}'", "a DAVE-ML file: 'DAVEfunc'")
    look_ups = read_look_ups(root)
    variables: dict[str, Variable] = {}
    for node in root.all("variableDef"):
        variable = _read_variable(node, look_ups)
        if variable.identifier in variables:
            raise node.refuse(f"a second variable '{variable.identifier}'", "one")
        variables[variable.identifier] = variable
    _check_references(path, variables, look_ups)
    header = root.first("fileHeader") or root
    return Model(
        path,
        header.attributes.get("name", path.stem),
        header.words("fileVersion"),
        header.words("description"),
        hashlib.sha256(content).hexdigest(),
        _in_order(path, variables),
        tuple(_read_shot(shot, variables) for data in root.all("checkData") for shot in data.all("staticShot")),
    )


def _read_variable(node: Node, look_ups: dict[str, LookUp]) -> Variable:
    identifier = node.attributes.get("varID")
    if identifier is None:
        raise node.refuse(f"'{node.name}' without varID", "it")

    def bound(name: str) -> float | None:
        return node.number(node.attributes[name]) if name in node.attributes else None

    formula = None
    calculation = node.first("calculation")
    if calculation is not None:
        maths = calculation.first("math")
        if maths is None or len(maths.children) != 1:
            raise calculation.refuse("a calculation", "one MathML element in 'math'")
        formula = read_formula(maths.children[0])
    look_up = look_ups.get(identifier)
    if formula is not None and look_up is not None:
        found = f"a calculation and the function '{look_up.name}', both of '{identifier}'"
        raise node.refuse(found, "one of them")
    marked = any(node.first(name) is not None for name in ("isInput", "isControl", "isDisturbance", "isState"))
    initial = bound("initialValue")
    computed = formula is not None or look_up is not None
    return Variable(
        identifier,
        node.attributes.get("name", identifier),
        node.attributes.get("units", "nd"),
        node.attributes.get("sign", ""),
        node.words("description"),
        bound("minValue"),
        bound("maxValue"),
        initial,
        formula,
        look_up,
        not computed and (marked or initial is None),
        node.first("isOutput") is not None,
        node.line,
    )


def _check_references(path: Path, variables: dict[str, Variable], look_ups: dict[str, LookUp]) -> None:
    for variable in variables.values():
        for name in variable.needs():
            if name not in variables:
                found = f"'{variable.identifier}' computed of '{name}', which there is not"
                raise InputError(path, found, one_of(variables, name), variable.line)
    for name, look_up in look_ups.items():
        if name not in variables:
            found = f"the function '{look_up.name}' of '{name}', which is no variable"
            raise InputError(path, found, one_of(variables, name), look_up.line)


def _in_order(path: Path, variables: dict[str, Variable]) -> dict[str, Variable]:
    """Each variable behind those that it needs, otherwise as in the file."""
    done: dict[str, Variable] = {}
    for start in variables:
        pending = [start]
        while pending:
            name = pending[-1]
            waiting = [needed for needed in variables[name].needs() if needed not in done]
            if name in done or not waiting:
                done.setdefault(name, variables[name])
                pending.pop()
            elif waiting[0] in pending:
                circle = " of ".join([*pending[pending.index(waiting[0]) :], waiting[0]])
                raise InputError(path, f"{circle}: a circle", "variables without one", variables[name].line)
            else:
                pending.append(waiting[0])
    return done


def _read_shot(shot: Node, variables: dict[str, Variable]) -> CheckShot:
    by_name = {variable.name: variable.identifier for variable in variables.values()}

    def values(group: str) -> tuple[CheckValue, ...]:
        found = []
        for signal in (node for part in shot.all(group) for node in part.all("signal")):
            name, identified = signal.words("signalName"), signal.words("varID") or signal.words("signalID")
            given = name or identified
            identifier = identified if identified in variables else by_name.get(name, name)
            if identifier not in variables:
                known = one_of((*by_name, *variables), given)
                raise signal.refuse(f"the signal '{given}'", known)
            factor = _conversion(signal, variables[identifier])
            tolerance = signal.words("tol")
            found.append(
                CheckValue(
                    identifier,
                    factor * signal.number(signal.words("signalValue")),
                    abs(factor) * signal.number(tolerance) if tolerance else None,
                    signal.line,
                )
            )
        return tuple(found)

    return CheckShot(
        shot.attributes.get("name", "shot"), values("checkInputs"), values("internalValues"), values("checkOutputs")
    )


def _conversion(signal: Node, variable: Variable) -> float:
    """Factor from a signal's units to its variable's."""
    units = signal.words("signalUnits")
    if not units or units == variable.units:
        return 1.0
    try:
        (given, dimension), (own, own_dimension) = parse_s119_unit(units), parse_s119_unit(variable.units)
    except Refusal:
        dimension, own_dimension = (1, 0, 0, 0), (0, 0, 0, 0)
    if dimension != own_dimension:
        found = f"'{variable.name}' in '{units}'"
        raise signal.refuse(found, f"'{variable.units}', as the variable is")
    return given / own
