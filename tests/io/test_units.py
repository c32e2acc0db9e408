"""Quantities to SI; exact factors from NIST SP 811 (2008), appendix B.8."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.io import units
from abhv_mc.io.messages import Refusal
from abhv_mc.io.units import (
    DIMENSIONS,
    format_quantity,
    parse_any,
    parse_in_any_unit,
    parse_in_unit,
    parse_plausible,
    parse_quantity,
    si_unit_of,
)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("30000 ft", units.LENGTH, 9144.0),
        ("557.42 m^2", units.AREA, 557.42),
        ("1400 m/s", units.SPEED, 1400.0),
        ("9 km/h", units.SPEED, 2.5),
        ("2 feet/s", units.SPEED, 0.6096),
        ("3 meters", units.LENGTH, 3.0),
        ("30 kft", units.LENGTH, 9144.0),
        ("2 NM", units.LENGTH, 3704.0),
        ("180 degrees", units.ANGLE, math.pi),
        ("-3 deg", units.ANGLE, math.radians(-3)),
        ("−3°", units.ANGLE, math.radians(-3)),
        ("400 deg/s", units.ANGULAR_RATE, math.radians(400)),
        ("1 slug", units.MASS, 14.593902937206364),  # SP 811: 1.459390 E+01
        ("1 slug ft2", units.INERTIA, 1.3558179483314004),  # SP 811: lbf ft s2, 1.355818
        ("1 slug/ft3", units.DENSITY, 515.3788183931961),  # SP 811: 5.153788 E+02
        ("1 lbf", units.FORCE, 4.4482216152605),  # SP 811, exact
        ("1 min", units.TIME, 60.0),
        ("10 Hz", units.FREQUENCY, 10.0),
        ("0.005 1/s", units.FREQUENCY, 0.005),
        ("-15 K", units.TEMPERATURE, -15.0),
        ("10 %", units.FRACTION, 0.1),
        (0.25, units.FRACTION, 0.25),
    ],
)
def test_quantity(text, dimension, value):
    assert parse_quantity(text, dimension) == pytest.approx(value, rel=2e-16, abs=0.0)


@pytest.mark.parametrize(
    ("text", "dimension", "problem"),
    [
        ("20", units.LENGTH, "'20'"),
        ("20 kg", units.LENGTH, "a mass"),
        ("50 Hz", units.ANGULAR_RATE, "a rate"),
        ("20,5 km", units.LENGTH, "unknown unit"),
        ("1e400 m", units.LENGTH, "'1e400 m'"),
        (True, units.FRACTION, "true"),
        (None, units.FRACTION, "nothing"),
        ("20 / km", units.LENGTH, "another quantity"),
        ("٢٠ km", units.LENGTH, "'٢٠ km'"),
    ],
)
def test_refused(text, dimension, problem):
    with pytest.raises(Refusal) as caught:
        parse_quantity(text, dimension)
    assert problem in caught.value.found
    assert dimension.expected in caught.value.expected


def test_a_bare_number_has_the_default_unit_and_a_misspelt_one_is_guessed():
    assert parse_quantity("30", units.ANGLE, bare_unit="deg") == math.radians(30)
    assert parse_quantity("20 km", units.LENGTH, bare_unit="m") == 20_000.0
    with pytest.raises(Refusal, match="'deg'"):
        parse_quantity("3 degs", units.ANGLE)


def test_in_a_parameter_unit():
    assert parse_in_unit("10 %", "-") == 0.1
    assert parse_in_unit(0.1, "-") == 0.1
    assert parse_in_unit("100 ft", "m") == 30.48
    assert parse_in_unit("5 m/s/km", "1/s") == 0.005  # wind shear
    assert parse_in_unit("2 m/s2", "m/s2") == 2.0
    for value, unit in (("10 %", "m"), (5.0, "m"), ("1 deg", "-"), ("1 deg", "rad/s")):
        with pytest.raises(Refusal):
            parse_in_unit(value, unit)


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        (2.5, "furlong", 2.5),
        (" 2.5 furlong ", "furlong", 2.5),
        ("2.5", "km", 2.5),
        ("2500 m", "km", 2.5),
        ("1 ft", "in", 12.0),
        ("50 %", "-", 0.5),
    ],
)
def test_in_any_unit(value, unit, number):
    assert parse_in_any_unit(value, unit) == pytest.approx(number, rel=4e-16)


def test_what_has_no_place_in_a_unit_is_refused():
    for value, unit in (("2 m", "furlong"), ("2 furlong", "m"), ("2 kg", "m")):
        with pytest.raises(Refusal):
            parse_in_any_unit(value, unit)
    for text, is_refused in (("150 K", False), ("-151 K", True)):
        with pytest.raises(Refusal) if is_refused else contextlib.nullcontext():
            assert parse_plausible(text, units.TEMPERATURE_DIFFERENCE) == 150.0
    units.check_angle("mrad")
    with pytest.raises(Refusal):
        units.check_angle("rad/s")


def test_units_in_si():
    words = {"kft": "m", "lbf": "N", "ft2/slug": "m2/kg", "1/kft/ms2": "1/m/s2"}
    assert {unit: si_unit_of(unit) for unit in words} == words
    assert [parse_any(text) for text in ("2 min", "0.25", "5 %", 3)] == [120.0, 0.25, 0.05, 3.0]
    more = {
        **{"1 psi": 6894.757293168361, "1 mbar": 100.0, "1 kt": 1852.0 / 3600.0, "1 in": 0.0254},
        **{"2 h": 7200.0, "5 kW": 5e3, "5 MW/m2": 5e6, "1 t": 1e3, "1 kN": 1e3},
    }
    assert [parse_any(text) for text in more] == pytest.approx([*more.values()], rel=1e-14)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(DIMENSIONS))
def test_written_quantity_reads_back_to_the_same_bits(value, dimension):
    restored = parse_quantity(format_quantity(value, dimension), dimension)
    assert (restored, math.copysign(1, restored)) == (value, math.copysign(1, value))


@given(st.text(max_size=30), st.sampled_from(DIMENSIONS))
def test_any_text_is_a_quantity_or_refused(text, dimension):
    with contextlib.suppress(Refusal):
        assert math.isfinite(parse_quantity(text, dimension))
