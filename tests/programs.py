"""Commands in this process, and Python in another."""

import subprocess
import sys

from typer.testing import CliRunner

from abhv_mc.cli.app import app


def invoke(*arguments, **options):
    """Return the result of a command, in one or several texts, that runs in this process."""
    return CliRunner().invoke(app, words_of(*arguments), **options)


def words_of(first, *further):
    """Return the arguments of a command; a single text is split at its blanks."""
    return [str(first), *map(str, further)] if further else str(first).split()


def run_python(*arguments, check=False, **options):
    """Return an ended process of Python, with its output as text."""
    program = [sys.executable, *map(str, arguments)]
    return subprocess.run(program, capture_output=True, text=True, check=check, **options)
