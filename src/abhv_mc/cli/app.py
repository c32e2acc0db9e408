"""The command line's frame: which commands there are, and how an error leaves.

A command lives in ``cli/<command>.py`` as a function ``command`` (or, with commands of its own, a ``typer.Typer``
called ``app``) and is named here. Python takes ``cli/<command>.py`` in at every start: it imports what is heavy
inside its function.
"""

import gc
import os
import sys
from importlib import import_module
from inspect import cleandoc
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from abhv_mc import __version__
from abhv_mc.cli.errors import exit_code_of, settle_output
from abhv_mc.cli.printing import say
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.io.address import hide_key

_SHORT = {"bool": "", "int": "N", "float": "X", "str": "TEXT"}


def _shorten(parameters: list[Any]) -> list[Any]:
    for each in parameters:
        if each.param_type_name == "option" and each.metavar is None and not each.type_descriptor.is_choice:
            each.metavar = _SHORT.get(each.bare_type())
            each._get_number_range_help_str = lambda: None  # beside it an option's own name was cut
    return parameters


def _flow(text: str | None) -> str | None:
    """Paragraphs without line ends inside."""
    return text and "\n\n".join(" ".join(part.split()) for part in cleandoc(text).split("\n\n"))


class Command(TyperCommand):
    """A command with such help."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{**options, "help": _flow(options.get("help"))})

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, flags without a type."""
        return _shorten(super().get_params(ctx))


class Group(TyperGroup):
    """A group of commands with such help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, flags without a type."""
        return _shorten(super().get_params(ctx))


_COMMANDS = {
    "Start": ("new", "import", "validate", "plan", "list"),
    "Fly": ("run", "adopt", "merge", "fly", "replay"),
    "Search": ("worst", "rare", "tune"),
    "Look": ("report", "show", "explore", "compare", "explain", "whatif", "status", "query", "export", "trim"),
    "Analyse": ("margins", "linearize"),
    "Prove": ("verify", "bench"),
}
_LIBRARIES = ("numba", "llvmlite", "numpy", "scipy", "pandas", "pyarrow", "joblib", "pydantic", "duckdb")

_MODULES = {"import": "importing"}  # where a command's name is a word of Python's

app = typer.Typer(
    name="abhv-mc",
    cls=Group,
    help="Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.",
    epilog="Exit codes: 0 done; 1 done, but a requirement or a verification failed; 2 bad input; "
    "3 interrupted or incomplete, and the same command resumes.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_versions(expected: bool) -> None:
    """The program's version, and what a problem report needs beside it."""
    if expected:
        import platform
        from importlib.metadata import version

        say(f"abhv-mc {__version__}")
        say(f"python {platform.python_version()} on {platform.platform()}")
        for library in _LIBRARIES:
            say(f"{library} {version(library)}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_print_versions, is_eager=True, help="Print the versions and exit."
    ),
) -> None:
    pass


for _panel, _names in _COMMANDS.items():
    for _name in _names:
        _module = import_module(f"abhv_mc.cli.{_MODULES.get(_name, _name)}")
        if hasattr(_module, "app"):
            for _inner in _module.app.registered_commands:
                _inner.cls = Command
            app.add_typer(_module.app, name=_name, cls=Group, rich_help_panel=_panel)
        else:
            app.command(_name, cls=Command, rich_help_panel=_panel)(_module.command)


def main() -> None:
    """Run the command line and exit with its code."""
    # Before numpy is loaded, here and in the processes started from here: further threads spin on matrices of 9 x 9.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(100_000, 10, 10)  # libraries being loaded are no garbage: a tenth of a cached start
    sys.argv[1:] = map(hide_key, sys.argv[1:])
    with sigterm_as_interrupt():
        try:
            app(prog_name="abhv-mc")  # so that completion knows it, however it was started
        except BaseException as error:  # every way out passes here, so that each has the promised code
            code = settle_output(exit_code_of(error))
            if "duckdb" not in sys.modules:  # it takes what is left at the end for a leak, and says so
                gc.freeze()  # what goes with the process is not searched for garbage again: a fifth of a start
            sys.exit(code)
