"""Quantities of parameters in campaign files."""

import pytest

from abhv_mc.flights.parameters import Parameter

CASES = [
    # unit, nominal value, whether it is the user's, factor, suffix, text, value
    ("-", 1.0, False, True, "", "5 %", 0.05),
    ("m", 1.0, False, True, " m", "2 km", 2000.0),
    ("m", 1.0, True, False, "", "5 %", 0.05),
    ("m", -40.0, True, False, "", "5 %", 2.0),
    ("%", 40.0, True, False, "", "5 %", 5.0),
    ("ft", 0.0, True, False, "", "3.048 m", 10.0),
]


@pytest.mark.parametrize("case", CASES)
def test_quantities_are_read_in_the_unit_of_the_parameter(case):
    unit, nominal, of_user, is_factor, suffix, text, value = case
    parameter = Parameter("x", unit, nominal, "", of_user)
    assert (parameter.is_factor, parameter.unit_suffix) == (is_factor, suffix)
    assert parameter.read(text, of_nominal=True) == pytest.approx(value)
