"""The command line's frame: which commands there are, and how an error leaves.

A command is a function, or a ``typer.Typer`` where it has commands of its own; commands of one kind share a file.
Python takes all of the core's in at every start: what is heavy is imported inside a command's function. Those that
packages add (:mod:`abhv_mc.cli.added_commands`) stand in the panels by name.
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
from abhv_mc.cli.added_commands import Commands
from abhv_mc.cli.errors import exit_code_of, open_streams, settle_output
from abhv_mc.cli.printing import say
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.io.address import hide_key
from abhv_mc.shipped import PACKAGES

_SHORT = {"bool": "", "int": "N", "float": "X", "str": "TEXT"}


class _Short:
    """Help with short names of types, and none beside a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, an option's type by ``_SHORT``."""
        base: Any = super()
        parameters: list[Any] = base.get_params(ctx)
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


_PANELS: dict[str, tuple[Any, ...]] = {  # by name: added by a package
    "First day": (
        *(starting.new, starting.validate, running.run),
        *(reporting.report, reporting.compare, reporting.runs),
    ),
    "Run": (starting.imports, running.merge, flying.fly, replaying.replay),
    "Search": (searching.worst, searching.rare, "tune"),
    "Look": (
        *(reporting.show, "explore", replaying.explain, reporting.whatif),
        *(reporting.place, querying.query, querying.lists),
    ),
    "Analyse": (flying.trim, linearizing.margins, linearizing.linearize),
    "Prove": (proving.verify,),
}
_HIDDEN: dict[str, Any] = {  # other names of commands, for scripts; --help does not list them
    "adopt": running.flights,
    "samples": starting.samples,
    "status": reporting.runs,
}
_OTHERS = "Extensions"  # the panel of other packages' commands
_PROGRAM = "abhv-mc"


def _name(command: Any) -> str:
    if isinstance(command, str):
        return command
    return str(command.info.name if isinstance(command, typer.Typer) else command.__name__)


_PANEL_OF = {_name(command): panel for panel, commands in _PANELS.items() for command in commands}


class Group(_Short, TyperGroup):
    """A group of commands, those that packages add to it among them."""

    def __init__(self, *, name: str | None = None, commands: Any = None, **options: Any) -> None:
        first = name == _PROGRAM
        added: Any = Commands(
            own=commands or {},
            family="" if first else f"{name}.",
            order=_PANEL_OF if first else (),
            make=lambda name, command: _make_command(
                name, command, _PANEL_OF.get(name, _OTHERS) if first else None
            ),
        )
        super().__init__(name=name, commands=added, **options)

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in their order; of some of them there may turn out to be no command."""
        return list(self.commands)


def _add_command(
    parent: typer.Typer, name: str, command: Any, panel: str | None, hidden: bool = False
) -> None:
    if isinstance(command, typer.Typer):
        for inner in command.registered_commands:
            inner.cls = Command
        parent.add_typer(command, name=name, cls=Group, rich_help_panel=panel)
    else:
        parent.command(name, cls=Command, rich_help_panel=panel, hidden=hidden)(command)


def _make_command(name: str, command: Any, panel: str | None) -> Any:
    """What a package's function is on the command line."""
    parent = typer.Typer(cls=TyperGroup)
    _add_command(parent, name, command, panel)
    return typer.main.get_group(parent).commands[name]


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
    name=_PROGRAM,
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
        from importlib.util import find_spec

        say(f"abhv-mc {__version__}")
        say(f"python {platform.python_version()} on {platform.platform()}")
        for library in _LIBRARIES:
            say(f"{library} {version(library)}")
        from abhv_mc.kernel.compiler_target import choose_interface, find_level

        say(f"kernels {find_level(choose_interface())[1]}")
        for package in PACKAGES:
            if find_spec(package) is None:
                say(f"{package} is missing, and its commands with it")
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
        if not isinstance(_command, str):
            _add_command(app, _name(_command), _command, _panel)
for _short, _former in _HIDDEN.items():
    _add_command(app, _short, _former, None, hidden=True)


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
