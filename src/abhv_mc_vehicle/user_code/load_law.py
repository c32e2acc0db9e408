"""Loading and checking of control laws in Python files.

Errors state the line of the user's file that cannot be compiled.
"""

import ast
import builtins
import functools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError, Refusal, counted, one_of
from abhv_mc.io.units import parse_unit
from abhv_mc_vehicle.kernel.laws.user import MAX_MEMORY
from abhv_mc_vehicle.user_code.effector_commands import parse_law
from abhv_mc_vehicle.user_code.law_interface import ARGUMENTS, CLASSES, FILTER_ARGUMENTS, GIVEN
from abhv_mc_vehicle.user_code.module import (
    CONTROLLER,
    ControllerMark,
    Law,
    Module,
    arguments_of,
    refuse_in_words,
    run_module,
    texts_of,
)

_REFUSED = {
    "lists": (ast.List, ast.ListComp, ast.GeneratorExp),
    "dictionaries": (ast.Dict, ast.DictComp),
    "sets": (ast.Set, ast.SetComp),
    "exceptions": (ast.Try, ast.Raise, ast.Assert),
    "imports": (ast.Import, ast.ImportFrom),
}
_REFUSED_CALLS = {
    "print": "prints",
    "open": "files",
    "list": "lists",
    "dict": "dictionaries",
    "set": "sets",
}


@functools.lru_cache(maxsize=64)
def load_law(source: UserSource) -> Law:
    """Run a Python file and return its control law. Raise InputError if it is invalid."""
    module = run_module(source)
    with refuse_in_words(source, "the law", "an ordinary function, and named tuples of numbers"):
        controllers = module.marked(CONTROLLER)
        if len(controllers) != 1:
            problem = (
                f"the file has {counted(len(controllers), 'function')} with @controller"
                if controllers
                else "the file has no function with @controller or @measurement_filter"
            )
            raise InputError(
                source.file,
                problem,
                "exactly one function; import the decorator with "
                "'from abhv_mc.extend import controller'",
            )
        ((name, function),) = controllers.items()
        mark: ControllerMark = getattr(function, CONTROLLER)
        allowed = FILTER_ARGUMENTS if mark.filters else ARGUMENTS
        arguments = module.check_arguments(name, allowed)
        names = module.names.get
        defined = names("Memory"), names("Settings"), names("Commands"), names("design")
        law = Law(module, function, mark, arguments, *defined)
        line = module.texts[name].lineno
        _check_classes(law, line)
        _check_units(law, line)
        _check_dispersable(law, line)
        if mark.compiled:
            check_functions(module, name, texts_of(parse_law(source)))
            check_fields(module, name, _fields_of(law))
            _check_returns(law, name)
    return law


def _check_classes(law: Law, line: int) -> None:
    """Raise InputError if an argument is undefined or a class has invalid fields."""
    file = law.source.file
    for argument, class_name in CLASSES.items():
        kind = law.module.names.get(class_name)
        if kind is None and argument in law.arguments:
            expected = (
                "a function design(model, settings) that returns the gains"
                if class_name == "design"
                else f"class {class_name}(NamedTuple)"
            )
            raise InputError(
                file,
                f"the law has the argument '{argument}', which the file does not define",
                expected,
                line,
            )
        if (
            kind is None
            or class_name == "design"
            or (class_name == "Memory" and not law.mark.compiled)
        ):
            continue
        class_line = law.module.texts[class_name].lineno if class_name in law.module.texts else None
        if not (isinstance(kind, type) and hasattr(kind, "_fields")):
            raise InputError(
                file,
                f"{class_name} is not a NamedTuple",
                f"class {class_name}(NamedTuple)",
                class_line,
            )
        fields: Any = kind
        for name in fields._fields:
            value = fields._field_defaults.get(name, None if class_name == "Memory" else 0.0)
            if not is_number(value):
                raise InputError(
                    file,
                    f"the default of '{name}' is {value!r:.40}",
                    f"a finite number, as in '{name}: float = 0.0'",
                    class_line,
                )
        if class_name == "Memory" and len(fields._fields) > MAX_MEMORY:
            raise InputError(
                file,
                f"the class Memory has {counted(len(fields._fields), 'number')}",
                f"at most {MAX_MEMORY}",
                class_line,
            )


