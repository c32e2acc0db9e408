"""Functions that connect a written model to the program: coefficients, thrust and a control law in SI and radians."""

from collections.abc import Mapping
from dataclasses import dataclass

from abhv_mc.daveml.model import Model, Variable
from abhv_mc.daveml.s119_units import describe_factor, parse_s119_unit
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


def _scaled(text: str, factor: float, *, divided: bool) -> str:
    if factor == 1.0:
        return text
    if factor == -1.0:
        return f"-{text}" if text.replace(".", "").replace("_", "").isalnum() else f"-({text})"
    sign, size = ("-", -factor) if factor < 0.0 else ("", factor)
    return f"{sign}{text} {'/' if divided else '*'} {describe_factor(size)}"


def _inputs(model: Model, kind: str, answers: Mapping[str, Answer]) -> str:
    """The arguments of a call of the model, one a line."""
    names, lines = python_names(model), []
    sources = SOURCES[kind]
    for variable in model.inputs:
        answer = answers.get(variable.identifier)
        if isinstance(answer, float | int):
            lines.append(f"        {names[variable.identifier]}={float(answer)!r},")
            continue
        quantity = quantity_of(variable)
        sign = 1 if quantity is None else sign_of(quantity, variable)
        if isinstance(answer, str):
            quantity, sign = answer.removeprefix("-"), -1 if answer.startswith("-") else 1
        if quantity in sources:
            factor = (sign or 1) * factor_to_si(model, variable, quantity)
            text = _scaled(sources[quantity], factor, divided=True)
        elif kind == "control" and quantity == "cross_track":  # there to the right, and from where it is wanted
            name = names[variable.identifier]
            offset = f"commands.{name} - commands.{name}{MEASURED} * measured.cross_track"
            text = f"({offset}) / {_command_factor(variable)!r}"
        elif kind == "control":
            text = _scaled(f"commands.{names[variable.identifier]}", _command_factor(variable), divided=True)
        else:
            continue  # its own value holds
        lines.append(f"        {names[variable.identifier]}={text},")
    return "\n".join(lines)


def _call(model: Model, kind: str, answers: Mapping[str, Answer]) -> str:
    given = _inputs(model, kind, answers)
    return f"    out = {MODEL}(\n{given}\n    )" if given else f"    out = {MODEL}()"


def _outputs(model: Model, expected: tuple[str, ...]) -> list[str]:
    """``name=value`` in SI for each quantity that the model gives; what is zero for good is left out."""
    names, outputs, found = python_names(model), find_signals(model.outputs), []
    for quantity in expected:
        variable = outputs.get(quantity)
        if variable is None or (not variable.computed and variable.initial == 0.0):
            continue
        factor = (sign_of(quantity, variable) or 1) * factor_to_si(model, variable, quantity)
        found.append(f"{quantity}={_scaled(f'out.{names[variable.identifier]}', factor, divided=False)}")
    return found


def write_coefficients(model: Model, answers: Mapping[str, Answer], span: float, chord: float) -> str:
    """The function that the vehicle file names under ``aerodynamics``."""
    frame = frame_of(model)
    given = ",\n        ".join(_outputs(model, (*FORCES[frame], *MOMENTS)))
    call = _call(model, "aerodynamics", answers)
    lengths = "".join(
        f"{name} = {value!r}  # m, of the reduced rates\n"
        for name, value in (("SPAN", span), ("CHORD", chord))
        if name in call
    )
    return (
        (f"{lengths}\n\n" if lengths else "")
        + "def coefficients(air, controls, rates, settings):\n"
        + f'    """Coefficients in {frame} axes about the moment reference of the file."""\n'
        + f"{call}\n    return Coefficients(\n        {given},\n    )\n"
    )


def frame_of(model: Model) -> str:
    """Axes in which a file gives its forces. Raises InputError where neither set is whole."""
    outputs = find_signals(model.outputs)
    for frame, forces in FORCES.items():
        if any(name in outputs for name in forces if name != "CY"):
            return frame
    raise InputError(model.path, "no force coefficients", "CX, CY, CZ or lift and drag")


def write_thrust(model: Model, answers: Mapping[str, Answer]) -> str:
    """The function that the vehicle file names under ``propulsion``."""
    given = ", ".join(_outputs(model, THRUST))
    return (
        'def thrust(air, throttle, settings):\n    """Thrust in body axes at the moment reference."""\n'
        f"{_call(model, 'propulsion', answers)}\n    return Thrust({given})\n"
    )


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


def write_law(model: Model, answers: Mapping[str, Answer]) -> str:
    """The control law, its commands as the class ``Commands`` in SI."""
    names = python_names(model)
    fields, units = [], []
    for variable in command_inputs(model):
        name, unit = names[variable.identifier], command_unit(variable)
        value = (variable.initial or 0.0) * _command_factor(variable)
        fields.append(f"    {name}: float = {value!r}  # {variable.name}{'' if unit == '-' else f', {unit}'}")
        if quantity_of(variable) == "cross_track":
            fields.append(
                f"    {name}{MEASURED}: float = 1.0  # 1: from the measured cross-track, 0: as commanded alone"
            )
        if unit != "-":
            units.append(f'"{name}": "{unit}"')
    marked = f"@controller(units={{{', '.join(units)}}})" if units else "@controller"
    if len(marked) > 110:
        marked = "@controller(\n    units={\n" + "".join(f"        {unit},\n" for unit in units) + "    }\n)"
    head = "class Commands(NamedTuple):\n" + '    """What the pilot and the autopilot are told, SI and radians."""\n\n'
    given = ",\n        ".join(_outputs(model, ("aileron", "rudder", "elevator", "throttle")))
    arguments = "measured, commands" if fields else "measured"
    return (
        (head + "\n".join(fields) + "\n\n\n" if fields else "")
        + f'{marked}\ndef law({arguments}):\n    """Deflections and throttle from the measured motion."""\n'
        + f"{_call(model, 'control', answers)}\n    return Command(\n        {given},\n    )\n"
    )
