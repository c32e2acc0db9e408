"""FMUs (FMI 2.0 and 3.0) of the shipped LQR in C, compiled with the headers that fmpy ships."""

import os
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path

import fmpy
import psutil

from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.laws.columns import LQR_GAINS, REFERENCE
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS, Measured
from abhv_mc_vehicle.user_code.law_source import make_header, make_settings_header

HERE = Path(__file__).parent
GAINS = (*LQR_GAINS, "earth_radius", "gravitational_parameter")
PARAMS = {"alpha_min": "-1 deg", "alpha_max": "12 deg", "bank_limit": "70 deg"}
INPUTS = [f"measured.{name}" for name in Measured._fields] + [
    f"reference.{name}" for name in REFERENCE
]
INPUTS += [f"gains.{name}" for name in GAINS]
OUTPUTS = [f"command.{name}" for name in COMMAND_FIELDS]
TYPED = {  # type of FMI 2.0 and 3.0
    "enable": ("Boolean", "Boolean"),
    "stage": ("Integer", "Int8"),
    "gain": ("Real", "Float32"),
    "single": ("Real", "Float32"),
    "runs": ("Boolean", "Boolean"),
    "one": ("Integer", "UInt16"),
}
SEEN, ELEVONS = ("onboard.moment.pitch", "onboard.last.rudder"), ("right", "left")
LAYOUT = [("angle_of_attack", 2), ("bank_limit", 0)]


def make_fmu(
    file,
    version,
    repository,
    units=None,
    memory="",
):
    """Write an FMU with ``units`` of some variables; only ``deg`` is defined.

    With ``memory`` the law has an integral of the speed error, which is a declared state
    (``named``) or not (``hidden``).
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "abhv_law.h").write_text(make_header())
        (folder / "abhv_settings.h").write_text(make_settings_header(LAYOUT))
        shutil.copy(repository / "configs" / "control" / "lqr_c" / "lqr.c", folder)
        shutil.copy(HERE / "lqr_fmu.c", folder)
        headers = Path(fmpy.__file__).parent / "c-code"
        platform = fmpy.platform if version == 2 else fmpy.platform_tuple
        binaries = folder / "binaries" / platform
        binaries.mkdir(parents=True)
        library = binaries / f"lqr{fmpy.sharedLibraryExtension}"
        command = [
            "cc",
            "-shared",
            "-fPIC",
            "-O2",
            "-ffp-contract=off",
            f"-DFMI_VERSION={version}",
            f"-I{headers}",
        ]
        command += ["-DREMEMBERS"] if memory else []
        subprocess.run([*command, "-I.", "-o", str(library), "lqr_fmu.c"], cwd=folder, check=True)
        (folder / "modelDescription.xml").write_text(describe(version, units or {}, memory))
        with zipfile.ZipFile(file, "w") as archive:
            for path in (library, folder / "modelDescription.xml"):
                archive.write(path, path.relative_to(folder).as_posix())


def describe(version, units, memory):
    end = len(INPUTS) + len(PARAMS) + len(OUTPUTS)  # a state and its rate
    kinds = [
        ("input", 0, INPUTS),
        ("parameter", len(INPUTS), PARAMS),
        ("output", end - len(OUTPUTS), OUTPUTS),
    ]
    kinds += [("input", end + 2, SEEN), ("output", end + 4, ELEVONS)]
    lines = []
    for causality, first, names in kinds:
        for number, name in enumerate(names, first):
            unit = f' unit="{units[name]}"' if name in units else ""
            start = "" if causality == "output" else ' start="0"'
            attributes = ' variability="fixed"' if causality == "parameter" else ""
            head = f'name="{name}" valueReference="{number}" causality="{causality}"{attributes}'
            if version == 2:
                lines.append(f"<ScalarVariable {head}><Real{unit}{start}/></ScalarVariable>")
            else:
                lines.append(f"<Float64 {head}{unit}{start}/>")
    for number, (name, types) in enumerate(TYPED.items(), end + 6):
        causality = "input" if number < end + 9 else "output"
        head = f'name="{name}" valueReference="{number}" causality="{causality}"'
        start = ' start="0"' if causality == "input" else ""
        kind = types[version - 2]
        start = start.replace("0", "false") if kind == "Boolean" else start
        discrete = "" if kind in ("Real", "Float32") else ' variability="discrete"'
        text = f"<ScalarVariable {head}{discrete}><{kind}{start}/></ScalarVariable>"
        lines.append(text if version == 2 else f"<{kind} {head}{discrete}{start}/>")
    structure = ""
    if memory == "named":
        derivative = len(lines) + 1 if version == 2 else end
        local = {
            "speed_integral": ('initial="exact"', 'start="0"'),
            "rate": ("", f'derivative="{derivative}"'),
        }
        for i, (name, (attributes, start)) in enumerate(local.items()):
            head = f'name="{name}" valueReference="{end + i}" causality="local" {attributes}'
            text = f"<ScalarVariable {head}><Real {start}/></ScalarVariable>"
            lines.append(text if version == 2 else f"<Float64 {head} {start}/>")
        text = f'<Derivatives><Unknown index="{len(lines)}"/></Derivatives>'
        structure = (
            text if version == 2 else f'<ContinuousStateDerivative valueReference="{end + 1}"/>'
        )
    token = 'guid="{lqr}"' if version == 2 else 'instantiationToken="{lqr}"'
    degree = (
        '<UnitDefinitions><Unit name="deg"><BaseUnit rad="1" '
        'factor="0.017453292519943295"/></Unit></UnitDefinitions>'
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}.0" modelName="lqr" {token}>
<CoSimulation modelIdentifier="lqr" canHandleVariableCommunicationStepSize="true"/>
{degree}
<ModelVariables>{"".join(lines)}</ModelVariables>
<ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>
"""


def write_controller(file, fmu, repository):
    """Write the controller file of such an FMU, and its design next to it."""
    shutil.copy(repository / "configs" / "control" / "lqr_c" / "lqr_design.py", file.parent)
    lines = [
        "law: fmu",
        f"file: {fmu}",
        "design: lqr_design.py",
        "inputs:",
        *(f"  {n}: {n}" for n in INPUTS),
    ]
    lines += ["outputs:", *(f"  {name}: command.{name}" for name in COMMAND_FIELDS)]
    lines += ["params:", *(f"  {name}: {value}" for name, value in PARAMS.items())]
    file.write_text("\n".join(lines) + "\n")


def measure_leak(plan, rounds):
    """Return the bytes and handles used by the second half of the calls; run in the child."""
    parameters, usage = nominal_parameters(LANES), []
    for _ in range(rounds):
        fly(plan, parameters)
        usage.append((psutil.Process().memory_info().rss, len(os.listdir("/proc/self/fd"))))  # noqa: PTH208
    half = rounds // 2
    return usage[-1][0] - usage[half][0], usage[-1][1] - usage[half][1]
