"""Error messages and exit codes of the command line."""

import contextlib
import io
import os
import sys
import traceback
from enum import IntEnum
from pathlib import Path

from abhv_mc.cli.printing import say
from abhv_mc.entry_points import VEHICLE
from abhv_mc.folder.layout import StorageFullError, explain_os_error
from abhv_mc.io.messages import InputError, Refusal, is_exhausted


class ExitCode(IntEnum):
    """Exit codes of the command line."""

    DONE = 0
    FAILED = 1  # a requirement or a verification failed
    BAD_INPUT = 2
    INCOMPLETE = 3  # interrupted or incomplete run; completed flights are kept
    DEFECT = 70  # defect of abhv-mc; Python's default code 1 would mean a failed requirement


_TYPER_INTERRUPTED = 130


def exit_code_of(error: BaseException) -> int | str | None:
    """Print an error to standard error and return the exit code."""
    if isinstance(error, SystemExit) and isinstance(error.__context__, BrokenPipeError):
        # The process that reads the output has ended. In this case typer would exit with code 1.
        return ExitCode.INCOMPLETE
    if isinstance(error, SystemExit) and error.code != _TYPER_INTERRUPTED:
        return error.code
    if isinstance(error, OSError):
        error = _explain(error)
    code, message = ExitCode.INCOMPLETE, str(error)
    is_interrupt = isinstance(error, (SystemExit, KeyboardInterrupt))
    if is_interrupt or message == "Query interrupted":
        # An interrupted DuckDB statement raises an error with the message "Query interrupted".
        # After an interrupt in exec(), Python would terminate itself with SIGINT at its exit; a
        # call of eval() clears the flag that causes this behaviour.
        eval("0")  # noqa: S307
        message = "interrupted: completed flights are kept; run the same command to resume"
    elif isinstance(error, MemoryError):
        message = (
            "not enough memory: completed flights are kept; use fewer workers or smaller blocks"
        )
    elif is_exhausted(error):
        message = (
            f"{message}: completed flights are kept; use fewer workers, or allow more open files "
            "or processes (ulimit -n, -u)"
        )
    elif (
        type(error).__module__.partition(".")[0] == "distributed"
    ):  # The library distributed raises many types of exceptions.
        reason = message.partition("\n")[0] or type(error).__name__
        message = f"the cluster does not respond ({reason}): completed flights are kept"
    elif isinstance(error, (InputError, Refusal)) or (
        isinstance(error, ModuleNotFoundError) and error.name == VEHICLE
    ):
        code = ExitCode.BAD_INPUT
    elif type(error).__name__ == "UnusableError":
        # Compare the name of the class, because importing the class would take a second.
        pass
    elif not isinstance(error, StorageFullError):
        with contextlib.suppress(OSError):
            traceback.print_exception(error)
        code = ExitCode.DEFECT
        message = "This is a defect of abhv-mc; please report it with the lines above."
    _print_error(message)
    return code


def open_streams() -> None:
    """Replace closed standard streams with the null device.

    Otherwise the next opened file would get the descriptor of a standard stream. Characters that
    the terminal cannot encode are printed as escape sequences.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # os.open() returns the lowest free descriptor, which is that of the closed stream.
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def flush_output(code: int | str | None) -> int | str | None:
    """Flush the standard streams and return the exit code, or INCOMPLETE if flushing fails."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            # The null device prevents Python from flushing the stream again.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            if not isinstance(error, BrokenPipeError):
                _print_error(_explain(error))
            code = code or ExitCode.INCOMPLETE
    return code


def _print_error(message: object) -> None:
    """Print a message to standard error if possible."""
    with contextlib.suppress(OSError):
        say(message, file=sys.stderr)


def _explain(error: OSError) -> Exception:
    """Convert an OSError to StorageFullError (full disk) or InputError (no permission).

    Other errors are returned unchanged.
    """
    try:
        with explain_os_error(Path(error.filename or "the disk or standard output")):
            raise error
    except Exception as explained:
        return explained
