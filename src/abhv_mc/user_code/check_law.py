"""What keeps a law from being compiled, found in its text and said in its user's terms, with line and column."""

import ast
import math
import types
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.units import parse_unit
from abhv_mc.kernel.laws.user import MAX_MEMORY
from abhv_mc.user_code.effector_commands import parse_law
from abhv_mc.user_code.law_interface import ARGUMENTS, CLASSES, GIVEN
from abhv_mc.user_code.module import Law

_REFUSED: dict[type[ast.AST], tuple[str, str]] = {
    ast.List: ("a list", "separate numbers, or a named tuple: lists are not allowed in a compiled law"),
    ast.ListComp: ("a list", "separate numbers: lists are not allowed in a compiled law"),
    ast.GeneratorExp: ("a generator", "separate numbers: generators are not allowed in a compiled law"),
    ast.Dict: ("a dictionary", "a named tuple: dictionaries are not allowed in a compiled law"),
    ast.DictComp: ("a dictionary", "a named tuple: dictionaries are not allowed in a compiled law"),
    ast.Set: ("a set", "separate numbers: sets are not allowed in a compiled law"),
    ast.SetComp: ("a set", "separate numbers: sets are not allowed in a compiled law"),
    ast.Import: ("an import inside a function", "the import at the head of the file"),
    ast.ImportFrom: ("an import inside a function", "the import at the head of the file"),
    ast.Try: ("'try'", "code without exceptions in a compiled law"),
    ast.Raise: ("'raise'", "code without exceptions in a compiled law"),
    ast.Assert: ("'assert'", "code without exceptions in a compiled law"),
    ast.With: ("'with'", "code without 'with' in a compiled law"),
    ast.JoinedStr: ("text", "numbers only in a compiled law"),
    ast.Yield: ("'yield'", "'return'"),
    ast.YieldFrom: ("'yield'", "'return'"),
    ast.Await: ("'await'", "a plain function"),
}
_REFUSED_CALLS = {
    "print": ("print()", "a channel or a metric instead: nothing is printed from a compiled law"),
    "open": ("open()", "what is read from files at the head of the file or in design()"),
    "list": ("a list", "separate numbers: lists are not allowed in a compiled law"),
    "dict": ("a dictionary", "a named tuple: dictionaries are not allowed in a compiled law"),
    "set": ("a set", "separate numbers: sets are not allowed in a compiled law"),
}


def check_law(law: Law) -> None:
    """Raise InputError for the first thing that is wrong with a law."""
    source = law.source
    tree = parse_law(source) if law.mark.compiled else ast.parse(source.text)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    node = find_function(source.file, functions, law.function)

    def line_of(kind: str, field: str) -> int | None:
        if kind not in classes:
            return None
        lines = [
            part.lineno
            for part in classes[kind].body
            if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name) and part.target.id == field
        ]
        return lines[0] if lines else classes[kind].lineno

    _check_arguments(law, node)
    if law.settings is not None:
        check_defaults(law, law.settings, "Settings", False, line_of)
    if law.commands is not None:
        check_defaults(law, law.commands, "Commands", False, line_of)
    for name, unit in law.mark.units.items():
        known = [*(law.settings._fields if law.settings else ()), *(law.commands._fields if law.commands else ())]
        if name not in known:
            expected = one_of(known, name) if known else "a field of Settings"
            raise InputError(source.file, f"a unit of '{name}'", expected, node.lineno)
        if not isinstance(unit, str):
            raise InputError(source.file, f"the unit {unit!r:.40} of '{name}'", "text such as 'deg'", node.lineno)
        try:
            parse_unit(unit)
        except Refusal as refusal:
            raise InputError(source.file, refusal.found, refusal.expected, node.lineno) from None
    if not law.mark.compiled:
        return
    if "memory" in law.arguments:
        check_defaults(law, law.memory, "Memory", True, line_of)
        if len(law.memory._fields) > MAX_MEMORY:
            found = f"a memory of {len(law.memory._fields)} numbers"
            raise InputError(source.file, found, f"at most {MAX_MEMORY}", line_of("Memory", ""))
    check_functions(source.file, node, functions, law.module.names)
    _check_fields(law, node)
    _check_returns(law, node)


def check_defaults(law: Law, kind: Any, words: str, needed: bool, line_of: Callable[[str, str], int | None]) -> None:
    """A class of numbers: a NamedTuple whose defaults are finite. Raises InputError."""
    file = law.source.file
    if not (isinstance(kind, type) and hasattr(kind, "_fields")):
        line = line_of(words, "")
        raise InputError(file, f"{words} that is no NamedTuple", f"class {words}(NamedTuple)", line)
    fields: Any = kind
    defaults = fields._field_defaults
    for name in fields._fields:
        value = defaults.get(name, 0.0)
        if name not in defaults and needed:
            found = f"no value for '{name}' at the start"
            raise InputError(file, found, f"{name}: float = 0.0", line_of(words, name))
        if not is_number(value):
            found = f"{value!r:.40} for '{name}'"
            raise InputError(file, found, "a finite number", line_of(words, name))


def is_number(value: object) -> bool:
    """Whether a default is a finite number."""
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def field_error(file: str, line: int | None, column: int | None, of: str, name: str, known: Any) -> InputError:
    """What to raise for a name that a named tuple does not have."""
    return InputError(file, f"{of}.{name}, which there is not", one_of(known, name), line, column)


