"""Custom Python files, run as modules after one watched run in a child process."""

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

from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.user_code.child import LostError, in_child
from abhv_mc.user_code.source import UserSource, compile_text
from abhv_mc.user_code.unpack import in_its_folder, laws_folder, unpack
from abhv_mc.user_code.watch import watching

_LONGEST = 600.0  # s that a file may run
MODULE = "abhv_mc_own_"  # how the modules that are made of such files are called
CONTROLLER, CHANNEL, DYNAMICS = (
    "_abhv_mc_controller",
    "_abhv_mc_channel",
    "_abhv_mc_dynamics",
)  # attributes that the decorators set


@dataclass(frozen=True)
class ControllerMark:
    """Arguments of the decorator ``controller``."""

    units: dict[str, str] = field(default_factory=dict)  # of settings
    compiled: bool = True
    dispersable: tuple[str, ...] = ()  # settings that a campaign may vary from flight to flight
    filters: bool = False  # a measurement, before a law of the program; it is no law itself


@dataclass(frozen=True)
class ChannelMark:
    """Arguments of the decorator ``channel``."""

    unit: str
    name: str
    doc: str


def texts_of(tree: ast.Module) -> dict[str, Any]:
    """Return the syntax trees of functions and classes of a file by name."""
    return {
        node.name: node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }


def arguments_of(function: ast.FunctionDef) -> list[ast.arg]:
    """Return all arguments that can be passed by name or position."""
    return [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]


@dataclass(frozen=True)
class Module:
    """Custom file that was run."""

    source: UserSource
    names: dict[str, Any]  # its globals

    def marked(self, mark: str) -> dict[str, Callable[..., Any]]:
        """Return the functions with a decorator of ours, by name."""
        functions = {
            name: value for name, value in self.names.items() if type(value) is types.FunctionType
        }
        return {name: function for name, function in functions.items() if mark in function.__dict__}

    @functools.cached_property
    def texts(self) -> dict[str, Any]:
        """Syntax trees of its functions and classes by name."""
        return texts_of(ast.parse(self.source.text))

    def check_arguments(self, function: str, allowed: Iterable[str]) -> tuple[str, ...]:
        """Return the arguments of a function. Raise InputError for an unknown one."""
        if not isinstance(self.texts.get(function), ast.FunctionDef):
            problem = f"a decorator on '{function}', which is no function of the file"
            raise InputError(self.source.file, problem, "one above 'def' at the left margin")
        function_arguments = arguments_of(self.texts[function])
        for argument in function_arguments:
            if argument.arg not in allowed:
                location = argument.lineno, argument.col_offset + 1
                problem = f"the argument '{argument.arg}'"
                raise InputError(
                    self.source.file, problem, one_of(allowed, argument.arg), *location
                )
        return tuple(argument.arg for argument in function_arguments)


@dataclass(frozen=True)
class Law:
    """Control law of a file: the function, its arguments and classes."""

    module: Module
    function: Callable[..., Any]
    mark: ControllerMark
    arguments: tuple[str, ...]
    memory: Any  # class of its memory, None without
    settings: Any  # class of its settings, None without
    commands: Any  # class of its commands, None without
    design: Callable[..., Any] | None

    @property
    def source(self) -> UserSource:
        return self.module.source


def check_closure(source: UserSource) -> None:
    """Run a Python file in the child process, once for each content.

    Raise InputError if it fails or reads undeclared files.
    """
    key = hashlib.sha256(f"{source.hash} {source.file} {code_hash()}".encode()).hexdigest()[:24]
    note = laws_folder() / f"closed_{key}"
    if note.exists():
        return
    try:
        in_child(_run_watched, source, limit=_LONGEST)
    except LostError as lost:
        problem = f"a file that does not run: {lost.words}"
        raise InputError(source.file, problem, "a file that runs on its own") from None
    note.touch()


def _run_watched(source: UserSource) -> None:
    run_module.cache_clear()  # a module that ran already opens nothing
    with watching(source):
        run_module(source)


@functools.cache
def code_hash() -> str:
    """Return the hash of this package's code, on which compiled custom code depends."""
    folder = Path(__file__).parent
    files = [*sorted(folder.glob("*.py")), *sorted(folder.glob("*.h")), folder.parent / "extend.py"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.lru_cache(maxsize=64)
def run_module(source: UserSource) -> Module:
    """Return a custom file that was run. Raise InputError, with the line, if it fails."""
    linecache.cache[source.file] = (
        len(source.text),
        None,
        source.text.splitlines(keepends=True),
        source.file,
    )
    module = types.ModuleType(f"{MODULE}{source.hash[:16]}")
    module.__file__ = str(unpack(source) / source.files[0][0]) if source.files else source.file
    code = compile_text(source)
    with refuse_in_words(source, "a file", "a file that runs on its own"), in_its_folder(source):
        exec(code, module.__dict__)  # the user's own file
    return Module(source, module.__dict__)


@contextlib.contextmanager
def refuse_in_words(source: UserSource, what: str, expected: str) -> Iterator[None]:
    """Raise InputError, with the line, for any exception of custom code in the context.

    Full disks or exhausted memory outside the custom code are not converted.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        line = _line_in(error, source.file)
        if (missed := _undeclared(source, error)) is not None:
            problem = f"{what} that {missed[0]}, which it does not declare"
            raise InputError(
                source.file, problem, f"files: [{missed[1]}] in its controller file", line
            ) from None
        if line is None and isinstance(error, OSError | MemoryError):
            raise
        raise InputError(
            source.file, f"{what} that raises {_describe(error)}", expected, line
        ) from None


def _undeclared(source: UserSource, error: Exception) -> tuple[str, str] | None:
    """Return text on a missing file or module, and its entry for ``files``.

    The result is None unless the file is next to the control law.
    """
    beside = Path(source.file).parent
    if isinstance(error, ModuleNotFoundError):
        top = str(error.name).partition(".")[0]
        entry = next((name for name in (f"{top}.py", f"{top}/") if (beside / name).exists()), None)
        return (f"imports '{error.name}'", entry) if entry else None
    if isinstance(error, FileNotFoundError):  # numpy names the file only in the message
        candidates = [str(error.filename), *re.findall(r"[\w./-]+\w", _describe(error))]
        named = (os.path.relpath(beside / word, beside) for word in candidates)
        entry = next(
            (name for name in named if (beside / name).is_file() and not name.startswith("..")),
            None,
        )
        return (f"opens '{entry}'", entry) if entry else None
    return None


def _describe(error: Exception) -> str:
    """Return type and text of an exception; computing the text may fail."""
    name = type(error).__name__
    try:
        return f"{name}: {error!s:.300}"
    except Exception:
        return name


def _line_in(error: Exception, file: str) -> int | None:
    """Return the last line number of ``file`` in a traceback; None if it is not in it."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    return lines[-1] if lines else None
