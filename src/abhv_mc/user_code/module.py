"""A user's Python file run once as a module, and what it defines; before that once in a child, under a watch."""

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
    """What the decorator ``controller`` says."""

    units: dict[str, str] = field(default_factory=dict)  # of settings
    compiled: bool = True
    dispersable: tuple[str, ...] = ()  # settings that a campaign may vary from flight to flight
    filters: bool = False  # a measurement, before a law of the program; it is no law itself


@dataclass(frozen=True)
class ChannelMark:
    """What the decorator ``channel`` says."""

    unit: str
    name: str
    doc: str


def texts_of(tree: ast.Module) -> dict[str, Any]:
    """The functions and classes of a file by name, as they are written."""
    return {
        node.name: node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }


def arguments_of(function: ast.FunctionDef) -> list[ast.arg]:
    """All that a function can be given by name or place."""
    return [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]


@dataclass(frozen=True)
class Module:
    """A user's file that was run."""

    source: UserSource
    names: dict[str, Any]  # its globals

    def marked(self, mark: str) -> dict[str, Callable[..., Any]]:
        """The functions with a decorator of ours, by name."""
        functions = {
            name: value for name, value in self.names.items() if type(value) is types.FunctionType
        }
        return {name: function for name, function in functions.items() if mark in function.__dict__}

    @functools.cached_property
    def texts(self) -> dict[str, Any]:
        """Its functions and classes as they are written."""
        return texts_of(ast.parse(self.source.text))

    def check_arguments(self, function: str, known: Iterable[str]) -> tuple[str, ...]:
        """The arguments of a function. Raises InputError, at its place, for one that it cannot be given."""
        if not isinstance(self.texts.get(function), ast.FunctionDef):
            found = f"a decorator on '{function}', which is no function of the file"
            raise InputError(self.source.file, found, "one above 'def' at the left margin")
        given = arguments_of(self.texts[function])
        for argument in given:
            if argument.arg not in known:
                place = argument.lineno, argument.col_offset + 1
                found = f"the argument '{argument.arg}'"
                raise InputError(self.source.file, found, one_of(known, argument.arg), *place)
        return tuple(argument.arg for argument in given)


@dataclass(frozen=True)
class Law:
    """The controller of a file: the function, what it names and what it is made of."""

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
    """Run a Python file in the child, once for each content. Raises InputError for what it does or reads wrong."""
    key = hashlib.sha256(f"{source.hash} {source.file} {code_hash()}".encode()).hexdigest()[:24]
    note = laws_folder() / f"closed_{key}"
    if note.exists():
        return
    try:
        in_child(_run_watched, source, limit=_LONGEST)
    except LostError as lost:
        found = f"a file that does not run: {lost.words}"
        raise InputError(source.file, found, "a file that runs on its own") from None
    note.touch()


def _run_watched(source: UserSource) -> None:
    run_module.cache_clear()  # a module that ran already opens nothing
    with watching(source):
        run_module(source)


@functools.cache
def code_hash() -> str:
    """Hash of what a user's code is made of besides its text and the layers of the compiled flight."""
    here = Path(__file__).parent
    files = [*sorted(here.glob("*.py")), *sorted(here.glob("*.h")), here.parent / "extend.py"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.lru_cache(maxsize=64)
def run_module(source: UserSource) -> Module:
    """Run a user's file. Raises InputError, with the line, for whatever it raises."""
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
    """Make an InputError, with the line, of whatever a user's code raises where it is run or looked at.

    A full disk or memory, met elsewhere than in his code, is none of that.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        line = _line_in(error, source.file)
        if (missed := _undeclared(source, error)) is not None:
            found = f"{what} that {missed[0]}, which it does not declare"
            raise InputError(
                source.file, found, f"files: [{missed[1]}] in its controller file", line
            ) from None
        if line is None and isinstance(error, OSError | MemoryError):
            raise
        raise InputError(
            source.file, f"{what} that raises {_describe(error)}", expected, line
        ) from None


def _undeclared(source: UserSource, error: Exception) -> tuple[str, str] | None:
    """What a missing file or module that lies beside the law is to it in words, and the entry of ``files`` for it."""
    beside = Path(source.file).parent
    if isinstance(error, ModuleNotFoundError):
        top = str(error.name).partition(".")[0]
        entry = next((name for name in (f"{top}.py", f"{top}/") if (beside / name).exists()), None)
        return (f"imports '{error.name}'", entry) if entry else None
    if isinstance(error, FileNotFoundError):  # numpy's says the name in words alone
        words = [str(error.filename), *re.findall(r"[\w./-]+\w", _describe(error))]
        named = (os.path.relpath(beside / word, beside) for word in words)
        entry = next(
            (name for name in named if (beside / name).is_file() and not name.startswith("..")),
            None,
        )
        return (f"opens '{entry}'", entry) if entry else None
    return None


def _describe(error: Exception) -> str:
    """What it is and says, as far as it can say it: its words are the user's code, too."""
    name = type(error).__name__
    try:
        return f"{name}: {error!s:.300}"
    except Exception:
        return name


def _line_in(error: Exception, file: str) -> int | None:
    """The last line of ``file`` in a traceback."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    return lines[-1] if lines else None
