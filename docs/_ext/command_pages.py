"""Pages of the commands, one each, generated from the command line.

Examples come from ``docs/reference/commands``.
"""

import re
from pathlib import Path
from typing import Any

import typer
from tables import table
from typer.cli import get_docs_for_click

from abhv_mc.cli.app import app


def _options(name: str, command: Any, context: typer.Context) -> str:
    """Return the help of a command and its hidden options, with headings below the page's."""
    for parameter in command.params:
        if getattr(parameter, "hidden", False):
            parameter.hidden = False
            parameter.help += " Not listed by `--help`."
    text = get_docs_for_click(obj=command, ctx=context, indent=1, name=f"abhv-mc {name}")
    text = text.replace(command.epilog or "\0", "")  # the page has examples of its own
    text = re.sub(r"\A#+ .*\n", "", text)
    text = re.sub(r"^### ", "## ", text, flags=re.MULTILINE)  # commands of a command
    return (
        re.sub(r"^\$ (.*)", r"\1", text, flags=re.MULTILINE)
        .replace("```console", "```text")
        .strip()
    )


def make(examples: Path) -> dict[str, str]:
    """Return the pages ``commands/<name>.md`` and their table of contents."""
    group = typer.main.get_command(app)
    context = typer.Context(group, info_name="abhv-mc")
    pages: dict[str, str] = {}
    contents = [
        "# Commands\n",
        "`abhv-mc COMMAND --help` prints the main options. A campaign, mission, vehicle or "
        "controller is a path or the",
        "name of a shipped one. `--json FILE` writes the numbers that a command prints, `--json "
        "-` writes only them to",
        "standard output. Their format is stable; printed text may change.\n",
    ]
    panels: dict[str, list[str]] = {}
    commands = {name: group.get_command(context, name) for name in group.list_commands(context)}
    for name, command in commands.items():
        panels.setdefault(command.rich_help_panel, []).append(name)
    for panel, names in panels.items():
        rows = []
        for name in names:
            command = commands[name]
            first = (command.help or "").strip().split("\n\n")[0]
            rows.append((f"[`{name}`](commands/{name}.md)", " ".join(first.split())))
            by_hand = examples / f"{name}.md"
            parts = [f"# {name}\n", _options(name, command, context), ""]
            if by_hand.exists():
                parts += ["## Examples\n", by_hand.read_text(encoding="utf-8").strip(), ""]
            pages[f"commands/{name}.md"] = "\n".join(parts)
        contents += [f"## {panel}\n", table(("command", "purpose"), rows)]
    toctree = "\n".join(f"commands/{name}" for names in panels.values() for name in names)
    contents.append(f"```{{toctree}}\n:hidden:\n\n{toctree}\n```\n")
    pages["commands.md"] = "\n".join(contents)
    return pages
