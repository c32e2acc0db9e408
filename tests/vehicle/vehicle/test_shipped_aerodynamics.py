"""Plausibility of the shipped vehicles' aerodynamics."""

from itertools import product

import numpy as np
import pytest

from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.plant.trim import GRAVITY, FlightPoint, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.table_file import nodes_of
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_coefficients, make_variables

VEHICLES = ("abhv", "ghame", "ghame_x", "ghame_x_coupled", "winged_cone")
DEFLECTION = np.deg2rad(20.0)


def load(name):
    return load_vehicle(shipped_configs() / f"vehicle/{name}.yaml")


def nodes_within(vehicle):
    """Return Mach number and angle of attack of each node within the limits."""
    low, high = vehicle.constants.angle_of_attack_min, vehicle.constants.angle_of_attack_max
    alphas = nodes_of(vehicle.tables, "angle_of_attack")
    alphas = np.array([low, *alphas[(alphas > low) & (alphas < high)], high])
    mach, alpha = np.meshgrid(nodes_of(vehicle.tables, "mach"), alphas)
    return mach.ravel(), alpha.ravel()


@pytest.mark.parametrize("name", VEHICLES)
def test_drag_is_positive_at_every_node(name):
    vehicle = load(name)
    mach, alpha = nodes_within(vehicle)
    mass = vehicle.constants.mass_start
    variables = make_variables(vehicle, mach=mach, angle_of_attack=alpha, mass=mass)
    assert (evaluate_coefficients(vehicle, variables)[1] > 0.0).all()


@pytest.mark.parametrize("name", VEHICLES)
def test_no_sideslip_and_no_deflection_pushes_the_vehicle_forward(name):
    """The coefficient of the force along the velocity is -CD cos(beta) + CY sin(beta)."""
    vehicle = load(name)
    mach, alpha = nodes_within(vehicle)
    beta = np.deg2rad(np.linspace(0.0, 15.0, 16))[:, None]
    for aileron, rudder in product((-DEFLECTION, DEFLECTION), repeat=2):
        variables = make_variables(
            vehicle,
            mach=mach,
            angle_of_attack=alpha,
            sideslip=beta,
            aileron=aileron,
            rudder=rudder,
            mass=vehicle.constants.mass_start,
        )
        coefficients = evaluate_coefficients(vehicle, variables)
        assert (coefficients[2] * np.sin(beta) - coefficients[1] * np.cos(beta) < 0.0).all()


@pytest.mark.parametrize(("bank", "ratio", "thrust"), [(0.0, 3.645, 0.257), (50.0, 3.544, 0.408)])
def test_trim_of_the_default_vehicle(bank, ratio, thrust):
    """Compare L/D and thrust over weight with those in the S manoeuvre of the paper."""
    vehicle = load("abhv")
    still = WGS84._replace(rotation_rate=0.0)
    point = FlightPoint(20e3, 1400.0, np.deg2rad(bank), latitude=np.deg2rad(29.3))
    point_trim = trim(vehicle, still, point)
    assert not point_trim.fault
    assert point_trim.lift / point_trim.drag == pytest.approx(ratio, abs=0.01)
    weight = vehicle.constants.mass_start * GRAVITY
    assert point_trim.thrust / weight == pytest.approx(thrust, abs=0.002)
    assert vehicle.constants.mass_start / vehicle.constants.area == pytest.approx(393.0, abs=0.1)
