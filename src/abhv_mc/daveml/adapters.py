"""Functions that connect a written model to the program: coefficients, thrust and a control law in SI and radians."""

import ast
import math
from collections.abc import Mapping
from dataclasses import dataclass

from abhv_mc.daveml import python_nodes as py
from abhv_mc.daveml.graph import Model, Variable
from abhv_mc.daveml.s119_units import parse_s119_unit
from abhv_mc.daveml.signals import SI, find_signals, quantity_of, sign_of
from abhv_mc.daveml.writer import MODEL, python_names
from abhv_mc.io.input_error import InputError, Refusal
from abhv_mc.io.units import parse_unit

Answer = float | str | None  # a number in the file's units, a quantity of the program, or nothing yet

_AIR = {
    name: f"air.{name}"
    for name in ("altitude", "mach", "density", "pressure", "sound_speed", "dynamic_pressure", "airspeed", "sideslip",
                 "angle_of_attack")
}  # fmt: skip
_RATES = {
    "roll_rate": "rates.roll_rate * 2.0 * air.airspeed / SPAN",
    "pitch_rate": "rates.pitch_rate * 2.0 * air.airspeed / CHORD",
    "yaw_rate": "rates.yaw_rate * 2.0 * air.airspeed / SPAN",
}
_CONTROLS = {name: f"controls.{name}" for name in ("aileron", "rudder", "elevator", "throttle")}
_MEASURED = {
    name: f"measured.{name}"
    for name in ("altitude", "airspeed", "equivalent_airspeed", "mach", "angle_of_attack", "sideslip", "roll", "pitch",
                 "yaw", "roll_rate", "pitch_rate", "yaw_rate", "latitude", "longitude")
}  # fmt: skip
SOURCES: dict[str, dict[str, str]] = {
    "aerodynamics": {**_AIR, **_RATES, **_CONTROLS},
    "propulsion": {**_AIR, "throttle": "throttle"},
    "inertia": {},
    "control": _MEASURED,
}
MEASURED = "_measured"  # a command that says whether the measured value counts
FORCES = {"body": ("CX", "CY", "CZ"), "stability": ("CL", "CD", "CY")}
MOMENTS = ("Cl", "Cm", "Cn")
THRUST = ("force_x", "force_y", "force_z", "fuel_flow", "moment_x", "moment_y", "moment_z")


@dataclass(frozen=True)
class Question:
    """An input whose value the program cannot know."""

    variable: Variable
    value: Answer  # the file's own value, where it has one


def find_questions(model: Model, kinds: tuple[str, ...]) -> list[Question]:
    """Inputs that no signal of the program gives. What a control law lacks are its commands."""
    if "control" in kinds:
        return []
    sources = {name: text for kind in kinds for name, text in SOURCES[kind].items()}
    found = []
    for variable in model.inputs:
        quantity = quantity_of(variable)
        if quantity not in sources or sign_of(quantity, variable) is None:
            found.append(Question(variable, variable.initial))
    return found


def factor_to_si(model: Model, variable: Variable, quantity: str) -> float:
    """Factor from a variable's units to those of a quantity. Raises InputError for a unit that does not fit."""
    try:
        factor, exponents = parse_s119_unit(variable.units)
    except Refusal as refusal:
        raise InputError(model.path, refusal.found, f"a unit of {quantity}", variable.line) from None
    if exponents != parse_unit(SI[quantity])[1]:
        found = f"'{variable.identifier}', the {quantity}, in '{variable.units}'"
        raise InputError(model.path, found, f"a unit such as {SI[quantity]}", variable.line)
    return factor


def _scaled(value: ast.expr, factor: float, operation: str) -> ast.expr:
    if factor < 0.0:
        value, factor = py.fill("-a", a=value), -factor
    if factor == 1.0:
        return value
    return py.fill(f"a {operation} b", a=value, b=py.name("DEGREE") if factor == math.pi / 180.0 else py.number(factor))


def _call(model: Model, kind: str, answers: Mapping[str, Answer]) -> py.Line:
    """The line that calls the model with what the program gives."""
    names, given, sources = python_names(model), {}, SOURCES[kind]
    for variable in model.inputs:
        key, answer = names[variable.identifier], answers.get(variable.identifier)
        if isinstance(answer, float | int):
            given[key] = py.number(float(answer))
            continue
        quantity = quantity_of(variable)
        sign = 1 if quantity is None else sign_of(quantity, variable)
        if isinstance(answer, str):
            quantity, sign = answer.removeprefix("-"), -1 if answer.startswith("-") else 1
        if quantity in sources:
            factor = (sign or 1) * factor_to_si(model, variable, quantity)
            given[key] = _scaled(py.fill(sources[quantity]), factor, "/")
        elif kind == "control":
            command = py.member("commands", key)
            if quantity == "cross_track":  # there to the right, and from where it is wanted
                measured = py.member("commands", f"{key}{MEASURED}")
                command = py.fill("command - measures * measured.cross_track", command=command, measures=measured)
            given[key] = _scaled(command, _command_factor(variable), "/")
    return py.assign("out", py.call(MODEL, **given))


