"""Folders below ``_build/flown`` in which the pages' commands and cells run.

They contain the campaign that several pages show.
"""

import hashlib
import re
import sys
from pathlib import Path
from shutil import copy, rmtree
from subprocess import run

import abhv_mc
from abhv_mc_jsbsim.import_vehicle import import_jsbsim
from abhv_mc_vehicle.new_campaign import write_new_campaign

RUNS = 200
PROGRAM = Path(abhv_mc.__file__).parent


def prepare(app) -> None:
    """Folders with what the pages begin from."""
    source = Path(app.srcdir)
    work = source / "_build" / "flown"
    for folder in work.iterdir() if work.is_dir() else ():
        if folder.name != "study":
            rmtree(folder)
    write_new_campaign(work / "first-campaign" / "shown")
    for page in (
        "own-mission",
        "own-controller",
        "own-simulator",
        "worst-case",
        "number-of-flights",
        "test-flights",
    ):
        (work / page).mkdir()
        for file in (source / "tutorials" / "files" / page).glob("*"):
            copy(file, work / page)
    _write_vehicle(source / "tutorials" / "own-vehicle.md", work / "own-vehicle")
    _import_model(source / "tutorials" / "files" / "jsbsim-model", work / "jsbsim-model")
    _fly_study(work / "study")


def _write_vehicle(page: Path, folder: Path) -> None:
    """Return the vehicle files that a page shows in blocks.

    The first line of such a block is the file's name.
    """
    for name, text in re.findall(
        r"```\w+\n# (arrow[\w/]*\.(?:yaml|csv))(.*?)```", page.read_text("utf-8"), re.DOTALL
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"# {name}{text}", encoding="utf-8")


def _import_model(files: Path, folder: Path) -> None:
    """Import the JSBSim model that a page simulates.

    It comes from the installed package, with the engine that the page adds.
    """
    import jsbsim

    model = Path(jsbsim.get_default_root_dir()) / "aircraft" / "737" / "737.xml"
    (folder / "import").mkdir(parents=True)
    copy(model, folder / "import")
    import_jsbsim(model, folder / "b737")
    copy(files / "engine.py", folder / "b737")
    with (folder / "b737" / "vehicle.yaml").open("a", encoding="utf-8") as vehicle:
        vehicle.write((files / "engine.yaml").read_text(encoding="utf-8"))
    for name in ("cruise.yaml", "campaign.yaml"):
        copy(files / name, folder)
    write_new_campaign(folder / "study")


def _fly_study(folder: Path) -> None:
    """Run the campaign of ``abhv-mc new`` and the default campaign.

    They run once for each state of the program.
    """
    state = hashlib.sha256()
    for file in sorted(PROGRAM.rglob("*.py")):
        state.update(file.read_bytes())
    stamp = folder / "flown_by"
    if stamp.exists() and stamp.read_text() == state.hexdigest():
        return
    if folder.exists():
        rmtree(folder)
    write_new_campaign(folder)
    for words in (
        ("campaign.yaml", "--runs", str(RUNS), "-o", "reports/s_manoeuvre"),
        ("s_manoeuvre", "-o", "default"),
    ):  # that is the live report
        run(
            [sys.executable, "-m", "abhv_mc", "run", *words],
            cwd=folder,
            check=True,
            stdout=sys.stderr,
        )
    stamp.write_text(state.hexdigest())


def setup(app) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.connect("builder-inited", prepare)
    return {"parallel_read_safe": True}
