"""Folders below ``_build/work`` where the pages' commands and cells run, and the campaign that several show."""

import sys
from pathlib import Path
from shutil import copytree, rmtree
from subprocess import run

from abhv_mc.campaign.file.new_campaign import write_new_campaign

RUNS = 200


def prepare(app) -> None:
    """Empty folders for the pages; the study is flown once and kept while its campaign and the program are the same."""
    work = Path(app.srcdir) / "_build" / "work"
    for folder in work.iterdir() if work.is_dir() else ():
        if folder.name != "study":
            rmtree(folder)
    study, fresh = work / "study", work / "fresh"
    write_new_campaign(fresh)
    copytree(fresh, study, dirs_exist_ok=True)
    rmtree(fresh)
    command = [sys.executable, "-m", "abhv_mc", "run", "campaign.yaml", "--runs", str(RUNS), "--no-report"]
    if run(command, cwd=study, capture_output=True, check=False).returncode != 0:
        run([*command, "--fresh"], cwd=study, check=True, stdout=sys.stderr)


def setup(app) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", prepare)
    return {"parallel_read_safe": True}
