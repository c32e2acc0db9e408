"""Custom Python files, run as modules after a first, monitored run in a child process."""

import ast
import contextlib
import functools
import hashlib
import linecache
import os
import re
import traceback
import types
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from abhv_mc.custom_code.child import LostError, in_child
from abhv_mc.custom_code.source import UserSource, compile_text
from abhv_mc.io.messages import InputError, one_of
from abhv_mc_vehicle.user_code.unpack import in_its_folder, laws_folder, unpack, watching

_LONGEST = 600.0  # time limit for running a file, s
MODULE = "abhv_mc_own_"  # prefix of the names of custom modules
CONTROLLER, CHANNEL, DYNAMICS = (
    "_abhv_mc_controller",
    "_abhv_mc_channel",
    "_abhv_mc_dynamics",
)  # names of the attributes that the decorators set


@dataclass(frozen=True)
class ControllerMark:
    """Arguments of the decorator ``controller``."""

    units: dict[str, str] = field(default_factory=dict)  # unit of each setting, by name
    compiled: bool = True
    dispersable: tuple[str, ...] = ()  # settings that a campaign may disperse
    filters: bool = False  # whether the function is a measurement filter


def texts_of(tree: ast.Module) -> dict[str, Any]:
    """Return the syntax trees of a file's functions and classes, by name."""
    return {
        node.name: node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }


def arguments_of(function: ast.FunctionDef) -> list[ast.arg]:
    """Return all arguments of a function except ``*args`` and ``**kwargs``."""
    return [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]


@dataclass(frozen=True)
class Module:
    """Custom Python file that was run, with its global names."""

    source: UserSource
    names: dict[str, Any]  # global names of the file

    def marked(self, mark: str) -> dict[str, Callable[..., Any]]:
        """Return the functions marked by a decorator of ``abhv_mc.extend``, by function name.

        ``mark`` is the attribute that the decorator sets.
        """
        functions = {
            name: value for name, value in self.names.items() if type(value) is types.FunctionType
        }
        return {name: function for name, function in functions.items() if mark in function.__dict__}

    @functools.cached_property
    def texts(self) -> dict[str, Any]:
        """Syntax trees of the module's functions and classes, by name."""
        return texts_of(ast.parse(self.source.text))

    def check_arguments(self, function: str, allowed: Iterable[str]) -> tuple[str, ...]:
        """Return the arguments of a function. Raise InputError for an unknown argument."""
        if not isinstance(self.texts.get(function), ast.FunctionDef):
            raise InputError(
                self.source.file,
                f"a decorator is applied to '{function}', which is not a function in the file",
                "a function at module level below the decorator",
            )
        function_arguments = arguments_of(self.texts[function])
        for argument in function_arguments:
            if argument.arg not in allowed:
                location = argument.lineno, argument.col_offset + 1
                raise InputError(
                    self.source.file,
                    f"unknown argument '{argument.arg}'",
                    one_of(allowed, argument.arg),
                    *location,
                )
        return tuple(argument.arg for argument in function_arguments)


@dataclass(frozen=True)
class Law:
    """Control law defined in a file: the function, its arguments and its classes."""

    module: Module
    function: Callable[..., Any]
    mark: ControllerMark
    arguments: tuple[str, ...]
    memory: Any  # class of the law's memory, or None
    settings: Any  # class of the law's settings, or None
    commands: Any  # class of the law's commands, or None
    design: Callable[..., Any] | None

    @property
    def source(self) -> UserSource:
        return self.module.source


def check_closure(source: UserSource) -> None:
    """Run a Python file in the child process, once per version of its content.

    Raise InputError if the file fails or reads undeclared files.
    """
    key = hashlib.sha256(f"{source.hash} {source.file} {code_hash()}".encode()).hexdigest()[:24]
    note = laws_folder() / f"closed_{key}"
    if note.exists():
        return
    try:
        in_child(_run_watched, source, limit=_LONGEST)
    except LostError as lost:
        raise InputError(
            source.file, f"the file cannot be run ({lost.words})", "a file that runs without errors"
        ) from None
    note.touch()


def _run_watched(source: UserSource) -> None:
    run_module.cache_clear()  # Run the file again, because a cached module opens no files.
    with watching(source):
        run_module(source)


@functools.cache
def code_hash() -> str:
    """Return the hash of this package's code for the cache of compiled custom code."""
    folder = Path(__file__).parent
    files = [*sorted(folder.glob("*.py")), *sorted(folder.glob("*.h")), folder.parent / "extend.py"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.lru_cache(maxsize=64)
def run_module(source: UserSource) -> Module:
    """Run a custom file as a module. Raise InputError, with the line, if it fails."""
    linecache.cache[source.file] = (
        len(source.text),
        None,
        source.text.splitlines(keepends=True),
        source.file,
    )
    module = types.ModuleType(f"{MODULE}{source.hash[:16]}")
    module.__file__ = str(unpack(source) / source.files[0][0]) if source.files else source.file
    code = compile_text(source)
    with (
        refuse_in_words(source, "the file", "a file that runs without errors"),
        in_its_folder(source),
    ):
        exec(code, module.__dict__)  # executes the user's file
    return Module(source, module.__dict__)


@contextlib.contextmanager
def refuse_in_words(source: UserSource, what: str, expected: str) -> Iterator[None]:
    """Convert exceptions raised by custom code in the context to InputErrors with lines.

    OSErrors and MemoryErrors outside custom code, such as a full disk, are not converted.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        line = find_line(error, source.file)
        if (missed := _undeclared(source, error)) is not None:
            raise InputError(
                source.file,
                f"{what} {missed[0]}, which is not declared",
                f"'files: [{missed[1]}]' in the controller file",
                line,
            ) from None
        if line is None and isinstance(error, OSError | MemoryError):
            raise
        raise InputError(
            source.file, f"{what} raised an exception ({describe_exception(error)})", expected, line
        ) from None


def _undeclared(source: UserSource, error: Exception) -> tuple[str, str] | None:
    """Return a message about an undeclared file or module, and its entry for ``files``.

    The result is None if the file is not in the folder of the control law.
    """
    beside = Path(source.file).parent
    if isinstance(error, ModuleNotFoundError):
        top = str(error.name).partition(".")[0]
        entry = next((name for name in (f"{top}.py", f"{top}/") if (beside / name).exists()), None)
        return (f"imports '{error.name}'", entry) if entry else None
    # For numpy, only the text of the exception contains the name of the missing file.
    if isinstance(error, FileNotFoundError):
        candidates = [str(error.filename), *re.findall(r"[\w./-]+\w", describe_exception(error))]
        named = (os.path.relpath(beside / word, beside) for word in candidates)
        entry = next(
            (name for name in named if (beside / name).is_file() and not name.startswith("..")),
            None,
        )
        return (f"opens '{entry}'", entry) if entry else None
    return None


def describe_exception(error: BaseException) -> str:
    """Return the type and text of an exception, or only its type if ``str`` fails."""
    name = type(error).__name__
    try:
        return f"{name}: {error!s:.300}"
    except Exception:
        return name


def find_line(error: BaseException, file: str) -> int | None:
    """Return the line of the last frame of ``file`` in a traceback, or None."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    return lines[-1] if lines else None
