"""What the command line says, and the code it exits with, when it does not end well."""

import contextlib
import io
import os
import sys
import traceback
from enum import IntEnum
from pathlib import Path

from abhv_mc.cli.printing import say
from abhv_mc.folder.layout import StorageFullError, explain_os_error
from abhv_mc.io.input_error import InputError, Refusal, is_exhausted


class ExitCode(IntEnum):
    """The program's exit codes; scripts rely on them."""

    DONE = 0
    FAILED = 1  # done, but a requirement or a verification failed
    BAD_INPUT = 2
    INCOMPLETE = 3  # interrupted or incomplete; what was flown is kept
    DEFECT = 70  # not 1, which Python would give: that says "a requirement failed"


_TYPER_INTERRUPTED = 130


def exit_code_of(error: BaseException) -> int | str | None:
    """Tell standard error what ended the program, and give the code to exit with."""
    if isinstance(error, SystemExit) and isinstance(error.__context__, BrokenPipeError):
        return (
            ExitCode.INCOMPLETE
        )  # whoever read the output has ended; typer would exit as a failed requirement does
    if isinstance(error, SystemExit) and error.code != _TYPER_INTERRUPTED:
        return error.code
    if isinstance(error, OSError):
        error = _explain(error)
    code, words = ExitCode.INCOMPLETE, str(error)
    if (
        isinstance(error, (SystemExit, KeyboardInterrupt)) or words == "Query interrupted"
    ):  # the last is DuckDB's
        eval("0")  # noqa: S307  # after an interrupt inside of exec Python would die by its signal: this makes it forget
        words = (
            "interrupted: what a campaign or search has flown is kept, and the same command goes on"
        )
    elif isinstance(error, MemoryError):
        words = (
            "not enough memory: what was flown is kept; fewer workers or smaller blocks need less"
        )
    elif is_exhausted(error):
        words = f"{words}: what was flown is kept; fewer workers, or more open files or processes (ulimit -n, -u)"
    elif (
        type(error).__module__.partition(".")[0] == "distributed"
    ):  # of many kinds, as a scheduler or its host dies
        reason = words.partition("\n")[0] or type(error).__name__
        words = f"the cluster does not answer ({reason}): what was flown is kept"
    elif isinstance(error, (InputError, Refusal)):
        code = ExitCode.BAD_INPUT
    elif type(error).__name__ == "UnusableError":  # not imported: its module takes a second to load
        pass
    elif not isinstance(error, StorageFullError):
        with contextlib.suppress(OSError):
            traceback.print_exception(error)
        code, words = (
            ExitCode.DEFECT,
            "This is a defect of abhv-mc; please report it with the lines above.",
        )
    _tell(words)
    return code


def open_streams() -> None:
    """Open the null device for standard streams that the caller closed: a file would take their numbers.

    What a terminal's encoding does not have is printed as an escape.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number: this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def settle_output(code: int | str | None) -> int | str | None:
    """Write out what was printed; the code to exit with where that fails: Python's own would be that of a defect."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            os.dup2(
                os.open(os.devnull, os.O_WRONLY), stream.fileno()
            )  # so that Python does not try again
            if not isinstance(error, BrokenPipeError):
                _tell(_explain(error))
            code = code or ExitCode.INCOMPLETE
    return code


def _tell(words: object) -> None:
    """Say it on standard error; where that takes nothing, the exit code says enough."""
    with contextlib.suppress(OSError):
        say(words, file=sys.stderr)


def _explain(error: OSError) -> Exception:
    """A full disk or a closed folder as what it is, wherever it was met; other errors as they are."""
    try:
        with explain_os_error(Path(error.filename or "the disk or standard output")):
            raise error
    except Exception as explained:
        return explained
