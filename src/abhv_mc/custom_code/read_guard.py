"""Rules for the files that custom control laws and simulators may read.

The module imports only the standard library, because the process of a custom simulator loads the
module by its path.
"""

import contextlib
import functools
import importlib.util
import os
import re
import shutil
import stat
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

PROGRAMS = ("subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn", "os.system")
EVENTS = ("open", "import", "ctypes.dlopen", "sqlite3.connect")
SYSTEM = ("/bin", "/dev", "/etc", "/lib", "/lib32", "/lib64", "/libx32", "/opt", "/proc", "/run",
          "/sbin", "/sys", "/usr", "/var")  # fmt: skip
_CLOCK_STEP = 0.01  # possible lag of a file system's clock, s
_SEPARATORS = re.compile(r"[\s=<>|;&\"'`(),]+")


class ReadGuard:
    """Guard that lets a process read only declared files and certain other files.

    The other files are those of packages, of the system and of the process itself.
    """

    def __init__(
        self,
        declared: Iterable[str],
        *,
        studies: Iterable[str],
        packages: Iterable[str],
        system: Iterable[str] = SYSTEM,
        own: str = "",
        started: float = float("inf"),
    ) -> None:
        """Initialize the guard.

        ``studies`` are folders of the user's files, in which only ``declared`` files and
        ``packages`` may be read. All files in ``own``, the folder of the process, may be read.
        Files created after ``started`` (s since the epoch) are treated as files of the process.
        """
        self.declared = {os.path.realpath(path) for path in declared}
        self.studies = tuple(map(_as_folder, studies))
        self.packages = {_as_folder(path) for path in packages}
        self.system = tuple(map(_as_folder, system))
        self.home = _as_folder(os.path.expanduser("~"))  # noqa: PTH111  Path raises an error without a home
        own = _as_folder(own) if own else ""
        shared = any(study.startswith(own) for study in self.studies)
        self.own = "" if shared else own
        self.started = started - _CLOCK_STEP
        self.written: set[str] = set()

    def allows(self, real: str) -> bool:
        """Return whether the file at a real path may be read."""
        if real.endswith(".pyc"):
            prefix = sys.pycache_prefix or ""
            # The function raises ValueError if the file was not compiled from a source file.
            with contextlib.suppress(ValueError):
                real = importlib.util.source_from_cache(
                    real.replace(os.path.realpath(prefix), prefix, 1) if prefix else real
                )
        if real in self.declared or real in self.written:
            return True
        if (self.own and real.startswith(self.own)) or _created(real) >= self.started:
            return True
        studies = [study for study in self.studies if real.startswith(study)]
        return any(
            real.startswith(folder)
            and all(folder.startswith(study) and folder != study for study in studies)
            for folder in self.packages
        ) or (not studies and real.startswith(self.system))

    def find_reads(self, event: str, arguments: Sequence[Any]) -> Iterator[str]:
        """Yield the paths read in an audit event (PEP 578), and record created files."""
        if event not in EVENTS:
            return
        name = arguments[1] if event == "import" else arguments[0]
        if isinstance(name, int) or not isinstance(name, str | bytes | os.PathLike):
            return  # The argument is a file descriptor, or does not name a file.
        path = os.fsdecode(name)
        if event == "sqlite3.connect":
            path = path.removeprefix("file:").partition("?")[0]
        elif event == "open":
            flags = arguments[2] or 0
            creates = flags & os.O_CREAT and (flags & os.O_EXCL or not os.path.lexists(path))
            if creates or flags & os.O_TRUNC:
                self.written.add(os.path.realpath(path))
                return
            if flags & (os.O_WRONLY | os.O_RDWR) == os.O_WRONLY:
                return
        yield path

    def find_programs(self, event: str, arguments: Sequence[Any]) -> Iterator[str]:
        """Yield the program and the file arguments of an event that starts a program."""
        if event not in PROGRAMS:
            return
        first = 1 if event == "os.spawn" else 0
        folder = arguments[2] if event == "subprocess.Popen" else None
        arguments_of_program = (
            [arguments[first]] if event != "os.system" else ["sh", "-c", arguments[first]]
        )
        if event != "os.system":
            further = arguments[first + 1]
            arguments_of_program += (
                [further] if isinstance(further, str | bytes | os.PathLike) else list(further or ())
            )
        texts = [
            os.fsdecode(word)
            for word in arguments_of_program
            if isinstance(word, str | bytes | os.PathLike)
        ]
        programs = {0, 1, *(i + 1 for i, text in enumerate(texts) if text == "-c")}
        for i, text in enumerate(texts):
            pieces = [text, *filter(None, _SEPARATORS.split(text))]
            for k, piece in enumerate(map(_expand, pieces)):
                path = os.path.join(os.fsdecode(folder or "."), piece)  # noqa: PTH118
                if i in programs and k <= 1 and os.sep not in piece:
                    path = shutil.which(piece) or path
                is_program = i in programs and k <= 1
                if not is_program or os.path.realpath(path).startswith((*self.studies, self.home)):
                    yield path


