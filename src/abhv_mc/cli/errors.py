"""What the command line says, and the code it exits with, when it does not end well."""

import sys
import traceback
from enum import IntEnum

from abhv_mc.input_error import InputError, Refusal


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
    if isinstance(error, SystemExit):
        return ExitCode.INCOMPLETE if error.code == _TYPER_INTERRUPTED else error.code
    if isinstance(error, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
        return ExitCode.INCOMPLETE
    if isinstance(error, (InputError, Refusal)):
        print(error, file=sys.stderr)
        return ExitCode.BAD_INPUT
    traceback.print_exception(error)
    print("This is a defect of abhv-mc; please report it with the lines above.", file=sys.stderr)
    return ExitCode.DEFECT
