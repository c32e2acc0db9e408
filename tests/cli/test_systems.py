"""Where the program cannot run it says so in a sentence."""

import subprocess
import sys
from pathlib import Path

import abhv_mc


def test_another_system_is_told_what_is_needed() -> None:
    """In a process of its own: much of Python looks at the system's name."""
    program = "import abhv_mc, os; os.name = 'nt'; import abhv_mc.cli"
    source = str(Path(abhv_mc.__file__).parents[1])
    words, environment = [sys.executable, "-c", program], {"PYTHONPATH": source}
    ended = subprocess.run(words, check=False, env=environment, capture_output=True, text=True)
    assert ended.returncode == 2
    assert "Linux or macOS" in ended.stderr
    assert "Traceback" not in ended.stderr
