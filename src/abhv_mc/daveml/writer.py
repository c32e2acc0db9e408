"""A model as readable Python: its tables, its constants and one function from its inputs to its outputs."""

import builtins
import keyword
import re
import textwrap
from collections.abc import Iterable

import numpy as np

from abhv_mc import extend
from abhv_mc.array_types import Floats
from abhv_mc.daveml.formulas import write_formula
from abhv_mc.daveml.model import Model, Variable
from abhv_mc.daveml.tables import Argument, LookUp

WIDTH = 116
FROM_MATH = ("ceil", "floor", "fmod", "trunc")
OUTPUTS, MODEL = "Outputs", "model"
_OWN = (OUTPUTS, MODEL, "NamedTuple", "DEGREE", "SPAN", "CHORD", "Commands", "coefficients", "thrust", "law", "out")
_TAKEN = {*dir(builtins), *extend.__all__, *FROM_MATH, *_OWN}


def python_names(model: Model) -> dict[str, str]:
    """A Python name for each variable's identifier: its own where that is possible."""
    names: dict[str, str] = {}
    for identifier in model.variables:
        name = re.sub(r"\W", "_", identifier, flags=re.ASCII)
        name = f"x{name}" if not name or name[0].isdigit() else name
        while name in _TAKEN or keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in names.values():
            name += "_"
        names[identifier] = name
    return names