def _return(kind: str, model: Model, expected: tuple[str, ...]) -> py.Line:
    """A value of this kind, in SI, of the quantities that the model gives; what is zero for good is left out."""
    names, outputs, given = python_names(model), find_signals(model.outputs), {}
    for quantity in expected:
        variable = outputs.get(quantity)
        if variable is None or (not variable.computed and variable.initial == 0.0):
            continue
        factor = (sign_of(quantity, variable) or 1) * factor_to_si(model, variable, quantity)
        given[quantity] = _scaled(py.member("out", names[variable.identifier]), factor, "*")
    return py.Line(ast.Return(py.call(kind, **given)))


def write_coefficients(
    model: Model, answers: Mapping[str, Answer], span: float, chord: float
) -> list[py.Line | py.Block]:
    """The function that the vehicle file names under ``aerodynamics``."""
    frame = frame_of(model)
    called = _call(model, "aerodynamics", answers)
    about = f"Coefficients in {frame} axes about the moment reference of the file."
    body = [called, _return("Coefficients", model, (*FORCES[frame], *MOMENTS))]
    lengths = (("SPAN", span), ("CHORD", chord))
    read = set(py.names_in([called]))
    used = [py.assign(key, py.number(value), "m, of the reduced rates") for key, value in lengths if key in read]
    return [*used, py.define("def coefficients(air, controls, rates, settings):", about, body)]


def frame_of(model: Model) -> str:
    """Axes in which a file gives its forces. Raises InputError where neither set is whole."""
    outputs = find_signals(model.outputs)
    for frame, forces in FORCES.items():
        if any(name in outputs for name in forces if name != "CY"):
            return frame
    raise InputError(model.path, "no force coefficients", "CX, CY, CZ or lift and drag")


def write_thrust(model: Model, answers: Mapping[str, Answer]) -> py.Block:
    """The function that the vehicle file names under ``propulsion``."""
    body = [_call(model, "propulsion", answers), _return("Thrust", model, THRUST)]
    return py.define("def thrust(air, throttle, settings):", "Thrust in body axes at the moment reference.", body)


def _command_factor(variable: Variable) -> float:
    try:
        return parse_s119_unit(variable.units)[0]
    except Refusal:
        return 1.0


def command_inputs(model: Model) -> list[Variable]:
    """Inputs of a control law that no measurement gives."""
    return [variable for variable in model.inputs if quantity_of(variable) not in _MEASURED]


def command_unit(variable: Variable) -> str:
    """The SI unit of a command, ``-`` for a plain number."""
    try:
        _, exponents = parse_s119_unit(variable.units)
    except Refusal:
        return "-"
    return next((unit for unit in ("m", "m/s", "rad", "rad/s", "kg", "s") if parse_unit(unit)[1] == exponents), "-")


def write_law(model: Model, answers: Mapping[str, Answer]) -> list[py.Block]:
    """The control law, its commands as the class ``Commands`` in SI."""
    names = python_names(model)
    fields, units = [], {}
    for variable in command_inputs(model):
        key, unit = names[variable.identifier], command_unit(variable)
        value = (variable.initial or 0.0) * _command_factor(variable)
        fields.append(py.declare(key, variable.name if unit == "-" else f"{variable.name}, {unit}", value))
        if quantity_of(variable) == "cross_track":
            fields.append(
                py.declare(f"{key}{MEASURED}", "1: from the measured cross-track, 0: as commanded alone", 1.0)
            )
        if unit != "-":
            units[key] = unit
    body = [_call(model, "control", answers), _return("Command", model, ("aileron", "rudder", "elevator", "throttle"))]
    arguments = "measured, commands" if fields else "measured"
    law = py.define(f"def law({arguments}):", "Deflections and throttle from the measured motion.", body)
    given = ast.Dict(list(map(ast.Constant, units)), list(map(ast.Constant, units.values())))
    law.head.decorator_list = [py.call("controller", units=given) if units else py.name("controller")]
    commands = py.define(
        "class Commands(NamedTuple):", "What the pilot and the autopilot are told, SI and radians.", fields
    )
    return [commands, law] if fields else [law]
