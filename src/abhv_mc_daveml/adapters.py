"""Adapters from an imported model to coefficients, thrust and control laws in SI units."""

import math
import re
from collections.abc import Collection, Mapping

from abhv_mc.io.messages import InputError, Refusal
from abhv_mc.io.units import parse_unit
from abhv_mc_daveml.formulas import MODEL
from abhv_mc_daveml.graph import Model, Variable, parse_s119_unit
from abhv_mc_daveml.signals import SI, find_signals, kinds_of, quantity_of, sign_of
from abhv_mc_vehicle.user_code.law_interface import Air, Measured, Thrust
from abhv_mc_vehicle.user_code.module_text import Line, call, declare, define, names_in, number

# number in the units of the file, sum of signals of abhv-mc, or None if there is no answer yet
Answer = float | str | None

_AIR = {name: f"air.{name}" for name in Air._fields}
_RATES = {
    "roll_rate": "rates.roll_rate * 2.0 * air.airspeed / SPAN",
    "pitch_rate": "rates.pitch_rate * 2.0 * air.airspeed / CHORD",
    "yaw_rate": "rates.yaw_rate * 2.0 * air.airspeed / SPAN",
}
_CONTROLS = {name: f"controls.{name}" for name in ("aileron", "rudder", "elevator", "throttle")}
_MEASURED = {
    name: f"measured.{name}"
    for name in Measured._fields
    if name in SI and name != "cross_track"  # S-119 signals; the track is a command.
}
SOURCES: dict[str, dict[str, str]] = {
    "aerodynamics": {**_AIR, **_RATES, **_CONTROLS},
    "propulsion": {**_AIR, "throttle": "throttle"},
    "inertia": {},
    "atmosphere": {"altitude": _AIR["altitude"]},
    "control": _MEASURED,
}
_TERM = re.compile(
    r"\s*([+-]?)\s*(?:([0-9]+\.?[0-9]*|\.[0-9]+)\s*\*?\s*)?([A-Za-z_]\w*)\s*", re.ASCII
)
MEASURED = "_measured"  # suffix of the commands that determine whether a measured value is used
FORCES = {"body": ("CX", "CY", "CZ"), "stability": ("CL", "CD", "CY")}
MOMENTS = ("Cl", "Cm", "Cn")


def find_questions(model: Model) -> list[Variable]:
    """Return the inputs, other than commands, that no signal of abhv-mc supplies."""
    kinds = kinds_of(model)
    if not kinds or "control" in kinds:
        return []
    supplied = {name for kind in kinds for name in SOURCES[kind]}
    return [
        v
        for v in model.inputs
        if (quantity := quantity_of(v)) not in supplied or sign_of(quantity, v) is None
    ]


def parse_answer(
    model: Model, variable: Variable, answer: str, effectors: Collection[str]
) -> list[tuple[float, str]]:
    """Parse a sum such as 'elevator + aileron' or '-0.5 rudder' into factors and names.

    Raise Refusal if the answer is invalid.
    """
    names = {name for kind in kinds_of(model) for name in SOURCES[kind]} | set(effectors)
    example = "a number, or a sum such as 'elevator + aileron' of"
    terms: list[tuple[float, str]] = []
    end = 0
    for match in _TERM.finditer(answer):
        sign, number_text, name = match.groups()
        if match.start() != end or (terms and not sign) or name not in names:
            break
        terms.append(((-1.0 if sign == "-" else 1.0) * float(number_text or 1.0), name))
        end = match.end()
    if end < len(answer) or not terms:
        raise Refusal(f"found '{answer}'", f"{example} {', '.join(sorted(names))}")
    for _, name in terms:
        _factor_of(model, variable, name)
    return terms


def _factor_of(model: Model, variable: Variable, name: str) -> float:
    return factor_to_si(
        model, variable, name if name in SI else "aileron"
    )  # Effector deflections are angles.


def factor_to_si(model: Model, variable: Variable, quantity: str) -> float:
    """Return the factor from a variable's unit to SI. Raise InputError for a wrong dimension."""
    try:
        factor, exponents = parse_s119_unit(variable.units)
    except Refusal as refusal:
        raise InputError(
            model.path, refusal.found, f"a unit of {quantity}", variable.line
        ) from None
    if exponents != parse_unit(SI[quantity])[1]:
        raise InputError(
            model.path,
            f"'{variable.identifier}', the {quantity}, has the unit '{variable.units}'",
            f"a unit such as {SI[quantity]}",
            variable.line,
        )
    return factor


def _scaled(value: str, factor: float, operation: str) -> str:
    value, factor = (f"-{value}", -factor) if factor < 0.0 else (value, factor)
    if factor == 1.0:
        return value
    return f"{value} {operation} {'DEGREE' if factor == math.pi / 180.0 else number(factor)}"


