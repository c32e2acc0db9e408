"""A folder to start from: a simulator of one's own, and the campaign that flies it."""

import shutil
import subprocess
from pathlib import Path

from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.shipped import shipped_configs
from abhv_mc.simulators.new_campaign import refuse_filled, write_schemas

SIMULATORS = ("python", "command")


def write_new_simulator(folder: Path, kind: str) -> list[Path]:
    """Fill a new or empty folder with the shipped rocket, a Python function or a program in C; name what was written.

    The campaign comes first. A program is built where there is a C compiler: ``rocket`` is then the last.
    Raises :class:`InputError` for another kind, or where the folder holds something already.
    """
    if kind not in SIMULATORS:
        raise InputError("--simulator", f"'{kind}'", one_of(SIMULATORS, kind))
    refuse_filled(folder)
    source = shipped_configs() / "simulator"
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "campaign.yaml"]
    text = (source / "campaign.yaml").read_text(encoding="utf-8")
    if kind == "command":
        called = "  command: [./rocket] # it reads flights as lines of JSON and answers each by a line; built of:\n"
        text = text.replace(next(line for line in text.splitlines(True) if line.startswith("  python:")), called)
        text = text.replace(called, f"{called}  files: [rocket.c, Makefile]\n")
    written[0].write_text(text, encoding="utf-8")
    for file in sorted((source / kind).iterdir()):
        if file.is_file():
            written.append(Path(shutil.copyfile(file, folder / file.name)))
    written += write_schemas(folder, written[:1], ["campaign"])
    if kind == "command":
        try:
            subprocess.run(["make", "--quiet"], cwd=folder, capture_output=True, check=True)  # noqa: S607
            written.append(folder / "rocket")
        except (OSError, subprocess.CalledProcessError):
            pass  # whoever asked is told how to
    return written
