"""Creation of starter folders: a campaign with all its files, or a custom simulator."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.kinds import find_kind, find_kinds
from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.io.messages import InputError, check_names
from abhv_mc.shipped import shipped_configs, shipped_files
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.law_file import CController
from abhv_mc_vehicle.user_code.law_source import write_headers
from abhv_mc_vehicle.vehicle_simulator.references import find_references

DEFAULT = "s_manoeuvre"
LAWS = ("python", "c")
SIMULATORS = ("python", "command")
_SCHEMAS = "schemas"
_MAKEFILE = """\
# To use this library, write 'library: libmy_law.so' in my_law.yaml instead of \
'sources: [my_law.c]'.
# abhv-mc writes the headers; after a change of the settings in my_law.yaml run `make headers`.
libmy_law.so: my_law.c abhv_law.h abhv_settings.h
\tcc -shared -fPIC -O2 -Wall -ffp-contract=off -I. -o $@ my_law.c -lm

headers: my_law.yaml
\tpython3 -m abhv_mc_vehicle.user_code.law_source my_law.yaml
"""
_OTHER_VEHICLE = """\
# A shipped campaign with another vehicle. Controllers whose numbers were made for other vehicles,
# or by unequal searches (heads of their files), do not compare the control laws.
"""
_QUESTION = "Does my control law track this mission as well as the shipped controllers?"


_TUNE = """
# `abhv-mc tune campaign.yaml --controller tlc -o control/tlc_tuned.yaml` varies these parameters \
of control/tlc.yaml.
tune:
  free: # varied from a fifth to five times the value in the file, or by the given factor
    - altitude.damping
    - {key: altitude.bandwidth, factor: 10}
  minimise: {metric: altitude_error_rms_m, quantile: 0.95}
  limits: # limits on side effects of a smaller error
    - {metric: elevator_travel_deg, quantile: 0.5, below_start_times: 1.5}
    - {metric: gain_margin_min_db, above: 6} # of the nominal vehicle
    - {metric: phase_margin_min_deg, above: 30}
  margins_at: [trim]
  usage: {metric: elevator_travel_deg, quantile: 0.5} # second axis of the Pareto front
  flights: 32 # per candidate, with equal samples
  candidates: 64
  validation: 400 # new flights with the tuned and the initial parameters
"""


def write_new_campaign(
    folder: Path,
    name: str = DEFAULT,
    law: str | None = None,
    vehicle: Path | None = None,
    tune: bool = False,
) -> list[Path]:
    """Fill a new or empty folder with a shipped campaign, and return the files written.

    The first file is ``campaign.yaml``. ``law`` (``python`` or ``c``) adds a commented custom
    controller, ``tune`` adds a block of free parameters, and ``vehicle`` replaces the vehicle and
    removes controllers designed for another vehicle. Raise InputError, without writing files, for
    an unknown name, a folder that is not empty, or an unsuitable vehicle.
    """
    check_names("--law", filter(None, [law]), LAWS, "language")
    campaigns = shipped_files("campaign")
    check_names("--from", [name], campaigns, "campaign")
    refuse_filled(folder)
    source = campaigns[name]
    campaign = read_campaign(source).model
    text = _rename(source, folder).replace("../configs/", "")
    controllers = dict(campaign.controllers)
    if vehicle is not None:
        text, controllers = _replace_vehicle(text, controllers, vehicle)
    if tune and "tlc" not in controllers:
        raise InputError(
            "--tune",
            f"the campaign '{name}' has no controller tlc",
            "a campaign with the controller tlc",
        )
    craft = vehicle or campaign.vehicle
    channels = () if campaign.channels is None else (campaign.channels,)
    named = (craft, campaign.mission, *controllers.values(), *channels)
    files = {file for path in named for file in (path, *find_references(path.resolve()))}
    targets = {file.resolve(): folder / _place(file.resolve(), craft) for file in files}
    written = [folder / "campaign.yaml"]
    for file, target in sorted(targets.items()):
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        written.append(target)
    written[0].write_text(text + _TUNE * tune, "utf-8")
    try:
        if law is not None:
            written += _add_law(folder, written[0], law)
        read_campaign(written[0])
    except InputError:
        shutil.rmtree(folder)
        raise
    return written + write_schemas(folder, [file for file in written if file.suffix == ".yaml"])


def _rename(campaign: Path, folder: Path) -> str:
    """Return the text of a campaign with the name of its new folder.

    Campaigns with different names have different results folders.
    """
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", folder.resolve().name).lstrip("_.-")[:80]
    text = campaign.read_text("utf-8")
    return re.sub(r"(?m)^name: .*$", f'name: "{name}"', text) if name else text


def _place(file: Path, vehicle: Path) -> Path:
    """Return the relative path of a file in the folder of the new campaign.

    Raise InputError if the file is neither shipped nor in the folder of the vehicle.
    """
    for home, below in (
        (shipped_configs().resolve(), Path()),
        (vehicle.resolve().parent, Path("vehicle")),
    ):
        if file.is_relative_to(home):
            return below / file.relative_to(home)
    raise InputError(
        vehicle,
        f"the vehicle refers to {file}, which is not in the folder of the vehicle",
        "files in this folder or its subfolders",
    )


def _replace_vehicle(
    text: str, controllers: dict[str, Path], vehicle: Path
) -> tuple[str, dict[str, Path]]:
    """Return the text of a campaign and its controllers after a change of vehicle.

    Controllers designed for one vehicle are used with that vehicle only.
    """
    designed = {name for name in shipped_files("vehicle") if name != vehicle.stem}
    fitting = {name: file for name, file in controllers.items() if file.parent.name not in designed}
    own = shipped_configs() / "control" / vehicle.stem
    fitting |= {
        file.stem: file for file in sorted(own.glob("*.yaml")) if file not in fitting.values()
    }
    location = _place(vehicle.resolve(), vehicle).as_posix()
    text = re.sub(r"(?m)^vehicle:.*$", f"vehicle: {location}", text)
    lines = [
        f"  {name}: {file.resolve().relative_to(shipped_configs().resolve()).as_posix()}\n"
        for name, file in fitting.items()
    ]
    text = re.sub(
        r"(?m)^(controllers:.*\n)(?:  .*\n)*", lambda head: head[1] + "".join(lines), text
    )
    text = re.sub(
        r"(?m)^under_test: \[(.*?)\]",
        lambda key: f"under_test: [{', '.join(_tested(key[1].split(', '), list(fitting)))}]",
        text,
    )
    text = re.sub(r"\A(?:#.*\n)*", _OTHER_VEHICLE, text)
    return re.sub(r"(?m)^(?:asks|question):.*\n", "", text), fitting


def _tested(names: list[str], fitting: list[str]) -> list[str]:
    """Return the names among ``fitting``, or else the first of ``fitting``."""
    return [name for name in names if name in fitting] or fitting[:1]


def refuse_filled(folder: Path) -> None:
    """Raise InputError if the path is a file or a folder that is not empty."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "the path is a file", "a new or empty folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(folder, "the folder is not empty", "a new or empty folder")


