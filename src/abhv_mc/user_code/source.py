"""A Python file of the user's as text: run once as a module, and what it defines."""

import contextlib
import functools
import hashlib
import inspect
import linecache
import math
import os
import re
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.io.input_files import read_input
from abhv_mc.user_code.unpack import in_its_folder, unpack

MODULE = "abhv_mc_own_"  # how the modules that are made of such files are called
MAX_BYTES = 2_000_000  # of a file
CONTROLLER, CHANNEL = "_abhv_mc_controller", "_abhv_mc_channel"  # attributes that the decorators set


@dataclass(frozen=True)
class UserSource:
    """The text of a user's file, and the files that it declares. It travels with the work; no stored plan holds it."""

    text: str
    file: str  # what its user calls it
    files: tuple[tuple[str, bytes], ...] = ()  # name from the folder that holds them all, content; itself among them
    library: bytes = b""  # of a law in C, built from all this

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of the text, and of the names and contents of what it declares: what trust goes by."""
        digest = hashlib.sha256(self.text.encode())
        for name, content in sorted(self.files):
            digest.update(f"\0{name}\0{hashlib.sha256(content).hexdigest()}".encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class ControllerMark:
    """What the decorator ``controller`` says."""

    units: dict[str, str] = field(default_factory=dict)  # of settings
    compiled: bool = True


@dataclass(frozen=True)
class ChannelMark:
    """What the decorator ``channel`` says."""

    unit: str
    name: str
    doc: str


@dataclass(frozen=True)
class Module:
    """A user's file that was run."""

    source: UserSource
    names: dict[str, Any]  # its globals

    def marked(self, mark: str) -> dict[str, Callable[..., Any]]:
        """The functions with a decorator of ours, by name."""
        functions = {name: value for name, value in self.names.items() if type(value) is types.FunctionType}
        return {name: function for name, function in functions.items() if mark in function.__dict__}


def read_source(path: Path, files: Mapping[str, Path] | None = None) -> UserSource:
    """Read a user's file as it is, without running it, and the ``files`` that it declares. Raises InputError."""
    try:
        content = read_input(path)
        if len(content) > MAX_BYTES:
            raise InputError(path, f"more than {MAX_BYTES} bytes", "a Python file")
        declared = tuple((name, read_input(place)) for name, place in (files or {}).items())
        return UserSource(content.decode(), str(path), declared if len(declared) > 1 else ())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"a file that cannot be read ({error})", "a Python file") from None


@functools.lru_cache(maxsize=64)
def run_module(source: UserSource) -> Module:
    """Run a user's file. Raises InputError, with the line, for whatever it raises."""
    linecache.cache[source.file] = (len(source.text), None, source.text.splitlines(keepends=True), source.file)
    module = types.ModuleType(f"{MODULE}{source.hash[:16]}")
    module.__file__ = str(unpack(source) / source.files[0][0]) if source.files else source.file
    code = compile_text(source)
    with refuse_in_words(source, "a file", "a file that runs on its own"), in_its_folder(source):
        exec(code, module.__dict__)  # the user's own file
    return Module(source, module.__dict__)


def compile_text(source: UserSource, flags: int = 0) -> Any:
    """What Python's ``compile`` makes of the text, without running it. Raises InputError."""
    try:
        return compile(source.text, source.file, "exec", flags, dont_inherit=True)
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:  # the last three: zero bytes, deep nesting
        at = (error.lineno, error.offset) if isinstance(error, SyntaxError) else (None, None)
        raise InputError(source.file, f"'{getattr(error, 'msg', error)}'", "Python", *at) from None


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
            raise InputError(source.file, found, f"files: [{missed[1]}] in its controller file", line) from None
        if line is None and isinstance(error, OSError | MemoryError):
            raise
        raise InputError(source.file, f"{what} that raises {_describe(error)}", expected, line) from None


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
        entry = next((name for name in named if (beside / name).is_file() and not name.startswith("..")), None)
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
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return lines[-1] if lines else None


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


@functools.lru_cache(maxsize=64)
def load_law(source: UserSource) -> Law:
    """Run a controller's file and find what it defines; checked in the user's terms. Raises InputError."""
    from abhv_mc.user_code.check import check_law

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
