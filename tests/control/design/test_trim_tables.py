"""Trim tables: balanced at the nodes, as good as exact between them, honest where there is no trim; what is kept."""

from pathlib import Path

import numpy as np
import pytest

from abhv_mc.control.design.design_model import Environment
from abhv_mc.control.design.kept import kept
from abhv_mc.control.design.trim_tables import make_trim_tables, trim_elevator
from abhv_mc.kernel.laws.trim_lookup import TRIM_ROWS
from abhv_mc.kernel.plant.vehicle import Vehicle
from abhv_mc.kernel.world.atmosphere import atmosphere
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.vehicle.evaluate import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
    table_rows,
)

ALTITUDE = 20e3
VEHICLES = Path(__file__).parents[3] / "configs" / "vehicle"


@pytest.mark.parametrize("name", ["ghame", "ghame_x", "ghame_x_coupled", "winged_cone"])
def test_interpolation_errs_by_little(name: str) -> None:
    """At random points between the nodes, against a trim solved there."""
    vehicle = load_vehicle(VEHICLES / f"{name}.yaml")
    tables = make_trim_tables(vehicle, ALTITUDE, (1300.0, 1500.0))
    density, _, _, sound_speed = atmosphere(ALTITUDE)
    constants = vehicle.constants
    generator = np.random.default_rng(1)
    speed = generator.uniform(1300.0, 1500.0, 500)
    alpha = generator.uniform(np.deg2rad(-1.0), np.deg2rad(12.0), 500)
    eta = generator.uniform(0.25, constants.equivalence_ratio_max, 500)
    around = Environment(ALTITUDE, density, sound_speed, 9.75, 6.37e6, 0.0)
    exact, trimmed = trim_elevator(vehicle, around, speed, alpha, eta)
    # The vehicle's own tables at the interpolated and at the exact elevator differ by the moment of the difference.
    point = {"mach": speed / sound_speed, "angle_of_attack": alpha, "equivalence_ratio": eta}
    inside = make_variables(vehicle, **point)
    row = dict(zip(TRIM_ROWS, table_rows(tables, inside), strict=False))
    good = trimmed & (row["untrimmed"] == 0.0)
    assert good.sum() > 150
    assert np.rad2deg(np.abs(row["elevator"] - exact)[good]).max() < 0.01

    # Against the vehicle's own tables at the exact elevator; errors as angle of attack and equivalence ratio.
    step = np.deg2rad(0.01)
    up = table_rows(tables, make_variables(vehicle, **point | {"angle_of_attack": alpha + step}))
    lift_slope = np.median((up[TRIM_ROWS.index("lift")] - row["lift"]) / step)
    variables = make_variables(
        vehicle, **point, elevator=exact, altitude=ALTITUDE, mass=constants.mass_start
    )[:, good]
    coefficients, fixed = (
        evaluate_coefficients(vehicle, variables),
        evaluate_fixed(vehicle, variables),
    )
    thrust = (
        constants.capture_thrust
        * eta[good]
        * fixed["capture_area_ratio"]
        * fixed["specific_impulse"]
    )
    thrust = thrust / (0.5 * speed[good] * constants.area) + fixed["thrust_area"] / constants.area
    errors = {
        name: row[name][good] - value
        for name, value in zip(("lift", "drag"), coefficients, strict=False)
    }
    assert np.rad2deg(np.abs(errors["lift"])).max() / lift_slope < 0.001
    assert (np.abs(errors["drag"]) < 4e-3 * coefficients[1]).all()
    assert (np.abs(row["thrust"][good] - thrust) < 0.0015 * thrust / eta[good]).all()


def test_a_node_without_trim_is_marked_and_clamped(vehicle: Vehicle) -> None:
    limit = np.deg2rad(1.0)
    weak = vehicle._replace(constants=vehicle.constants._replace(surface_limit=limit))
    tables = make_trim_tables(weak, ALTITUDE, (1400.0, 1400.0))
    values = tables.data.reshape(-1, tables.group_width[0])
    elevator, untrimmed = values[:, 0], values[:, TRIM_ROWS.index("untrimmed")]
    assert 0 < untrimmed.sum() < untrimmed.size
    np.testing.assert_array_equal(np.abs(elevator[untrimmed == 1.0]), limit)
    assert (np.abs(elevator[untrimmed == 0.0]) < limit).all()
    strong = make_trim_tables(vehicle, ALTITUDE, (1400.0, 1400.0)).data.reshape(
        -1, tables.group_width[0]
    )[:, 0]
    np.testing.assert_array_equal(np.sign(elevator), np.sign(strong))  # the end nearest to the trim


def test_equal_contents_share_a_result_and_others_do_not():
    calls = []

    @kept
    def total(values, *, scale=1.0):
        calls.append(scale)
        return scale * values.sum()

    values = np.arange(3.0)
    assert total(values) == total(np.arange(3.0)) == 3.0 and len(calls) == 1
    assert [total(values, scale=2.0), total(np.arange(4.0))] == [6.0, 6.0]
    values[0] = 5.0
    assert total(values) == 8.0 and len(calls) == 4
