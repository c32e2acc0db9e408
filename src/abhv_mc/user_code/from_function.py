"""A law that was defined in a notebook, as the text of a file: the function and what it names, taken by ``inspect``."""

import inspect
import textwrap
import types
from collections.abc import Callable
from typing import Any

from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.law_interface import CLASSES
from abhv_mc.user_code.module import CONTROLLER

_HEAD = "from typing import NamedTuple\n\nfrom abhv_mc.extend import controller\n"


def make_law_text(function: Callable[..., Any]) -> str:
    """A Python file that holds the law, its Settings, Memory and design, and all that they name.

    Raises InputError for what no text can be made of, such as an array: ``design`` returns arrays.
    """
    if not isinstance(function, types.FunctionType):
        raise InputError(
            "controller", f"{function!r:.60}", "a function, or a controller's name or file"
        )
    made: dict[str, str] = {}
    arguments = inspect.signature(function).parameters
    for argument, name in CLASSES.items():
        if argument in arguments and name in function.__globals__:
            _take(name, function.__globals__[name], function, made)
    _take(function.__name__, function, function, made)
    law = made[function.__name__]
    if CONTROLLER not in function.__dict__:
        made[function.__name__] = f"@controller\n{law}"
    return _HEAD + "\n\n" + "\n\n".join(made.values())


def _take(name: str, value: Any, law: types.FunctionType, made: dict[str, str]) -> None:
    """Add the text that defines a name, after that of what it needs itself."""
    if name in made or name in dir(__builtins__):
        return
    if isinstance(value, types.ModuleType):
        made[name] = f"import {value.__name__} as {name}\n"
    elif (
        isinstance(value, type) and hasattr(value, "_fields") and value.__module__ == law.__module__
    ):
        made[name] = _describe_tuple(name, value)
    elif isinstance(value, types.FunctionType) and value.__globals__ is law.__globals__:
        made[name] = ""  # it may call itself
        for used in _names(value.__code__):
            if used in value.__globals__ and used != "controller":
                _take(used, value.__globals__[used], law, made)
        del made[name]
        try:
            made[name] = textwrap.dedent(inspect.getsource(value))
        except OSError:
            raise InputError(
                name, "a function without its text", "one of a cell or a file"
            ) from None
    elif isinstance(value, int | float | str | tuple):
        made[name] = f"{name} = {value!r}\n"
    elif hasattr(value, "__module__") and hasattr(value, "__name__"):
        made[name] = f"from {value.__module__} import {value.__name__} as {name}\n"
    else:
        found = f"'{name}', a {type(value).__name__}, in the law {law.__name__}"
        raise InputError(
            "controller", found, "numbers, functions and named tuples; arrays from design()"
        )


def _names(code: types.CodeType) -> list[str]:
    """Global names that code and the functions inside it use."""
    inner = (constant for constant in code.co_consts if isinstance(constant, types.CodeType))
    return list(dict.fromkeys([*code.co_names, *(name for each in inner for name in _names(each))]))


def _describe_tuple(name: str, kind: Any) -> str:
    """The text of a named tuple: a notebook knows none of a class."""
    defaults = kind._field_defaults
    rows = [
        f"    {field}: float" + (f" = {defaults[field]!r}" if field in defaults else "")
        for field in kind._fields
    ]
    return f"class {name}(NamedTuple):\n" + "\n".join(rows) + "\n"
