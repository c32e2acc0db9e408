"""Tests of the table of parameters that a campaign can disperse."""

from abhv_mc.io.units import dimension_of, parse_in_unit
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.one_flight.fly_once import make_parameters
from abhv_mc_vehicle.plant.parameters import OURS, PARAMETERS
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle


def test_every_parameter_accepts_a_value_in_its_unit():
    """Regression: the unit K was unknown, so the air's temperature could not be dispersed."""
    for parameter in PARAMETERS:
        assert dimension_of(parameter.unit).unit == parameter.unit, parameter.name
        assert parse_in_unit(f"2 {parameter.unit.replace('-', '')}", parameter.unit) == 2.0
    vehicle = load_vehicle(find_input("abhv", "vehicle"))
    row = make_parameters({"atmosphere.temperature": "-15 K"}, vehicle)[0]
    assert row[OURS.index["atmosphere.temperature"]] == -15.0
