"""Quantities with units: conversion of text such as '20 km' to SI and radians.

A unit is a product of symbols with integer powers ('kg m2', 'slug ft2', 'ft/s', '1/s'); '/' divides
by the next symbol. In files a quantity with a dimension needs a unit; on the command line some
options allow a bare number.

Conversion factors are from NIST SP 811 (2008), appendix B. Factors that SP 811 rounds, such as that
of the slug, are computed from exact factors.
"""

import math
import re
from dataclasses import dataclass
from numbers import Real
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from abhv_mc.io.messages import Refusal, describe, found_value, one_of

# decimal number; \d would also match digits of other scripts
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
Exponents = tuple[
    int, int, int, int, int
]  # exponents of metre, kilogram, second, radian and kelvin

_NONE = (0, 0, 0, 0, 0)
_FOOT = 0.3048
_POUND = 0.45359237
_G0 = 9.80665

_UNITS = {  # factor to SI and exponents by symbol
    symbol: (factor, exponents)
    for exponents, symbols in {
        _NONE: {"%": 0.01},
        (1, 0, 0, 0, 0): {
            **dict.fromkeys(("m", "meter", "meters"), 1.0),
            "km": 1e3,
            "cm": 1e-2,
            "mm": 1e-3,
            **dict.fromkeys(("ft", "foot", "feet"), _FOOT),
            "kft": 1e3 * _FOOT,
            "in": _FOOT / 12.0,
            **dict.fromkeys(("nmi", "NM"), 1852.0),
        },
        (0, 1, 0, 0, 0): {"kg": 1.0, "t": 1e3, "lb": _POUND, "slug": _POUND * _G0 / _FOOT},
        (0, 0, 1, 0, 0): {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
        (0, 0, -1, 0, 0): {"Hz": 1.0},
        (0, 0, 0, 1, 0): {
            "rad": 1.0,
            "mrad": 1e-3,
            **dict.fromkeys(("deg", "degree", "degrees"), math.pi / 180.0),
        },
        (1, 0, -1, 0, 0): dict.fromkeys(("kt", "kts", "knot", "knots"), 1852.0 / 3600.0),
        (1, 1, -2, 0, 0): {"N": 1.0, "kN": 1e3, "lbf": _POUND * _G0},
        (-1, 1, -2, 0, 0): {
            "Pa": 1.0,
            "kPa": 1e3,
            **dict.fromkeys(("hPa", "mbar"), 1e2),
            "psi": _POUND * _G0 / (_FOOT / 12.0) ** 2,
        },
        (2, 1, -3, 0, 0): {"W": 1.0, "kW": 1e3, "MW": 1e6},
        (0, 0, 0, 0, 1): {"K": 1.0},
    }.items()
    for symbol, factor in symbols.items()
}
_SPELLINGS = {"°": "deg", "²": "2", "³": "3", "·": " ", "*": " "}

_QUANTITY = re.compile(f"({NUMBER})(.*)", re.DOTALL)
_FACTOR = re.compile(r"\s*(/?)\s*([A-Za-z]+|%)(?:\^?(-?[0-9]{1,2})(?![0-9]))?")


@dataclass(frozen=True)
class Dimension:
    """Physical dimension: name for use in sentences, SI unit, and example."""

    name: str
    unit: str
    example: str
    exponents: Exponents
    largest: float = math.inf  # largest plausible value in SI units

    @property
    def expected(self) -> str:
        """Description of the expected value for error messages."""
        return f"{self.name} such as '{self.example}'"


LENGTH = Dimension("a length", "m", "20 km", (1, 0, 0, 0, 0), 1e8)
AREA = Dimension("an area", "m2", "557.42 m2", (2, 0, 0, 0, 0), 1e6)
SPEED = Dimension("a speed", "m/s", "1400 m/s", (1, 0, -1, 0, 0), 12e3)
ACCELERATION = Dimension("an acceleration", "m/s2", "9.8 m/s2", (1, 0, -2, 0, 0), 1e4)
ANGLE = Dimension("an angle", "rad", "-3 deg", (0, 0, 0, 1, 0), 100.0)
ANGULAR_RATE = Dimension("an angular rate", "rad/s", "400 deg/s", (0, 0, -1, 1, 0), 1e4)
ANGULAR_ACCELERATION = Dimension(
    "an angular acceleration", "rad/s2", "20 deg/s2", (0, 0, -2, 1, 0), 1e6
)
MASS = Dimension("a mass", "kg", "1372 kg", (0, 1, 0, 0, 0), 1e7)
INERTIA = Dimension("a moment of inertia", "kg m2", "1.3e6 kg m2", (2, 1, 0, 0, 0), 1e12)
FORCE = Dimension("a force", "N", "500 kN", (1, 1, -2, 0, 0), 1e9)
PRESSURE = Dimension("a pressure", "Pa", "95 kPa", (-1, 1, -2, 0, 0), 1e9)
HEAT_FLUX = Dimension("a heat flux", "W/m2", "5 MW/m2", (0, 1, -3, 0, 0), 1e12)
DENSITY = Dimension("a density", "kg/m3", "1.225 kg/m3", (-3, 1, 0, 0, 0), 1e3)
TIME = Dimension("a time", "s", "60 s", (0, 0, 1, 0, 0), 1e6)
FREQUENCY = Dimension("a rate", "1/s", "10 Hz", (0, 0, -1, 0, 0), 1e5)
TEMPERATURE = Dimension("a temperature", "K", "300 K", (0, 0, 0, 0, 1), 1e5)
TEMPERATURE_DIFFERENCE = Dimension("a temperature difference", "K", "+15 K", (0, 0, 0, 0, 1), 150.0)
FRACTION = Dimension("a number or a percentage", "-", "10 %", _NONE, 1e6)

DIMENSIONS = (
    LENGTH, AREA, SPEED, ACCELERATION, ANGLE, ANGULAR_RATE, ANGULAR_ACCELERATION, MASS, INERTIA,
    FORCE, PRESSURE, HEAT_FLUX, DENSITY, TIME, FREQUENCY, TEMPERATURE, FRACTION,
)  # fmt: skip
KELVIN = {  # factor and offset from each unit of temperature to K
    **dict.fromkeys(("K", "kelvin"), (1.0, 0.0)),
    **dict.fromkeys(("C", "degC", "°C", "deg C"), (1.0, 273.15)),
    **dict.fromkeys(("F", "degF", "°F", "deg F"), (5.0 / 9.0, 459.67 * 5.0 / 9.0)),
    **dict.fromkeys(("R", "degR", "°R", "deg R"), (5.0 / 9.0, 0.0)),
}
_SI_SYMBOLS = ("m", "kg", "s", "rad", "K")
_BY_EXPONENTS = {dimension.exponents: dimension for dimension in DIMENSIONS}


def parse_unit(text: str) -> tuple[float, Exponents]:
    """Return a unit's factor to SI and its exponents. Raise Refusal for an unknown unit."""
    for spelling, plain in _SPELLINGS.items():
        text = text.replace(spelling, plain)
    text = text.strip().replace("**", "^")
    if text in ("", "-"):
        return 1.0, _NONE
    text = re.sub(r"^1\s*(?=/)", "", text)
    factor, exponents, position = 1.0, _NONE, 0
    while position < len(text):
        match = _FACTOR.match(text, position)
        symbol = match.group(2) if match else text[position:]
        if match is None or symbol not in _UNITS:
            raise Refusal(f"unknown unit '{symbol.strip()}'", one_of(_UNITS, symbol))
        power = int(match.group(3) or 1) * (-1 if match.group(1) else 1)
        scale, base = _UNITS[symbol]
        factor = factor * scale**power if power > 0 else factor / scale**-power
        m, kg, s, rad, kelvin = (e + power * b for e, b in zip(exponents, base, strict=True))
        exponents = m, kg, s, rad, kelvin
        position = match.end()
    return factor, exponents


def check_angle(unit: str) -> None:
    """Raise Refusal if ``unit``, the unit of a circular quantity, is not a unit of angles."""
    if parse_unit(unit)[1] != ANGLE.exponents:
        problem = f"the unit '{unit}' of a circular quantity is not an angle"
        raise Refusal(problem, "the unit deg or rad", ("unit",))


def dimension_of(unit: str) -> Dimension:
    """Return the dimension of a unit. Raise Refusal for an unknown unit."""
    _, exponents = parse_unit(unit)
    return _BY_EXPONENTS.get(
        exponents, Dimension(f"a quantity in {unit}", unit, f"1 {unit}", exponents)
    )


def si_unit_of(unit: str) -> str:
    """Return the SI unit with the dimension of a unit. Raise Refusal for an unknown unit."""
    _, exponents = parse_unit(unit)
    if exponents in _BY_EXPONENTS:
        return _BY_EXPONENTS[exponents].unit
    powers = [
        (power, f"{symbol}{abs(power) if abs(power) > 1 else ''}")
        for symbol, power in zip(_SI_SYMBOLS, exponents, strict=True)
    ]
    above = " ".join(text for power, text in powers if power > 0)
    return (above or "1") + "".join(f"/{text}" for power, text in powers if power < 0)


def parse_quantity(text: str | float, dimension: Dimension, bare_unit: str | None = None) -> float:
    """Convert text to a quantity in SI. Raise Refusal for invalid text.

    A number without a unit is in ``bare_unit``.
    """
    if dimension is FRACTION:
        bare_unit = "-"
    # The number types of numpy are instances of Real.
    is_quantity = isinstance(text, (str, Real)) and not isinstance(text, bool)
    plain = str(text).strip().replace("\N{MINUS SIGN}", "-")
    match = _QUANTITY.fullmatch(plain) if is_quantity else None
    if match is None:
        raise Refusal(found_value(text), dimension.expected)
    number, unit = float(match[1]), match[2].strip() or bare_unit
    if unit is None:
        raise Refusal(f"{found_value(text)} without a unit", dimension.expected)
    try:
        factor, exponents = parse_unit(unit)
    except Refusal as refusal:
        hint = re.search(r"did you mean '.*?'\?", refusal.expected)
        raise Refusal(
            f"{describe(text)} has the {refusal.found}",
            dimension.expected + (f" ({hint[0]})" if hint else ""),
        ) from None
    if exponents != dimension.exponents:
        actual = _BY_EXPONENTS.get(exponents)
        problem = f"{describe(text)} is {actual.name if actual else 'another quantity'}"
        raise Refusal(problem, dimension.expected)
    inverse = 1.0 / factor  # Division by 100 rounds only once; multiplication by 0.01 rounds twice.
    value = number / inverse if inverse.is_integer() else number * factor
    if not math.isfinite(value):
        raise Refusal(found_value(text), f"a finite number ({dimension.expected})")
    return value


def parse_any(text: str | float) -> float:
    """Convert text to a quantity of any dimension in SI. Raise Refusal for invalid text."""
    unit = unit_of(text)
    return parse_quantity(text, dimension_of(unit) if unit else FRACTION)


def unit_of(text: str | float) -> str:
    """Return the unit in a quantity's text, or '' if it is a plain number."""
    match = _QUANTITY.fullmatch(str(text).strip()) if isinstance(text, str) else None
    return match.group(2).strip() if match else ""


def parse_in_unit(value: str | float, unit: str) -> float:
    """Convert a quantity to the SI unit ``unit``. Raise Refusal for another dimension.

    For the unit '-', the value may be a plain number or a percentage.
    """
    return parse_quantity(value, dimension_of(unit))


def parse_in_any_unit(value: str | float, unit: str) -> float:
    """Convert a quantity to ``unit``, which need not be a known unit.

    A plain number is in ``unit``; other units are converted if both units are known. Raise Refusal
    if the conversion is impossible.
    """
    written_unit = unit_of(value)
    if written_unit in ("", unit):
        if isinstance(value, str):
            value = value.strip().removesuffix(written_unit)
        return parse_quantity(value, FRACTION)
    try:
        dimension = dimension_of(unit)
    except Refusal:
        raise Refusal(found_value(value), f"a number in {unit}") from None
    return parse_quantity(value, dimension) / parse_unit(unit)[0]


def format_quantity(value: float, dimension: Dimension) -> str | float:
    """Return a string that :func:`parse_quantity` converts back to the same float.

    A quantity without dimension becomes a plain number.
    """
    return value if dimension is FRACTION else f"{value!r} {dimension.unit}"


def parse_plausible(
    value: str | float, dimension: Dimension, bare_unit: str | None = None
) -> float:
    """Convert text to a quantity in SI. Raise Refusal for invalid text and implausible values."""
    number = parse_quantity(value, dimension, bare_unit)
    if abs(number) > dimension.largest:
        expected = f"{dimension.name} of at most {dimension.largest:g} {dimension.unit}"
        raise Refusal(found_value(value), expected.removesuffix(" -"))
    return number


def _field(dimension: Dimension) -> tuple[object, ...]:
    """Return the parser, the serializer and the JSON schema of a field of pydantic models."""
    is_number = dimension is FRACTION
    text = {"type": "string", "description": dimension.expected, "examples": [dimension.example]}
    text["pattern"] = rf"^\s*{NUMBER}\s*{'' if is_number else '[^0-9]'}"  # a number and any unit
    return (
        BeforeValidator(lambda value: parse_plausible(value, dimension)),
        PlainSerializer(lambda value: format_quantity(value, dimension), when_used="json"),
        WithJsonSchema({"anyOf": [{"type": "number"}, text]} if is_number else text),
    )


# Field types: a string with a unit in files and in model_dump(mode="json"), and a float in SI in
# models. Constraints such as Annotated[Length, Gt(0.0)] are in SI.
Length = Annotated[float, *_field(LENGTH)]
Area = Annotated[float, *_field(AREA)]
Speed = Annotated[float, *_field(SPEED)]
Acceleration = Annotated[float, *_field(ACCELERATION)]
Angle = Annotated[float, *_field(ANGLE)]
AngularRate = Annotated[float, *_field(ANGULAR_RATE)]
Mass = Annotated[float, *_field(MASS)]
Inertia = Annotated[float, *_field(INERTIA)]
Pressure = Annotated[float, *_field(PRESSURE)]
HeatFlux = Annotated[float, *_field(HEAT_FLUX)]
Time = Annotated[float, *_field(TIME)]
Frequency = Annotated[float, *_field(FREQUENCY)]
Fraction = Annotated[float, *_field(FRACTION)]
