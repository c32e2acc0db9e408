"""A model as readable Python: its tables, its constants and one function from its inputs to its outputs."""

import ast
import builtins
import copy
import keyword
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from abhv_mc import extend
from abhv_mc.daveml import python_nodes as py
from abhv_mc.daveml.formulas import VARIABLE
from abhv_mc.daveml.graph import Model, Variable
from abhv_mc.daveml.look_ups import Argument, LookUp
from abhv_mc.daveml.xml_reader import fold

FROM_MATH = ("ceil", "floor", "fmod", "trunc")
OUTPUTS, MODEL = "Outputs", "model"
_OWN = (OUTPUTS, MODEL, "NamedTuple", "DEGREE", "SPAN", "CHORD", "Commands", "coefficients", "thrust", "law", "out")
_TAKEN = {*dir(builtins), *extend.__all__, *FROM_MATH, *_OWN}
_LONGEST = 60  # letters of a name


def python_names(model: Model) -> dict[str, str]:
    """A Python name for each variable's identifier: its own where that is possible."""
    names: dict[str, str] = {}
    for identifier in model.variables:
        names[identifier] = free_name(identifier, names.values())
    return names


def free_name(text: str, taken: Iterable[str] = ()) -> str:
    """A Python name for a text, its own where that is possible."""
    found = re.sub(r"\W", "_", text, flags=re.ASCII)[:_LONGEST]
    found = found if found[:1].isalpha() else f"x{found}"
    while found in _TAKEN or keyword.iskeyword(found) or keyword.issoftkeyword(found) or found in taken:
        found += "_"
    return found


def write_module(model: Model, extra: Sequence[py.Line | py.Block] = ()) -> str:
    """The text of the module; ``extra`` stands behind the model's function."""
    names = python_names(model)
    tables, functions = _tables(model, names)
    constants: list[py.Line] = []
    lines: list[py.Line] = []
    for variable in model.variables.values():
        value = _value(variable, names, functions)
        if value is not None:
            line = py.assign(names[variable.identifier], value, describe_variable(variable))
            (lines if variable.computed or variable.is_input else constants).append(line)
    outputs = [py.declare(names[v.identifier], f"{v.name}, {v.units}") for v in model.outputs]
    returned = ast.Return(py.call(OUTPUTS, *(py.name(names[v.identifier]) for v in model.outputs)))
    function = py.define(f"def {MODEL}():", _docstring(model, names), [*lines, py.Line(returned)])
    function.head.args.args = [ast.arg(names[v.identifier]) for v in model.inputs]
    function.head.args.defaults = [py.number(v.initial) for v in model.inputs if v.initial is not None]
    gives = py.define(f"class {OUTPUTS}(NamedTuple):", "What the model gives.", outputs)
    body = [*constants, *tables, gives, function, *extra]
    head = ast.Module([ast.Expr(ast.Constant(_head(model)))], [])
    return py.write_python(py.Block(head, [*_imports(set(py.names_in(body))), *body]))


def _head(model: Model) -> str:
    version = f" ({model.version})" if model.version else ""
    origin = f"Imported from {fold(model.path.name)}{version}, SHA-256 {model.digest}."
    parts = filter(None, (model.name.rstrip(".") + ".", model.description, origin))
    return "\n\n".join(textwrap.fill(part, py.WIDTH) for part in parts) + "\n"


def _imports(used: set[str]) -> Iterator[py.Line]:
    for module, known in (("math", FROM_MATH), ("typing", ("NamedTuple",)), ("abhv_mc.extend", extend.__all__)):
        if found := sorted(used & set(known)):
            yield py.Line(ast.ImportFrom(module, [ast.alias(one) for one in found], 0))
    if "DEGREE" in used:
        yield py.assign("DEGREE", py.fill("3.141592653589793 / 180.0"), "rad")


def describe_variable(variable: Variable) -> str:
    """Its name, units, sign and description."""
    sign = f" ({variable.sign})" if variable.sign else ""
    what = f"{variable.name}, {variable.units}{sign}"
    return f"{what}: {variable.description}" if variable.description else what


