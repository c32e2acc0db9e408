"""Trim tables: balance at the nodes, interpolation error, limits without trim; the design cache."""

from pathlib import Path

import numpy as np
import pytest

from abhv_mc_vehicle.control.design.design_cache import cache_results
from abhv_mc_vehicle.control.design.design_model import Environment
from abhv_mc_vehicle.control.design.reference import (
    COLUMN_INDEX,
    make_mission_trim_tables,
    solve_reference,
)
from abhv_mc_vehicle.control.design.trim_tables import LONGEST, make_trim_tables, trim_elevator
from abhv_mc_vehicle.kernel.laws.trim_lookup import TRIM_ROWS
from abhv_mc_vehicle.kernel.plant.vehicle import CHUNK
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
    table_rows,
)

ALTITUDE = 20e3
TICK, TICKS = 0.01, 6000
VEHICLES = Path(__file__).parents[4] / "configs" / "vehicle"


@pytest.mark.parametrize("name", ["ghame", "ghame_x", "ghame_x_coupled", "winged_cone"])
def test_interpolation_errors_are_small(name):
    """Compare with an exact trim at random points between the nodes."""
    vehicle = load_vehicle(VEHICLES / f"{name}.yaml")
    tables = make_trim_tables(vehicle, ALTITUDE, (1300.0, 1500.0))
    density, _, _, sound_speed = atmosphere(ALTITUDE)
    constants = vehicle.constants
    generator = np.random.default_rng(1)
    speed = generator.uniform(1300.0, 1500.0, 500)
    alpha = generator.uniform(np.deg2rad(-1.0), np.deg2rad(12.0), 500)
    eta = generator.uniform(0.25, constants.equivalence_ratio_max, 500)
    around = Environment(ALTITUDE, density, sound_speed, 9.75, 6.37e6, 0.0)
    exact = trim_elevator(vehicle, around, speed, alpha, eta)
    # The vehicle's own tables at the interpolated and at the exact elevator differ by the moment of
    # the difference.
    point = {"mach": speed / sound_speed, "angle_of_attack": alpha, "equivalence_ratio": eta}
    inside = make_variables(vehicle, **point)
    row = dict(zip(TRIM_ROWS, table_rows(tables, inside), strict=False))
    good = np.abs(exact) < constants.surface_limit
    assert good.sum() > 150
    assert np.rad2deg(np.abs(row["elevator"] - exact)[good]).max() < 0.01

    # Against the vehicle's own tables at the exact elevator; errors as angle of attack and
    # equivalence ratio.
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


def test_elevators_of_nodes_do_not_depend_on_the_limit(vehicle):
    """Check that the line through the limits is exact for GHAME.

    Its pitching moment is linear in the elevator.
    """
    weak = vehicle._replace(constants=vehicle.constants._replace(surface_limit=np.deg2rad(1.0)))
    limited, free = (
        make_trim_tables(craft, ALTITUDE, (1400.0, 1400.0)).data.reshape(-1, CHUNK)[:, 0]
        for craft in (weak, vehicle)
    )
    assert 0 < np.sum(np.abs(free) > np.deg2rad(1.0)) < free.size
    np.testing.assert_allclose(limited, free, rtol=0.0, atol=1e-11)


def test_an_elevator_next_to_its_limit_is_compared_after_interpolation(vehicle, mission, column):
    """Check the effect of the elevator limit.

    A limit above the reference's elevator has none; a lower one clips it and sets the status.
    """
    largest = np.abs(column["elevator"]).max()
    for limit, trimmed in ((1.001 * largest, True), (0.9 * largest, False)):
        craft = vehicle._replace(constants=vehicle.constants._replace(surface_limit=limit))
        tables = make_mission_trim_tables(mission, craft)
        reference, trim = solve_reference(mission, craft, tables, TICK, TICKS)
        assert (not trim.status.any()) is trimmed
        elevator = np.clip(column["elevator"], -limit, limit)
        np.testing.assert_allclose(reference[:, COLUMN_INDEX["elevator"]], elevator, atol=1e-9)


@pytest.mark.parametrize(
    ("speeds", "steady"),
    [
        ((1400.0, 1400.0), (4.7446,)),
        ((1400.0, 1430.0), (4.7446, 4.8463)),  # in one cell of GHAME's, both
        ((1180.0, 1475.5), (4.0,)),  # GHAME's own node
        ((1180.0, 1475.5), (4.015,)),
        ((1180.0, 1475.5), (4.03, 4.9)),
    ],
)
def test_steady_mach_numbers_are_in_the_middle_half_of_a_cell(vehicle, speeds, steady):
    tables = make_trim_tables(vehicle, ALTITUDE, speeds, np.array(steady))
    grid = tables.grid[: tables.axis_length[0]]
    assert np.diff(grid).max() <= LONGEST["mach"] + 1e-9 and np.diff(grid).min() > 0.01
    for mach in steady:
        cell = np.searchsorted(grid, mach) - 1
        assert 0.25 < (mach - grid[cell]) / (grid[cell + 1] - grid[cell]) < 0.75


def test_the_cache_distinguishes_arguments_by_their_contents():
    calls = []

    @cache_results
    def total(values, *, scale=1.0):
        calls.append(scale)
        return scale * values.sum()

    values = np.arange(3.0)
    assert total(values) == total(np.arange(3.0)) == 3.0 and len(calls) == 1
    assert [total(values, scale=2.0), total(np.arange(4.0))] == [6.0, 6.0]
    values[0] = 5.0
    assert total(values) == 8.0 and len(calls) == 4
