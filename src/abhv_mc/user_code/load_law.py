"""The law that a user's Python file defines, checked before it flies."""

import functools
import inspect

from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.check_law import check_law
from abhv_mc.user_code.module import CONTROLLER, ControllerMark, Law, refuse_in_words, run_module
from abhv_mc.user_code.source import UserSource


@functools.lru_cache(maxsize=64)
def load_law(source: UserSource) -> Law:
    """Run a controller's file and find what it defines; checked in the user's terms. Raises InputError."""
    module = run_module(source)
    with refuse_in_words(source, "a law", "a plain function, and named tuples of numbers"):
        found = module.marked(CONTROLLER)
        if len(found) != 1:
            words = f"{len(found)} functions with @controller" if found else "no function with @controller"
            raise InputError(source.file, words, "one: from abhv_mc.extend import controller")
        (function,) = found.values()
        mark: ControllerMark = getattr(function, CONTROLLER)
        law = Law(
            module,
            function,
            mark,
            tuple(inspect.signature(function).parameters),
            module.names.get("Memory"),
            module.names.get("Settings"),
            module.names.get("Commands"),
            module.names.get("design"),
        )
        check_law(law)
    return law
