"""Text and declared files of custom code, read before any code runs, and trust in the code.

Trust is based on a list of the hashes of code that the user has run. The list is needed because a
results folder may contain code of unknown origin.
"""

import ast
import functools
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from abhv_mc.io.input_files import read_input
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import PACKAGES


@dataclass(frozen=True)
class UserSource:
    """Text and declared files of custom code, sent to workers but not stored in plans."""

    text: str
    file: str  # path as specified by the user
    files: tuple[
        tuple[str, bytes], ...
    ] = ()  # (path relative to the common folder, content) of each file
    library: bytes = b""  # built library of a law in C

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of the text and the declared files, which identifies trusted code."""
        digest = hashlib.sha256(self.text.encode())
        for name, content in sorted(self.files):
            digest.update(f"\0{name}\0{hashlib.sha256(content).hexdigest()}".encode())
        return digest.hexdigest()

    @functools.cached_property
    def recipe(self) -> dict[str, Any] | None:
        """Build description of a law in C or an FMU; None for Python."""
        return json.loads(self.text) if self.text.startswith('{"law": ') else None


def read_source(path: Path, files: Mapping[str, Path] | None = None) -> UserSource:
    """Read a custom file and its declared ``files``. Raise InputError if unreadable."""
    try:
        content = read_input(path)
        declared = tuple((name, read_input(location)) for name, location in (files or {}).items())
        return UserSource(content.decode(), str(path), declared if len(declared) > 1 else ())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"the file cannot be read ({error})", "a Python file") from None


def compile_text(source: UserSource, flags: int = 0) -> Any:
    """Compile the text without running it. Raise InputError for a syntax error."""
    try:
        return compile(source.text, source.file, "exec", flags, dont_inherit=True)
    except (
        SyntaxError,
        ValueError,
        MemoryError,
        RecursionError,
    ) as error:  # The last three exceptions are caused by zero bytes or deep nesting.
        location = (error.lineno, error.offset) if isinstance(error, SyntaxError) else (None, None)
        raise InputError(
            source.file,
            f"invalid Python code ({getattr(error, 'msg', error)})",
            "code that Python can parse",
            *location,
        ) from None


def find_package_versions(sources: Iterable[UserSource]) -> dict[str, str]:
    """Return the versions of the installed packages that custom code imports, by package.

    This function does not run the code.
    """
    imported = {name for source in sources for name in _imported(source)}
    expected = imported - sys.stdlib_module_names - set(PACKAGES)
    if not expected:
        return {}
    distributions = metadata.packages_distributions()
    return {
        package: metadata.version(package)
        for name in sorted(expected)
        for package in distributions.get(name, ())
    }


def _imported(source: UserSource) -> Iterator[str]:
    texts = [content for name, content in source.files if name.endswith(".py")]
    for text in texts or [source.text.encode()]:
        try:
            nodes = list(ast.walk(ast.parse(text)))
        except (SyntaxError, ValueError):  # The file may be a template that is never imported.
            continue
        for node in nodes:
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module.partition(".")[0]


_SIGNS = ("manifest.json", "campaign.yaml")  # files by which a results folder is recognized
_trusted_now: set[str] = set()  # hashes trusted explicitly in this process


def list_file() -> Path:
    """Return the path of the list of hashes. Raise OSError if there is no home folder."""
    try:
        base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    except RuntimeError as error:  # HOME is not set, and the system has no entry for the user.
        raise FileNotFoundError(str(error)) from None
    return Path(base, "abhv-mc", "flown_laws")


def is_trusted(source: UserSource) -> bool:
    """Return whether the user has run exactly this source before."""
    try:
        return source.hash in list_file().read_text(encoding="utf-8").split()
    except OSError:
        return False


def trust(source: UserSource) -> None:
    """Record that the user has run a source; if the list is not writable, only in memory."""
    if is_trusted(source):
        return
    try:
        file = list_file()
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.write(f"{source.hash}\n")
    except OSError:
        _trusted_now.add(source.hash)


def check_trusted(source: UserSource, trusted: bool = False) -> None:
    """Raise InputError for untrusted code unless the user trusts it explicitly."""
    if trusted:
        _trusted_now.add(source.hash)
    if source.hash not in _trusted_now and not is_trusted(source):
        raise InputError(
            source.file,
            "you have not run this custom code before, and it would run with your permissions",
            "the option --trust-code after an inspection of the code",
        )


def is_in_a_folder(file: Path) -> bool:
    """Return whether a file is in a results folder, directly or through a link."""
    parents = {
        parent for location in (file.absolute(), file.resolve()) for parent in location.parents
    }
    return any(all((parent / name).exists() for name in _SIGNS) for parent in parents)