def _value(variable: Variable, names: dict[str, str], functions: dict[str, str]) -> ast.expr | None:
    """What a variable is set to; None for an input without limits."""
    if variable.formula is not None:
        values = {VARIABLE + identifier: py.name(text) for identifier, text in names.items()}
        value: ast.expr = py.substitute(copy.deepcopy(variable.formula), values)
    elif variable.look_up is not None:
        arguments = [_held(names[a.variable], a, variable.look_up, i) for i, a in enumerate(variable.look_up.arguments)]
        value = py.call(functions[variable.identifier], *arguments)
    elif not variable.is_input:
        return py.number(variable.initial or 0.0)
    elif variable.low is None and variable.high is None:
        return None
    else:
        value = py.name(names[variable.identifier])
    return _limited(value, variable.low, variable.high)


def _limited(value: ast.expr, low: float | None, high: float | None) -> ast.expr:
    if low is not None and high is not None:
        return py.call("clamp", value, py.number(low), py.number(high))
    if low is not None:
        return py.call("larger", value, py.number(low))
    return value if high is None else py.call("smaller", value, py.number(high))


def _held(text: str, argument: Argument, look_up: LookUp, axis: int) -> ast.expr:
    """An argument within the function's range, where that is narrower than the table."""
    points = look_up.table.points
    ends = look_up.table.grids[axis].points[[0, -1]] if points is None else np.array([-np.inf, np.inf])
    low = argument.low if argument.extrapolate in ("neither", "max") else None
    high = argument.high if argument.extrapolate in ("neither", "min") else None
    value = py.name(text) if low is None or low <= ends[0] else py.call("larger", py.name(text), py.number(low))
    return value if high is None or high >= ends[1] else py.call("smaller", value, py.number(high))


def _tables(model: Model, names: dict[str, str]) -> tuple[list[py.Line], dict[str, str]]:
    """Breakpoints and tables, each once; and the name of each variable's table."""
    found: dict[str, py.Line] = {}
    functions: dict[str, str] = {}

    def add(wanted: str, value: ast.expr, words: str = "") -> str:
        key = free_name(wanted, names.values())
        while key in found and ast.dump(value) != ast.dump(found[key].statement.value):
            key += "_"
        found.setdefault(key, py.assign(key, value, words))
        return key

    for variable in model.variables.values():
        look_up = variable.look_up
        if look_up is None:
            continue
        data, title = look_up.table, look_up.description or look_up.table.description or look_up.name
        if data.points is None:
            axes = [py.name(add(f"GRID_{grid.name}", py.sequence(grid.points))) for grid in data.grids]
            value = py.call("table", *axes, py.sequence(data.values))
        else:
            value = py.call("scattered", py.sequence(data.points), py.sequence(data.values))
        ends = [argument.extrapolate for argument in look_up.arguments]
        wanted = data.name if data.name.lower().endswith("table") else f"{data.name}_table"
        if data.points is None and set(ends) != {"neither"}:  # a table for this function
            value.keywords.append(ast.keyword("extrapolate", ast.Tuple(list(map(ast.Constant, ends)), ast.Load())))
            wanted = f"{wanted}_to_{'_'.join(ends)}"
        functions[variable.identifier] = add(wanted, value, f"{look_up.name}: {title}")
    return list(found.values()), functions


def _docstring(model: Model, names: dict[str, str]) -> str:
    lines = ["The outputs, in the units of the file.", ""]
    for variable in model.inputs:
        sign = f" ({variable.sign})" if variable.sign else ""
        words = f" - {variable.description}" if variable.description else ""
        text = f"{names[variable.identifier]}: {variable.name}, {variable.units}{sign}{words}"
        lines += textwrap.wrap(text, py.WIDTH, initial_indent="    ", subsequent_indent="        ")
    return "\n".join([*lines, "    "]) if model.inputs else "The outputs."