def write_schemas(folder: Path, files: list[Path], kinds: Iterable[str] = ()) -> list[Path]:
    """Write the JSON Schemas of ``kinds``, and refer editors to them in comments of ``files``."""
    written = []
    (folder / _SCHEMAS).mkdir()
    for kind in kinds or find_kinds():
        written.append(folder / _SCHEMAS / f"{kind}.schema.json")
        written[-1].write_text(json.dumps(make_schema(kind), indent=1) + "\n", "utf-8")
    for file in files:
        schema = Path(
            os.path.relpath(folder / _SCHEMAS / f"{find_kind(file)}.schema.json", file.parent)
        )
        line = f"# yaml-language-server: $schema={schema.as_posix()}\n"
        file.write_text(line + file.read_text("utf-8"), "utf-8")
    return written


def _add_law(folder: Path, campaign: Path, law: str) -> list[Path]:
    """Add the shipped example of a control law as ``my_law``, and return its files.

    The C example includes a design, headers and a Makefile.
    """
    source = shipped_configs() / "control"
    target = folder / "control"
    python, text = ((source / f"cascade.{ending}").read_text("utf-8") for ending in ("py", "yaml"))
    contents = {"my_law.py": python, "my_law.yaml": text.replace("cascade.py", "my_law.py")}
    if law == "c":
        inside = source / "cascade_c"
        code, text = (
            (inside / name).read_text("utf-8") for name in ("cascade.c", "cascade_c.yaml")
        )
        contents = {
            "my_law.c": code.replace("../cascade.py", "my_design.py"),
            "my_law.yaml": text.replace("cascade.c", "my_law.c").replace(
                "../cascade.py", "my_design.py"
            ),
            "Makefile": _MAKEFILE,
            "my_design.py": python,
        }
    files = [target / name for name in contents]
    for file, content in zip(files, contents.values(), strict=True):
        file.write_text(content, "utf-8")
    controller = read_controller(target / "my_law.yaml")
    if isinstance(controller, CController):
        files += write_headers(target, controller.layout, controller.onboard)
    text = campaign.read_text("utf-8")
    mine = f"  my_law: control/my_law.yaml # your own: control/{files[0].name}\n"
    text = re.sub(r"(?m)^(controllers:.*\n)", rf"\1{mine}", text)
    text = re.sub(r"(?m)^under_test: \[.*?\]", "under_test: [my_law]", text)
    text = re.sub(r"(?m)^question:.*$", f"question: {_QUESTION}", text)
    text = re.sub(r"(?m)^asks:.*\n", "", text)  # 'asks' would not name my_law.
    campaign.write_text(text, "utf-8")
    return files


def write_new_simulator(folder: Path, kind: str) -> list[Path]:
    """Fill a new or empty folder with the shipped rocket simulator, and return the files.

    ``kind`` is ``python`` for a Python function, or ``command`` for a C program. The campaign is
    the first file. If a C compiler is available, the program is built, and ``rocket`` is the last
    file. Raise InputError for any other kind, or if the folder is not empty.
    """
    check_names("--simulator", [kind], SIMULATORS, "kind")
    refuse_filled(folder)
    source = shipped_configs() / "simulator"
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "campaign.yaml"]
    text = _rename(source / "campaign.yaml", folder)
    if kind == "command":
        called = (
            "  command: [./rocket] # reads each flight as a line of JSON and replies with a "
            "line; built from:\n"
        )
        text = re.sub(r"(?m)^  python:.*\n", f"{called}  files: [rocket.c, Makefile]\n", text)
    written[0].write_text(text, "utf-8")
    files = sorted(filter(Path.is_file, (source / kind).iterdir()))
    written += [Path(shutil.copyfile(file, folder / file.name)) for file in files]
    written += write_schemas(folder, written[:1], ["campaign"])
    if kind == "command":
        try:
            subprocess.run(["make", "--quiet"], cwd=folder, capture_output=True, check=True)  # noqa: S607
            written.append(folder / "rocket")
        except (OSError, subprocess.CalledProcessError):
            pass  # The caller prints instructions for building the program.
    return written
