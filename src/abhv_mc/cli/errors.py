"""What the command line says, and the code it exits with, when it does not end well."""

import contextlib
import errno
import os
import sys
import traceback
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path

from abhv_mc.cli.interrupts import settle_interrupt
from abhv_mc.cli.printing import say
from abhv_mc.folder.layout import FolderLostError, StorageFullError, explain_os_error
from abhv_mc.io.input_error import InputError, Refusal


class ExitCode(IntEnum):
    """The program's exit codes; scripts rely on them."""

    DONE = 0
    FAILED = 1  # done, but a requirement or a verification failed
    BAD_INPUT = 2
    INCOMPLETE = 3  # interrupted or incomplete; what was flown is kept
    DEFECT = 70  # not 1, which Python would give: that says "a requirement failed"


_TYPER_INTERRUPTED = 130
_SETTINGS = (
    "JOBLIB_",
    "MPL",
    "NUMBA_",
    "NUMPY_",
    "NPY_",
    "PANDAS_",
    "SCIPY_",
    "SOURCE_DATE_EPOCH",
)  # that libraries read when loaded
_PROGRAM = Path(__file__).parents[1]
_NUMBA_FILE = ".numba_config.yaml"  # that numba reads in the working folder, where PyYAML is installed
_NO_MEMORY = (  # as Python and Arrow (no thread's stack), the loader of libraries, and the system say it
    "can't start new thread",
    "Failed to launch worker thread",
    "failed to map segment",
    "Cannot allocate memory",
)


def exit_code_of(error: BaseException) -> int | str | None:
    """Tell standard error what ended the program, and give the code to exit with."""
    if isinstance(error, SystemExit) and isinstance(error.__context__, BrokenPipeError):
        return ExitCode.INCOMPLETE  # whoever read the output has ended; typer would exit as a failed requirement does
    if isinstance(error, SystemExit) and error.code != _TYPER_INTERRUPTED:
        return error.code
    causes = list(_causes(error))
    cut_short = isinstance(error, ImportError) and any(isinstance(cause, KeyboardInterrupt) for cause in causes)
    if isinstance(error, (SystemExit, KeyboardInterrupt)) or cut_short:
        settle_interrupt()
        _tell("interrupted: what a campaign or search has flown is kept, and the same command goes on")
        return ExitCode.INCOMPLETE
    if isinstance(error, OSError):
        error = _explain(error)
    if any(isinstance(cause, OSError) and cause.errno in (errno.EMFILE, errno.ENFILE) for cause in causes):
        _tell("too many open files: what was flown is kept; a higher limit (ulimit -n) or fewer workers help")
        return ExitCode.INCOMPLETE
    if any(isinstance(cause, MemoryError) or any(words in str(cause) for words in _NO_MEMORY) for cause in causes):
        _tell("not enough memory: what was flown is kept; fewer workers or smaller blocks need less")
        return ExitCode.INCOMPLETE
    if type(error).__module__.partition(".")[0] == "distributed":  # of many kinds, as a scheduler or its host dies
        reason = str(error).partition("\n")[0] or type(error).__name__
        _tell(f"the cluster does not answer ({reason}): what was flown is kept")
        return ExitCode.INCOMPLETE
    if isinstance(error, (StorageFullError, FolderLostError)):
        _tell(error)
        return ExitCode.INCOMPLETE
    if isinstance(error, (InputError, Refusal)):
        _tell(error)
        return ExitCode.BAD_INPUT
    library = _library_being_loaded(error)
    files = [_NUMBA_FILE] if library == "numba" and Path(_NUMBA_FILE).exists() else []
    if (library and isinstance(error, ValueError)) or (files and not isinstance(error, ImportError)):
        set_ = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(_SETTINGS)]
        place = f"the environment ({', '.join(files + set_)})" if files + set_ else "the environment"
        said = " ".join(str(error).split())
        _tell(InputError(place, None, None, f"a setting that {library} does not take ({said})", "one that it takes"))
        return ExitCode.BAD_INPUT
    with contextlib.suppress(OSError):
        traceback.print_exception(error)
    _tell("This is a defect of abhv-mc; please report it with the lines above.")
    return ExitCode.DEFECT


def settle_output(code: int | str | None) -> int | str | None:
    """Write out what was printed; the code to exit with where that fails: Python's own would be that of a defect."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:  # closed before the start
                stream.flush()
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # so that Python does not try again
            if not isinstance(error, BrokenPipeError):
                _tell(_explain(error))
            code = code or ExitCode.INCOMPLETE
    return code


def _tell(words: object) -> None:
    """Say it on standard error; where that takes nothing, the exit code says enough."""
    with contextlib.suppress(OSError):
        say(words, file=sys.stderr)


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """What was raised, and what it came from."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)


def _library_being_loaded(error: BaseException) -> str:
    """The library whose own files raised it while it was being imported; empty for none."""
    library, loaded = "", False
    for frame, _ in traceback.walk_tb(error.__traceback__):
        name = str(frame.f_globals.get("__name__")).partition(".")[0]
        if name == __name__.partition(".")[0]:
            library, loaded = "", False
        else:
            library, loaded = library or name, loaded or frame.f_code.co_name == "<module>"
    return library if loaded else ""


def _working_folder_is_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _explain(error: OSError) -> Exception:
    """A full disk or a closed folder as what it is, wherever it was met; other errors as they are."""
    if isinstance(error, FileNotFoundError):  # what was never there is refused where it is asked for
        if error.filename is None and _working_folder_is_gone():
            return InputError(".", None, None, "a working folder that was deleted", "one that is there (cd)")
        gone = os.fsdecode(error.filename or str(error).partition("\n")[0])
        if not Path(gone).is_relative_to(_PROGRAM):
            words = "not there when it was needed: deleted or replaced meanwhile, or else a defect of abhv-mc"
            return FolderLostError(f"{gone}: {words}")
    try:
        with explain_os_error(Path(error.filename or "the disk or standard output")):
            raise error
    except Exception as explained:
        return explained
