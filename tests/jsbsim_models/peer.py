"""JSBSim itself, with the surfaces of its models in the tests' hands."""

import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

jsbsim: Any = pytest.importorskip("jsbsim")
AIRCRAFT = Path(jsbsim.get_default_root_dir()) / "aircraft"
FOOT = 0.3048
SLUG = 14.593902937206364
_CONTROL = ("flight_control", "autopilot", "system")


def model(name: str) -> Path:
    return AIRCRAFT / name / f"{name}.xml"


def load(name: str) -> Any:
    """A model whose flight control is taken out: its properties are what they are set to."""
    tree = ElementTree.parse(model(name))
    root = tree.getroot()
    for part in [part for part in root if part.tag in _CONTROL]:
        root.remove(part)
    folder = Path(tempfile.mkdtemp())
    (folder / name).mkdir()
    tree.write(folder / name / f"{name}.xml")
    made = jsbsim.FGFDMExec(str(AIRCRAFT.parent))
    made.set_debug_level(0)
    made.set_aircraft_path(str(folder))
    made.set_engine_path(str(AIRCRAFT.parent / "engine"))
    assert made.load_model(name)
    return made


def deflect(made: Any, aileron: float, rudder: float, elevator: float) -> None:
    for name, angle in (
        ("elevator", elevator),
        ("mag-elevator", abs(elevator)),
        ("left-aileron", aileron),
        ("right-aileron", -aileron),
        ("aileron", aileron),
        ("rudder", rudder),
    ):
        made[f"fcs/{name}-pos-rad"] = angle