def write_module(model: Model, extra: str = "", extra_imports: Iterable[str] = ()) -> str:
    """The text of the module; ``extra`` are functions behind the model's, ``extra_imports`` what they need."""
    names = python_names(model)
    used: set[str] = set(extra_imports)
    constants, lines = [], []
    for variable in model.variables.values():
        text = _definition(variable, names, used)
        if text is not None and not variable.computed and not variable.is_input:
            constants.append(text)
        elif text is not None:
            lines.append(text)
    tables = _write_tables(model, used)
    outputs = "\n".join(f"    {names[v.identifier]}: float  # {v.name}, {v.units}" for v in model.outputs)
    given = ", ".join(names[v.identifier] + ("" if v.initial is None else f"={v.initial!r}") for v in model.inputs)
    returned = ", ".join(names[v.identifier] for v in model.outputs)
    parts = [
        _head(model) + "\n\n" + _imports(used),
        "\n".join(constants),
        tables,
        f'\nclass {OUTPUTS}(NamedTuple):\n    """What the model gives."""\n\n{outputs}',
        "\n"
        + "\n".join(
            [
                f"def {MODEL}({given}):" if len(given) < 100 else _wrapped(f"def {MODEL}(", given, "):"),
                _docstring(model, names),
                *(f"    {line}" for line in lines),
                _wrapped(f"    return {OUTPUTS}(", returned, ")"),
            ]
        ),
        *(["\n" + extra.strip("\n")] if extra else []),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(model: Model) -> str:
    text = [model.name.rstrip(".") + ".", ""]
    text += textwrap.wrap(model.description, WIDTH) + ([""] if model.description else [])
    version = f" ({model.version})" if model.version else ""
    text += [f"Imported from {model.path.name}{version},", f"SHA-256 {model.digest}."]
    return '"""' + "\n".join(text).replace("\\", "\\\\").replace('"""', "'''") + '\n"""'


def _imports(used: set[str]) -> str:
    lines = []
    if math := sorted(used & set(FROM_MATH)):
        lines.append(f"from math import {', '.join(math)}")
    lines.append("from typing import NamedTuple")
    if ours := sorted(used - set(FROM_MATH) - {"DEGREE"}):
        lines += ["", f"from abhv_mc.extend import {', '.join(ours)}"]
    if "DEGREE" in used:
        lines += ["", "DEGREE = 3.141592653589793 / 180.0  # rad"]
    return "\n".join(lines)


def _words(variable: Variable) -> str:
    sign = f" ({variable.sign})" if variable.sign else ""
    what = f"{variable.name}, {variable.units}{sign}"
    return f"{what}: {variable.description}" if variable.description else what


def _comment_lines(variable: Variable) -> list[str]:
    return textwrap.wrap(_words(variable), WIDTH, initial_indent="# ", subsequent_indent="# ")


def _definition(variable: Variable, names: dict[str, str], used: set[str]) -> str | None:
    """The line that sets a variable, under its description; None for an input without limits."""
    name = names[variable.identifier]
    if variable.formula is not None:
        text = write_formula(variable.formula, names, used)
    elif variable.look_up is not None:
        arguments = [
            _held(names[a.variable], a, variable.look_up, i, used) for i, a in enumerate(variable.look_up.arguments)
        ]
        text = f"{_table_name(variable.look_up)}({', '.join(arguments)})"
    elif variable.is_input:
        return None if variable.low is None and variable.high is None else f"{name} = {_limited(name, variable, used)}"
    else:
        line = f"{name} = {variable.initial!r}"
        words = _words(variable)
        if len(line) + len(words) + 4 <= WIDTH + 4:
            return f"{line}  # {words}"
        return "\n".join([*_comment_lines(variable), line])
    text = _limited(text, variable, used)
    line = f"{name} = {text}"
    if len(line) > WIDTH:
        line = _wrapped(f"    {name} = (", text, ")").strip()
    return "\n    ".join([*_comment_lines(variable), line])


def _limited(text: str, variable: Variable, used: set[str]) -> str:
    low, high = variable.low, variable.high
    if low is not None and high is not None:
        used.add("clamp")
        return f"clamp({text}, {low!r}, {high!r})"
    if low is not None:
        used.add("larger")
        return f"larger({text}, {low!r})"
    if high is not None:
        used.add("smaller")
        return f"smaller({text}, {high!r})"
    return text


def _held(text: str, argument: Argument, look_up: LookUp, axis: int, used: set[str]) -> str:
    """An argument within the function's range, where that is narrower than the table."""
    points = look_up.table.points
    ends = look_up.table.grids[axis].points[[0, -1]] if points is None else np.array([-np.inf, np.inf])
    low = argument.low if argument.extrapolate in ("neither", "max") else None
    high = argument.high if argument.extrapolate in ("neither", "min") else None
    if low is not None and low > ends[0]:
        used.add("larger")
        text = f"larger({text}, {low!r})"
    if high is not None and high < ends[1]:
        used.add("smaller")
        text = f"smaller({text}, {high!r})"
    return text


def _table_name(look_up: LookUp) -> str:
    """A name of the table for this function: the extrapolation is part of it."""
    name = re.sub(r"\W", "_", look_up.table.name, flags=re.ASCII).strip("_") or "table"
    name = f"t_{name}" if name[0].isdigit() or keyword.iskeyword(name) else name
    ends = [argument.extrapolate for argument in look_up.arguments]
    suffix = "" if set(ends) == {"neither"} else "_to_" + "_".join(ends)
    return f"{name if name.lower().endswith('table') else name + '_table'}{suffix}"


def _write_tables(model: Model, used: set[str]) -> str:
    """Breakpoints, then tables, each once."""
    grids: dict[str, Floats] = {}
    tables: dict[str, str] = {}
    for variable in model.variables.values():
        look_up = variable.look_up
        if look_up is None:
            continue
        data, title = look_up.table, look_up.description or look_up.table.description or look_up.name
        name = _table_name(look_up)
        if name in tables:
            continue
        comment = "\n".join(
            textwrap.wrap(f"{look_up.name}: {title}", WIDTH, initial_indent="# ", subsequent_indent="# ")
        )
        if data.points is None:
            used.add("table")
            keys = []
            for grid in data.grids:
                key = "GRID_" + re.sub(r"\W", "_", grid.name, flags=re.ASCII)
                while key in grids and not np.array_equal(grids[key], grid.points):
                    key += "_"
                grids[key] = grid.points
                keys.append(key)
            ends = tuple(argument.extrapolate for argument in look_up.arguments)
            last = "" if set(ends) == {"neither"} else f"    extrapolate={ends!r},\n"
            axes = "".join(f"    {key},\n" for key in keys)
            tables[name] = f"{comment}\n{name} = table(\n{axes}{_nested(data.values, 1)},\n{last})"
        else:
            used.add("scattered")
            body = f"{_nested(data.points, 1)},\n{_nested(data.values, 1)}"
            tables[name] = f"{comment}\n{name} = scattered(\n{body},\n)"
    heads = [_wrapped(f"{key} = (", _numbers(points), ")").rstrip("\n") for key, points in grids.items()]
    return "\n\n".join((["\n".join(heads)] if heads else []) + list(tables.values()))


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{float(value)!r}" for value in values)


def _nested(values: Floats, depth: int) -> str:
    indent = "    " * depth
    if values.ndim == 1:
        return "\n".join(
            textwrap.wrap(f"({_numbers(values)})", WIDTH, initial_indent=indent, subsequent_indent=indent + " ")
        )
    inner = ",\n".join(_nested(part, depth + 1) for part in values)
    return f"{indent}(\n{inner},\n{indent})"


def _wrapped(head: str, body: str, tail: str) -> str:
    """One line where it fits, else the body on lines of its own."""
    if len(head) + len(body) + len(tail) <= WIDTH:
        return f"{head}{body}{tail}"
    indent = " " * (len(head) - len(head.lstrip()) + 4)
    inner = textwrap.wrap(body, WIDTH - len(indent), break_long_words=False, break_on_hyphens=False)
    return head + "\n" + "\n".join(indent + line for line in inner) + "\n" + " " * (len(indent) - 4) + tail


def _docstring(model: Model, names: dict[str, str]) -> str:
    lines = ['    """The outputs, in the units of the file.', ""]
    for variable in model.inputs:
        sign = f" ({variable.sign})" if variable.sign else ""
        words = f" - {variable.description}" if variable.description else ""
        text = f"{names[variable.identifier]}: {variable.name}, {variable.units}{sign}{words}"
        lines += textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="        ")
    return "\n".join(lines).replace("\\", "\\\\") + '\n    """' if model.inputs else '    """The outputs."""'