def find_function(file: str, functions: dict[str, ast.FunctionDef], function: Any) -> ast.FunctionDef:
    """The text of a decorated function. Raises InputError where it is none of the file's own, outside of all else."""
    found = functions.get(getattr(function, "__name__", ""))
    if found is None:
        words = f"a decorator on '{getattr(function, '__name__', function)}', which is no function of the file"
        raise InputError(file, words, "one above 'def' at the left margin")
    return found


def _check_arguments(law: Law, node: ast.FunctionDef) -> None:
    file = law.source.file
    for argument in node.args.args + node.args.kwonlyargs:
        if argument.arg not in ARGUMENTS:
            place = argument.lineno, argument.col_offset + 1
            raise InputError(file, f"the argument '{argument.arg}'", one_of(ARGUMENTS, argument.arg), *place)
        name = CLASSES.get(argument.arg)
        missing = (argument.arg == "gains" and law.design is None) or (
            argument.arg in ("memory", "settings", "commands") and getattr(law, argument.arg) is None
        )
        if missing:
            expected = "design(model, settings) that returns them" if name == "gains" else f"class {name}(NamedTuple)"
            place = argument.lineno, argument.col_offset + 1
            raise InputError(file, f"'{argument.arg}' in a file without it", expected, *place)


def check_functions(
    file: str, first: ast.FunctionDef, functions: dict[str, ast.FunctionDef], names: dict[str, Any]
) -> None:
    """What cannot be compiled in a function and in those of its file that it calls. Raises InputError."""
    seen, pending = {first.name}, [first]
    while pending:
        function = pending.pop()
        local = _locals(function)
        for node in _walk(function):
            refused = _find_refused(node, names, local)
            if refused is not None:
                place = getattr(node, "lineno", function.lineno), getattr(node, "col_offset", 0) + 1
                raise InputError(file, refused[0], refused[1], *place)
            if isinstance(node, ast.Name) and node.id in functions and node.id not in seen:
                seen.add(node.id)
                pending.append(functions[node.id])


def _walk(function: ast.FunctionDef) -> Iterator[ast.AST]:
    for statement in function.body:
        yield from ast.walk(statement)


def _locals(function: ast.FunctionDef) -> set[str]:
    stored = {node.id for node in _walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    return stored | {argument.arg for argument in function.args.args + function.args.kwonlyargs}


def _find_refused(node: ast.AST, names: dict[str, Any], local: set[str]) -> tuple[str, str] | None:
    if type(node) in _REFUSED:
        return _REFUSED[type(node)]
    if isinstance(node, ast.Global | ast.Nonlocal):
        return f"'{node.names[0]}', a global that changes", "a field of Memory: a law sees one flight only"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _REFUSED_CALLS:
        return _REFUSED_CALLS[node.func.id]
    if isinstance(node, ast.Attribute) and node.attr == "_replace":
        return "_replace()", "the class with all its fields, such as Memory(...)"
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in local:
        if isinstance(names.get(node.id), list | dict | set | np.ndarray):
            kind = type(names[node.id]).__name__
            return f"'{node.id}', a global {kind}, which may change", "numbers, table(...), or gains from design()"
        if node.id not in names and node.id not in _BUILTINS:
            return f"the name '{node.id}', which is nowhere defined", "a name of the file or an argument"
    return None


_BUILTINS = set(dir(__builtins__)) if isinstance(__builtins__, types.ModuleType) else set(__builtins__)


def _check_fields(law: Law, function: ast.FunctionDef) -> None:
    """Fields of the arguments that there are not."""
    kinds: dict[str, Any] = {name: kind for name, kind in GIVEN.items() if name in law.arguments}
    kinds |= {name: getattr(law, name) for name in ("memory", "settings", "commands") if name in law.arguments}
    for node in _walk(function):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in kinds:
            known = kinds[node.value.id]._fields
            if node.attr not in known:
                place = node.lineno, (node.value.end_col_offset or 0) + 2
                raise field_error(law.source.file, *place, node.value.id, node.attr, known)


def _check_returns(law: Law, function: ast.FunctionDef) -> None:
    """Every way through the law returns a Command, and the memory where there is one."""
    file, expected = law.source.file, "return Command(...)"
    if "memory" in law.arguments:
        expected = "return Command(...), Memory(...)"
    if not _always_returns(function.body):
        last = function.body[-1]
        raise InputError(file, "a way through the law without 'return'", expected, last.lineno, last.col_offset + 1)
    for node in _walk(function):
        if isinstance(node, ast.Return):
            value = node.value
            pair = isinstance(value, ast.Tuple)
            lone = value is None or isinstance(value, ast.Constant)
            lone = lone or (isinstance(value, ast.Tuple) and len(value.elts) != 2)
            alone = isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "Command"
            if lone or (pair and "memory" not in law.arguments) or (alone and "memory" in law.arguments):
                text = ast.unparse(node)
                raise InputError(file, f"'{text:.60}'", expected, node.lineno, node.col_offset + 1)


def _always_returns(body: list[ast.stmt]) -> bool:
    for statement in body:
        if isinstance(statement, ast.Return):
            return True
        if isinstance(statement, ast.If) and _always_returns(statement.body) and _always_returns(statement.orelse):
            return True
    return False
