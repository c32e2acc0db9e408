"""JSBSim models whose control surfaces are set by the tests."""

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
    """Load a model without its flight control, whose properties then keep their values."""
    tree = ElementTree.parse(model(name))
    root = tree.getroot()
    for element in [element for element in root if element.tag in _CONTROL]:
        root.remove(element)
    folder = Path(tempfile.mkdtemp())
    (folder / name).mkdir()
    tree.write(folder / name / f"{name}.xml")
    executive = jsbsim.FGFDMExec(str(AIRCRAFT.parent))
    executive.set_debug_level(0)
    executive.set_aircraft_path(str(folder))
    executive.set_engine_path(str(AIRCRAFT.parent / "engine"))
    assert executive.load_model(name)
    return executive


def deflect(executive: Any, aileron: float, rudder: float, elevator: float) -> None:
    for name, angle in (
        ("elevator", elevator),
        ("mag-elevator", abs(elevator)),
        ("left-aileron", aileron),
        ("right-aileron", -aileron),
        ("aileron", aileron),
        ("rudder", rudder),
    ):
        executive[f"fcs/{name}-pos-rad"] = angle
