"""The vehicle of docs/tutorials/own-vehicle.md, written from the page, is valid and flies."""

import re

import pytest

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.one_flight.given import make_flight_plan


@pytest.fixture(scope="module")
def arrow(repository, tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "arrow").mkdir()
    page = (repository / "docs/tutorials/own-vehicle.md").read_text()
    for name, text in re.findall(r"```\w+\n# (arrow[\w/]*\.(?:yaml|csv))(.*?)```", page, re.DOTALL):
        (folder / name).write_text(f"# {name}{text}")
    return folder / "arrow.yaml"


@pytest.mark.parametrize(("mission", "altitude_error"), [("level", 5.0), ("turn", 10.0)])
def test_it_flies(arrow, mission, altitude_error):
    block = fly(make_flight_plan(mission, str(arrow)), nominal_parameters())
    metric = {name: block.metrics[0, i] for name, i in METRIC_INDEX.items()}
    assert block.outcome[0] == Outcome.OK
    assert metric["altitude_error_max_m"] < altitude_error
    assert metric["speed_error_max_mps"] < 0.5
    assert metric["surface_saturation_s"] == 0.0
    assert metric["outside_tables_s"] == 0.0