def _call(
    model: Model, kind: str, answers: Mapping[str, Answer], effectors: Collection[str] = ()
) -> Line:
    """Return the source line that calls the model with the signals of abhv-mc."""
    arguments = {}
    sources = SOURCES[kind] | {name: f"controls.{name}" for name in effectors}
    for variable in model.inputs:
        key = variable.key
        answer = answers.get(variable.identifier)
        if isinstance(answer, float | int):
            arguments[key] = number(answer)
            continue
        quantity = quantity_of(variable)
        if isinstance(answer, str):
            terms = parse_answer(model, variable, answer, effectors)
            if any(name not in sources for _, name in terms):
                continue
            total = " + ".join(_scaled(sources[name], factor, "*") for factor, name in terms)
            value = f"({total.replace('+ -', '- ')})" if len(terms) > 1 else total
            arguments[key] = _scaled(value, _factor_of(model, variable, terms[0][1]), "/")
        elif quantity in sources:
            sign = sign_of(quantity, variable) or 1
            arguments[key] = _scaled(
                sources[quantity], sign * factor_to_si(model, variable, quantity), "/"
            )
        elif kind == "control":
            command = f"commands.{key}"
            # The cross-track error is positive to the right of the commanded track.
            if quantity == "cross_track":
                command = f"({command} - {command}{MEASURED} * measured.cross_track)"
            arguments[key] = _scaled(command, command_unit(variable)[1], "/")
    return Line(f"out = {call(MODEL, (f'{key}={value}' for key, value in arguments.items()))}")


def signed_factor(model: Model, variable: Variable, quantity: str) -> float:
    """Return the factor that converts an output to the unit and sign convention of abhv-mc."""
    sign = sign_of(quantity, variable)
    if sign is None and variable.sign:
        raise InputError(
            model.path,
            f"'{variable.identifier}', the {quantity}, has the sign '{variable.sign}'",
            "a sign convention of S-119",
            variable.line,
        )
    return (sign or 1) * factor_to_si(model, variable, quantity)


def _return(kind: str, model: Model, expected: tuple[str, ...]) -> Line:
    """Return the source line that returns a record of the model's outputs in SI units.

    Outputs that are always zero are omitted.
    """
    outputs = find_signals(model.outputs)
    fields = []
    for quantity in expected:
        variable = outputs.get(quantity)
        if variable is None or (not variable.computed and variable.initial == 0.0):
            continue
        factor = signed_factor(model, variable, quantity)
        fields.append(f"{quantity}={_scaled(f'out.{variable.key}', factor, '*')}")
    return Line(f"return {call(kind, fields)}")


def write_coefficients(
    model: Model,
    answers: Mapping[str, Answer],
    lengths: Mapping[str, float],
    effectors: Collection[str],
) -> list[Line]:
    """Return a coefficient function for the section ``aerodynamics`` of a vehicle file.

    ``lengths`` are the reference lengths SPAN and CHORD of the reduced rates.
    """
    frame = frame_of(model)
    called = _call(model, "aerodynamics", answers, effectors)
    about = f"Coefficients in {frame} axes about the moment reference of the file."
    body = [called, _return("Coefficients", model, (*FORCES[frame], *MOMENTS))]
    used = [
        Line(f"{key} = {number(lengths[key])}", "reference length of the reduced rates, m")
        for key in lengths
        if key in names_in([called])
    ]
    return [*used, *define("def coefficients(air, controls, rates, settings):", about, body)]


def frame_of(model: Model) -> str:
    """Return the axes of the forces. Raise InputError if no set of forces is complete."""
    outputs = find_signals(model.outputs)
    for frame, forces in FORCES.items():
        if any(name in outputs for name in forces if name != "CY"):
            return frame
    raise InputError(
        model.path, "the model has no force coefficients", "CX, CY, CZ or lift and drag"
    )


def write_thrust(model: Model, answers: Mapping[str, Answer]) -> list[Line]:
    """Return a thrust function for the section ``propulsion`` of a vehicle file."""
    body = [_call(model, "propulsion", answers), _return("Thrust", model, Thrust._fields)]
    return define(
        "def thrust(air, throttle, settings):", "Thrust in body axes at the moment reference.", body
    )


def command_inputs(model: Model) -> list[Variable]:
    """Return the inputs of a control law that are commands, not measurements."""
    return [variable for variable in model.inputs if quantity_of(variable) not in _MEASURED]


def command_unit(variable: Variable) -> tuple[str, float]:
    """Return the SI unit of a command (``-`` if dimensionless) and the factor to SI."""
    try:
        factor, exponents = parse_s119_unit(variable.units)
    except Refusal:
        return "-", 1.0
    matches = (
        unit for unit in ("m", "m/s", "rad", "rad/s", "kg", "s") if parse_unit(unit)[1] == exponents
    )
    return next(matches, "-"), factor


def write_law(model: Model, answers: Mapping[str, Answer]) -> list[Line]:
    """Return a control law, with its commands as a class ``Commands`` in SI units."""
    fields = []
    units = {}
    for variable in command_inputs(model):
        key = variable.key
        unit, factor = command_unit(variable)
        about = variable.name if unit == "-" else f"{variable.name}, {unit}"
        fields.append(declare(key, about, (variable.initial or 0.0) * factor))
        if quantity_of(variable) == "cross_track":
            about = "1: relative to the measured cross-track error, 0: as commanded"
            fields.append(declare(f"{key}{MEASURED}", about, 1.0))
        if unit != "-":
            units[key] = unit
    body = [
        _call(model, "control", answers),
        _return("Command", model, ("aileron", "rudder", "elevator", "throttle")),
    ]
    head = f"def law({'measured, commands' if fields else 'measured'}):"
    law = define(head, "Deflections and throttle from the measured motion.", body)
    about = "Commands of the pilot and the autopilot, SI and radians."
    commands = define("class Commands(NamedTuple):", about, fields) if fields else []
    return [*commands, Line(f"@controller(units={units!r})" if units else "@controller"), *law]
