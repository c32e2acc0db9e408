"""Warnings about valid vehicle files."""

import re

import numpy as np
import pytest

from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, VARIABLES
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.warnings import find_vehicle_warnings


@pytest.mark.parametrize("name", ["ghame", "ghame_x", "ghame_x_coupled", "winged_cone"])
def test_no_shipped_vehicle_is_doubted(repository, name):
    assert find_vehicle_warnings(load_vehicle(repository / f"configs/vehicle/{name}.yaml")) == []


def scaled(vehicle, coefficient, variable, factor):
    """The vehicle with one of its derivatives multiplied: its terms count so many times."""
    terms = vehicle.build_up
    row, column = COEFFICIENTS.index(coefficient), VARIABLES.index(variable)
    chosen = (terms.coefficient == row) & (terms.variable == column)
    assert chosen.any()
    data = vehicle.tables.data.copy()
    for table in terms.table[chosen]:
        group = int(np.searchsorted(vehicle.tables.group_row, table, side="right")) - 1
        width, start = vehicle.tables.group_width[group], vehicle.tables.group_start[group]
        stop = np.append(vehicle.tables.group_start, data.size)[group + 1]
        data[start:stop].reshape(-1, width)[:, table - vehicle.tables.group_row[group]] *= factor
    return vehicle._replace(tables=vehicle.tables._replace(data=data))


@pytest.mark.parametrize(
    ("coefficient", "variable", "factor", "words"),
    [
        ("yawing_moment", "sideslip", 180 / np.pi, "radians for degrees, would make it 0.30"),
        ("side_force", "sideslip", np.pi / 180, "would make it -0.9"),
        ("pitching_moment", "pitch_rate_hat", -1.0, "2.81 per unit of pitch rate.*pitching drives itself"),
        ("yawing_moment", "sideslip", -1.0, "-0.30.* statically unstable in yaw"),
        ("rolling_moment", "roll_rate_hat", 180 / np.pi, "would make it -0.1"),
    ],
)
def test_a_derivative_of_another_unit_or_sign_is_said_with_its_number(repository, coefficient, variable, factor, words):
    vehicle = scaled(load_vehicle(repository / "configs/vehicle/ghame_x.yaml"), coefficient, variable, factor)
    (warning,) = find_vehicle_warnings(vehicle)
    assert re.search(words, warning), warning
