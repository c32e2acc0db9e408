"""The command line's frame: which commands there are, and how an error leaves.

A command is a function, or a ``typer.Typer`` where it has commands of its own; commands of one kind share a file.
Python takes all of them in at every start: what is heavy is imported inside a command's function.
"""

import gc
import os
import sys
from inspect import cleandoc
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from abhv_mc import __version__
from abhv_mc.cli import (
    flying,
    linearizing,
    proving,
    querying,
    replaying,
    reporting,
    running,
    searching,
    starting,
)
from abhv_mc.cli.errors import exit_code_of, open_streams, settle_output
from abhv_mc.cli.printing import say
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.io.address import hide_key

_SHORT = {"bool": "", "int": "N", "float": "X", "str": "TEXT"}


class _Short:
    """Help with short names of types, and none beside a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, an option's type by ``_SHORT``."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for each in parameters:
            if (
                each.param_type_name == "option"
                and each.metavar is None
                and not each.type_descriptor.is_choice
            ):
                each.metavar = _SHORT.get(each.bare_type())
                each._get_number_range_help_str = lambda: (
                    None
                )  # beside it an option's own name was cut
        return parameters


class Command(_Short, TyperCommand):
    """A command, its help in paragraphs without line ends inside."""

    def __init__(self, *args: Any, **options: Any) -> None:
        parts = cleandoc(options.get("help") or "").split("\n\n")
        flowed = "\n\n".join(" ".join(part.split()) for part in parts)
        super().__init__(
            *args, **options | {"help": flowed.replace("[", r"\[")}
        )  # no markup: units stand in brackets


class Group(_Short, TyperGroup):
    """A group of commands."""


_PANELS: dict[str, tuple[Any, ...]] = {
    "Start": (starting.new, starting.imports, starting.validate, starting.plan, querying.lists),
    "Fly": (running.run, running.adopt, running.merge, flying.fly, replaying.replay),
    "Search": (searching.worst, searching.rare, searching.tune),
    "Look": (
        *(
            reporting.report,
            reporting.show,
            replaying.explore,
            reporting.compare,
            replaying.explain,
        ),
        *(reporting.whatif, reporting.status, querying.query, querying.export, flying.trim),
    ),
    "Analyse": (linearizing.margins, linearizing.linearize),
    "Prove": (proving.verify, proving.bench),
}
_LIBRARIES = (
    "numba",
    "llvmlite",
    "numpy",
    "scipy",
    "pandas",
    "pyarrow",
    "joblib",
    "pydantic",
    "duckdb",
)

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
        False,
        "--version",
        callback=_print_versions,
        is_eager=True,
        help="Print the versions and exit.",
    ),
) -> None:
    pass


for _panel, _commands in _PANELS.items():
    for _command in _commands:
        if isinstance(_command, typer.Typer):
            for _inner in _command.registered_commands:
                _inner.cls = Command
            app.add_typer(_command, name=_command.info.name, cls=Group, rich_help_panel=_panel)
        else:
            app.command(_command.__name__, cls=Command, rich_help_panel=_panel)(_command)


def main() -> None:
    """Run the command line and exit with its code."""
    # Before numpy is loaded, here and in the processes started from here: further threads spin on matrices of 9 x 9.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(
        100_000, 10, 10
    )  # libraries being loaded are no garbage: a tenth of a cached start
    sys.argv[1:] = map(hide_key, sys.argv[1:])
    open_streams()
    with sigterm_as_interrupt():
        try:
            app(prog_name="abhv-mc")  # so that completion knows it, however it was started
        except (
            BaseException
        ) as error:  # every way out passes here, so that each has the promised code
            code = settle_output(exit_code_of(error))
            if (
                "duckdb" not in sys.modules
            ):  # it takes what is left at the end for a leak, and says so
                gc.freeze()  # what goes with the process is not searched for garbage again: a fifth of a start
            sys.exit(code)