def is_number(value: object) -> bool:
    """Return whether a default is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_units(law: Law, line: int) -> None:
    field_names = [
        name for kind in (law.settings, law.commands) if kind is not None for name in kind._fields
    ]
    for name, unit in law.mark.units.items():
        try:
            if name not in field_names:
                raise Refusal(
                    f"'units' names '{name}', which is not a field",
                    one_of(field_names, name) if field_names else "a field of Settings",
                )
            if not isinstance(unit, str):
                raise Refusal(f"the unit of '{name}' is {unit!r:.40}", "text such as 'deg'")
            parse_unit(unit)
        except Refusal as refusal:
            raise InputError(law.source.file, refusal.found, refusal.expected, line) from None


def _check_dispersable(law: Law, line: int) -> None:
    """Raise InputError if a dispersable setting is unknown or the law is not compiled."""
    known = law.settings._fields if law.settings is not None else ()
    for name in law.mark.dispersable:
        if name not in known or not law.mark.compiled:
            found = f"the setting '{name}' cannot be dispersed"
            expected = one_of(known, name) if law.mark.compiled else "a compiled law"
            raise InputError(law.source.file, found, expected, line)


def check_functions(module: Module, name: str, texts: dict[str, Any] | None = None) -> None:
    """Check that a function, and each function that it calls, can be compiled.

    ``texts`` are the syntax trees to check instead of those of the module. Raise InputError if a
    construct is not allowed.
    """
    texts = texts or module.texts
    seen = {name}
    pending = [name]
    while pending:
        function = texts[pending.pop()]
        local = {argument.arg for argument in arguments_of(function)}
        local |= {
            child.id
            for child in _walk(function)
            if isinstance(child, ast.Name) and isinstance(child.ctx, ast.Store)
        }
        for node in _walk(function):
            refused = _find_refused(node, module.names, local)
            if refused is not None:
                location = (
                    getattr(node, "lineno", function.lineno),
                    getattr(node, "col_offset", 0) + 1,
                )
                raise InputError(module.source.file, refused[0], refused[1], *location)
            called = node.id if isinstance(node, ast.Name) else ""
            if called not in seen and isinstance(texts.get(called), ast.FunctionDef):
                seen.add(called)
                pending.append(called)


def _walk(function: ast.FunctionDef) -> Iterator[ast.AST]:
    for statement in function.body:
        yield from ast.walk(statement)


def _find_refused(node: ast.AST, names: dict[str, Any], local: set[str]) -> tuple[str, str] | None:
    construct = next(
        (construct for construct, kinds in _REFUSED.items() if isinstance(node, kinds)), None
    )
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        construct = _REFUSED_CALLS.get(node.func.id)
    if construct is not None:
        return (
            f"the code contains {construct}",
            f"numbers, named tuples and functions, because {construct} cannot be compiled",
        )
    if isinstance(node, ast.Global | ast.Nonlocal):
        return (
            f"the code modifies the global variable '{node.names[0]}'",
            "a field of Memory instead, because flights cannot share variables",
        )
    if isinstance(node, ast.Name) and node.id not in local:
        if isinstance(names.get(node.id), list | dict | set | np.ndarray):
            kind = type(names[node.id]).__name__
            return (
                f"the global {kind} '{node.id}' may change",
                "numbers, table(...), or gains from design()",
            )
        if node.id not in names and not hasattr(builtins, node.id):
            return (
                f"the name '{node.id}' is not defined",
                "a name defined in the file, or an argument",
            )
    return None


def _fields_of(law: Law) -> dict[str, Any]:
    """Return the class of each argument of a law."""
    kinds = {argument: kind for argument, kind in GIVEN.items() if argument in law.arguments}
    return kinds | {
        parameter: getattr(law, parameter)
        for parameter in ("memory", "settings", "commands")
        if parameter in law.arguments
    }


def check_fields(module: Module, name: str, kinds: dict[str, Any]) -> None:
    """Raise InputError for an attribute that an argument of a function does not have.

    ``kinds`` gives the class of each argument.
    """
    for node in _walk(module.texts[name]):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in kinds
        ):
            argument = node.value.id
            fields = kinds[node.value.id]._fields
            if node.attr not in fields:
                location = node.lineno, (node.value.end_col_offset or 0) + 2
                expected = one_of(fields, node.attr)
                raise InputError(
                    module.source.file,
                    f"{argument}.{node.attr} does not exist",
                    expected,
                    *location,
                )


def _check_returns(law: Law, name: str) -> None:
    """Check that each return value is a Command (or Filtered).

    A function with an argument ``memory`` must also return a Memory.
    """
    remembers = "memory" in law.arguments
    result_class = "Filtered" if law.mark.filters else "Command"
    expected = f"'return {result_class}(...){', Memory(...)' if remembers else ''}'"

    def is_wrong(value: ast.expr | None) -> bool:
        if isinstance(value, ast.Tuple):
            return not remembers or len(value.elts) != 2
        if isinstance(value, ast.Call) and getattr(value.func, "id", "") == result_class:
            return remembers
        return value is None or isinstance(value, ast.Constant)

    check_returns(law.module, name, is_wrong, expected)


def check_returns(
    module: Module, name: str, is_wrong: Callable[[ast.expr | None], bool], expected: str
) -> None:
    """Raise InputError for a wrong return value, or a path without a return statement."""
    function = module.texts[name]
    wrong = [
        node for node in _walk(function) if isinstance(node, ast.Return) and is_wrong(node.value)
    ]
    if wrong or not _always_returns(function.body):
        last = [*wrong, function.body[-1]][0]
        problem = (
            f"found '{ast.unparse(last):.60}'"
            if wrong
            else f"the function '{name}' can end without 'return'"
        )
        raise InputError(module.source.file, problem, expected, last.lineno, last.col_offset + 1)


def _always_returns(body: list[ast.stmt]) -> bool:
    return any(
        isinstance(statement, ast.Return)
        or (
            isinstance(statement, ast.If)
            and _always_returns(statement.body)
            and _always_returns(statement.orelse)
        )
        for statement in body
    )
