"""Command-line application: commands, their order in the help, and exit codes.

A command is a function, or a ``typer.Typer`` if it has subcommands; related commands share a file.
All command modules are imported at every start; modules that load slowly are therefore imported
inside functions. ``_PANELS`` lists built-in commands as functions, and commands that packages add
by name.

Packages register commands as entry points of the group ``abhv_mc.commands``. An entry point has the
name of its command, such as ``explore``. The name of a subcommand follows the name of the group and
a dot, as in ``list.metrics``. The entry point refers to a function with annotations for typer, or
to a ``typer.Typer``. A package is imported when one of its commands is run or listed. If the import
fails, a warning is printed and the commands of the package are omitted.
"""

import gc
import os
import sys
from importlib.metadata import EntryPoint
from inspect import cleandoc
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from abhv_mc.cli import querying, replaying, reporting, running, searching, starting
from abhv_mc.cli.errors import exit_code_of, flush_output, open_streams
from abhv_mc.cli.printing import announce_warnings, say
from abhv_mc.entry_points import COMMANDS, find_entry_points
from abhv_mc.execution.interrupts import sigterm_as_interrupt
from abhv_mc.io.address import hide_key
from abhv_mc.shipped import PACKAGES
from abhv_mc.version import __version__

_SHORT = {"bool": "", "int": "N", "float": "X", "str": "TEXT"}


class _Short:
    """Mixin for help texts that show short type names for options and none for flags."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the command's parameters; options get the short type names of ``_SHORT``."""
        base: Any = super()
        parameters: list[Any] = base.get_params(ctx)
        for parameter in parameters:
            if (
                parameter.param_type_name == "option"
                and parameter.metavar is None
                and not parameter.type_descriptor.is_choice
            ):
                parameter.metavar = _SHORT.get(parameter.bare_type())
                # A printed range would truncate the name of the option in the help.
                parameter._get_number_range_help_str = lambda: None
        return parameters


class Command(_Short, TyperCommand):
    """Command whose help text is wrapped paragraph by paragraph."""

    def __init__(self, *args: Any, **options: Any) -> None:
        paragraphs = cleandoc(options.get("help") or "").split("\n\n")
        text = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
        text = text.replace("[", r"\[")  # Escape units in brackets, which would be read as markup.
        super().__init__(*args, **options | {"help": text})


_EXAMPLES = {  # examples printed after the options
    "new": ("abhv-mc new study", "abhv-mc new study --from wide", "abhv-mc new study --law c"),
    "validate": (
        "abhv-mc validate study/campaign.yaml",
        "abhv-mc validate study/campaign.yaml --dry-run",
        "abhv-mc validate study/campaign.yaml --samples inputs.csv",
    ),
    "run": (
        "abhv-mc run study/campaign.yaml -o reports/first",
        "abhv-mc run failures --runs 500 --seed 7 --workers 4",
        "abhv-mc run study/campaign.yaml -o reports/changed --baseline reports/first",
    ),
    "report": (
        "abhv-mc report reports/first",
        "abhv-mc report reports/first --brief",
        "abhv-mc report reports/first --requirements stricter.csv -o reports/stricter",
    ),
    "compare": (
        "abhv-mc compare reports/first reports/changed",
        "abhv-mc compare reports/first reports/changed --fail-if-worse altitude_error_max_m=5%",
        "abhv-mc compare flights.csv study/campaign.yaml --measured altitude_m=5",
    ),
    "runs": ("abhv-mc runs", "abhv-mc runs reports/first", "abhv-mc runs --json -"),
}
_PANELS = {  # Names stand for commands that packages add.
    "First day": (
        *("new", starting.validate, running.run),
        *(reporting.report, reporting.compare, reporting.runs),
    ),
    "Run": (starting.imports, running.merge, "fly", replaying.replay),
    "Search": (searching.worst, searching.rare, searching.tighten, "tune"),
    "Results": (
        *(reporting.show, "explore", replaying.explain),
        *(searching.identify, querying.query, querying.lists),
    ),
    "Analyse": ("trim", "margins", "linearize"),
    "Verify": (replaying.verify,),
}
_EXTENSIONS = "Extensions"  # heading for commands that packages add
_PROGRAM = "abhv-mc"


def _name(command: Any) -> str:
    if isinstance(command, str):
        return command
    return str(command.info.name if isinstance(command, typer.Typer) else command.__name__)


