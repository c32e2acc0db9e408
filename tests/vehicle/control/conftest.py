"""Vehicle, mission and reference of the tests in this folder."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables, solve_reference
from abhv_mc_vehicle.control.mission import Mission, read_mission
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[3] / "configs"
TICK, TICKS = 0.01, 6000


@pytest.fixture(scope="session")
def vehicle() -> Vehicle:
    return load_vehicle(
        CONFIGS / "vehicle" / "ghame_x_coupled.yaml"
    )  # thrust inclined and offset: every term counts


@pytest.fixture(scope="session")
def mission() -> Mission:
    return read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")


@pytest.fixture(scope="session")
def trim_tables(vehicle: Vehicle, mission: Mission) -> Tables:
    return make_mission_trim_tables(mission, vehicle)


@pytest.fixture(scope="session")
def reference(mission: Mission, vehicle: Vehicle, trim_tables: Tables) -> NDArray[np.float64]:
    return solve_reference(mission, vehicle, trim_tables, TICK, TICKS)[0]


@pytest.fixture(scope="session")
def column(reference: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    return {name: reference[:, i] for i, name in enumerate(REFERENCE)}