def package_folders() -> set[str]:
    """Return the folders of the interpreter and of the packages in ``sys.path``."""
    folders = {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, sys.exec_prefix}
    return folders | {entry for entry in sys.path if entry and any(Path(entry).glob("*.dist-info"))}


def cache_folders() -> set[str]:
    """Return the user's cache and configuration folders."""
    names = (
        "NUMBA_CACHE_DIR",
        "MPLCONFIGDIR",
        "XDG_CACHE_HOME",
        "XDG_CONFIG_HOME",
        "XDG_DATA_HOME",
    )
    folders = {os.environ[name] for name in names if os.environ.get(name)}
    home = os.path.expanduser("~")  # noqa: PTH111
    return folders | {f"{home}/{name}" for name in (".cache", ".config", ".local/share")}


def simulator_guard(
    declared: Iterable[str], folder: str, campaign: str, own: str, started: float
) -> ReadGuard:
    """Return the guard for a custom simulator in ``folder`` with ``declared`` files.

    ``campaign`` is the folder of the campaign file.
    """
    ours = set(map(str, Path(__file__).parents[2].glob("abhv_mc*")))
    return ReadGuard(
        (os.path.join(folder, name) for name in declared),  # noqa: PTH118
        studies=(folder, campaign),
        packages=package_folders() | cache_folders() | ours,
        own=own,
        started=started,
    )


def watch_reads(guard: ReadGuard, folder: str) -> None:
    """Install an audit hook that raises PermissionError for reads that ``guard`` forbids."""

    def check(event: str, arguments: tuple[Any, ...]) -> None:
        if event not in EVENTS and event not in PROGRAMS:
            return
        for path in (*guard.find_reads(event, arguments), *guard.find_programs(event, arguments)):
            if event == "ctypes.dlopen" and os.sep not in path:
                continue  # The loader searches system folders for a library without a path.
            real = os.path.realpath(path)
            if is_regular(real) and not guard.allows(real):
                guard.packages |= set(
                    map(_as_folder, package_folders())
                )  # sys.path may have been extended.
                if not guard.allows(real):
                    raise PermissionError(undeclared_words(real, folder))

    sys.addaudithook(check)


def undeclared_words(real: str, folder: str) -> str:
    """Return a message about an undeclared file, named relative to ``folder``."""
    simulator_folder = Path(os.path.realpath(folder))
    if Path(real).is_relative_to(simulator_folder):
        return f"it reads {Path(real).relative_to(simulator_folder)}, which 'files' does not list"
    remedy = "copy the file into the simulator's folder and list the copy"
    if Path(real).is_relative_to(simulator_folder.parent):
        remedy = "'folder: ..' allows 'files' to list files of the parent folder"
    return f"it reads {real}, which 'files' does not list ({remedy})"


def is_regular(path: str) -> bool:
    """Return whether a path leads to a regular file."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)  # noqa: PTH116
    except (OSError, ValueError):
        return False


def _created(path: str) -> float:
    """Return the time of a file's last status change, s since the epoch, or -inf."""
    try:
        return os.stat(path).st_ctime  # noqa: PTH116
    except (OSError, ValueError):
        return -float("inf")


def _expand(word: str) -> str:
    """Return a word with ``~`` and variables expanded as in a shell."""
    return os.path.expandvars(os.path.expanduser(word))  # noqa: PTH111


@functools.cache  # A law in plain Python is guarded at each tick.
def _as_folder(path: str | Path) -> str:
    return os.path.join(os.path.realpath(path), "")  # noqa: PTH118
