"""Conversion of control laws defined in a notebook to the source text of a Python file."""

import inspect
import sys
import textwrap
import types
from collections.abc import Callable
from typing import Any

from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.user_code.law_interface import CLASSES
from abhv_mc_vehicle.user_code.module import CONTROLLER

_EXTEND = "abhv_mc.extend"
_HEAD = f"from typing import NamedTuple\n\nfrom {_EXTEND} import controller\n"


def make_law_text(function: Callable[..., Any]) -> str:
    """Return the text of a Python file with the control law and all names that it uses.

    The names include Settings, Memory, design and their dependencies. Raise InputError for values
    that cannot be written as source text, such as arrays; ``design`` can return arrays instead.
    """
    if not isinstance(function, types.FunctionType):
        raise InputError(
            "controller",
            f"found {function!r:.60}",
            "a function, or the name or file of a controller",
        )
    definitions: dict[str, str] = {}
    arguments = inspect.signature(function).parameters
    for argument, name in CLASSES.items():
        if argument in arguments and name in function.__globals__:
            _take(name, function.__globals__[name], function, definitions)
    _take(function.__name__, function, function, definitions)
    law = definitions[function.__name__]
    if CONTROLLER not in function.__dict__:
        definitions[function.__name__] = f"@controller\n{law}"
    return _HEAD + "\n\n" + "\n\n".join(definitions.values())


def _take(name: str, value: Any, law: types.FunctionType, definitions: dict[str, str]) -> None:
    """Add the definition of a name after the definitions of its dependencies."""
    if name in definitions or name in dir(__builtins__):
        return
    if isinstance(value, types.ModuleType):
        definitions[name] = f"import {value.__name__} as {name}\n"
    elif (
        isinstance(value, type) and hasattr(value, "_fields") and value.__module__ == law.__module__
    ):
        definitions[name] = _describe_tuple(name, value)
    elif isinstance(value, types.FunctionType) and value.__globals__ is law.__globals__:
        definitions[name] = ""  # Functions may be recursive.
        for used in _names(value.__code__):
            if used in value.__globals__ and used != "controller":
                _take(used, value.__globals__[used], law, definitions)
        del definitions[name]
        try:
            definitions[name] = textwrap.dedent(inspect.getsource(value))
        except OSError:
            raise InputError(
                name,
                "the source text of the function is not available",
                "a function defined in a notebook cell or a file",
            ) from None
    elif isinstance(value, int | float | str | tuple):
        definitions[name] = f"{name} = {value!r}\n"
    elif hasattr(value, "__module__") and hasattr(value, "__name__"):
        home = value.__module__
        original = value.__name__
        if home.startswith(
            ("abhv_mc.", "abhv_mc_vehicle.")
        ):  # A law that outlives this version imports only extend.
            home = _EXTEND
            original = _find_public_name(name, value)
        definitions[name] = f"from {home} import {original} as {name}\n"
    else:
        raise InputError(
            "controller",
            f"the law '{law.__name__}' uses '{name}' of type {type(value).__name__}",
            "numbers, functions or named tuples (design() can return arrays)",
        )


def _find_public_name(name: str, value: Any) -> str:
    """Return the name of a value in ``abhv_mc.extend``. Raise InputError if there is none."""
    for public, known in vars(sys.modules.get(_EXTEND, types)).items():
        if known is value:
            return public
    raise InputError(
        "controller", f"the law uses '{name}' of {value.__module__}", f"names of {_EXTEND}"
    )


def _names(code: types.CodeType) -> list[str]:
    """Return the global names used by a code object and its nested functions."""
    inner = (constant for constant in code.co_consts if isinstance(constant, types.CodeType))
    return list(
        dict.fromkeys(
            [*code.co_names, *(name for inner_code in inner for name in _names(inner_code))]
        )
    )


def _describe_tuple(name: str, kind: Any) -> str:
    """Return source text that defines a named tuple; notebooks do not store class sources."""
    defaults = kind._field_defaults
    rows = [
        f"    {field}: float" + (f" = {defaults[field]!r}" if field in defaults else "")
        for field in kind._fields
    ]
    return f"class {name}(NamedTuple):\n" + "\n".join(rows) + "\n"
