"""Vehicle, mission and reference of the tests in this folder."""

from pathlib import Path

import pytest

from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables, solve_reference
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[3] / "configs"
TICK, TICKS = 0.01, 6000


@pytest.fixture(scope="session")
def vehicle():
    return load_vehicle(
        CONFIGS / "vehicle" / "ghame_x_coupled.yaml"
    )  # thrust inclined and offset: every term counts


@pytest.fixture(scope="session")
def mission():
    return read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")


@pytest.fixture(scope="session")
def trim_tables(vehicle, mission):
    return make_mission_trim_tables(mission, vehicle)


@pytest.fixture(scope="session")
def reference(mission, vehicle, trim_tables):
    return solve_reference(mission, vehicle, trim_tables, TICK, TICKS)[0]


@pytest.fixture(scope="session")
def column(reference):
    return {name: reference[:, i] for i, name in enumerate(REFERENCE)}