_PANEL_OF = {_name(command): panel for panel, commands in _PANELS.items() for command in commands}


class Group(_Short, TyperGroup):
    """Group of commands, including those that packages add.

    ``commands`` also contains the entry points of commands that are not imported yet.
    """

    _unusable: ClassVar[set[str]] = set()  # packages that cannot be imported

    def _find_added(self) -> None:
        family = "" if self.name == _PROGRAM else f"{self.name}."
        added = {
            name.removeprefix(family): entry
            for name, entry in find_entry_points(COMMANDS).items()
            if name.startswith(family)
        }
        commands: Any = self.commands
        for name, entry in added.items():
            if "." not in name:
                commands.setdefault(name, entry)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the command names in the order of the help."""
        self._find_added()
        order = list(_PANEL_OF)
        return sorted(
            self.commands, key=lambda name: order.index(name) if name in order else len(order)
        )

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, or None if it is unknown or its package cannot be imported."""
        if cmd_name not in self.commands:
            self._find_added()
        command: Any = self.commands.get(cmd_name)
        if hasattr(command, "load"):  # an entry point, possibly of the package importlib_metadata
            command = self.commands[cmd_name] = self._load(cmd_name, command)
        return command

    def _load(self, name: str, entry: EntryPoint) -> Any:
        package = entry.module.partition(".")[0]
        try:
            command = entry.load()
        except Exception as error:
            if package not in self._unusable:
                self._unusable.add(package)
                reason = f"{type(error).__name__}: {error}"
                announce_warnings([f"the commands of {package} are not available ({reason})"])
            return None
        parent = typer.Typer(cls=TyperGroup)
        panel = _PANEL_OF.get(name, _EXTENSIONS) if self.name == _PROGRAM else None
        _add_command(parent, name, command, panel)
        return typer.main.get_group(parent).commands[name]


def _add_command(parent: typer.Typer, name: str, command: Any, panel: str | None) -> None:
    if isinstance(command, typer.Typer):
        for inner in command.registered_commands:
            inner.cls = Command
        parent.add_typer(command, name=name, cls=Group, rich_help_panel=panel)
    else:
        examples = _EXAMPLES.get(name) if panel else None
        epilog = "\n\n".join(("Examples:", *examples)) if examples else None
        parent.command(name, cls=Command, rich_help_panel=panel, epilog=epilog)(command)


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
    help="Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic "
    "vehicle.",
    epilog="Exit codes: 0 success; 1 a controller under test or a verification failed; 2 bad "
    "input; 3 interrupted or incomplete (run the same command to resume).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_versions(expected: bool) -> None:
    """Print the versions that a problem report should state, and exit."""
    if expected:
        import platform
        from importlib.metadata import version
        from importlib.util import find_spec

        say(f"abhv-mc {__version__}")
        say(f"python {platform.python_version()} on {platform.platform()}")
        for library in _LIBRARIES:
            say(f"{library} {version(library)}")
        from abhv_mc.campaign.file.systems import load_simulators

        say(*filter(None, {own.version() for own in load_simulators().values()}), sep="\n")
        for package in PACKAGES:
            if find_spec(package) is None:
                say(f"{package} is not installed; its commands are not available")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False,
        "--version",
        callback=_print_versions,
        is_eager=True,
        help="Print the versions of abhv-mc and its libraries, and exit.",
    ),
) -> None:
    pass


for _panel, _commands in _PANELS.items():
    for _command in _commands:
        if not isinstance(_command, str):
            _add_command(app, _name(_command), _command, _panel)


def main() -> None:
    """Run the command line and exit with its exit code."""
    # The variable must be set before numpy is loaded. BLAS threads slow down small matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Fewer garbage collections: imports and kernels create many objects that stay alive.
    gc.set_threshold(300_000, 10, 10)
    sys.argv[1:] = map(hide_key, sys.argv[1:])
    open_streams()
    with sigterm_as_interrupt():
        try:
            app(prog_name="abhv-mc")  # Shell completion expects this program name.
        except (
            BaseException
        ) as error:  # Also catch SystemExit, so that every exit has a documented code.
            code = flush_output(exit_code_of(error))
            if "duckdb" not in sys.modules:  # duckdb would report frozen objects as leaks.
                gc.freeze()  # Skip the garbage collection at exit.
            sys.exit(code)
