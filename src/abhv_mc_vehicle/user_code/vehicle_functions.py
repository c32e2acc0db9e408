"""Loading, compilation and evaluation of custom vehicle functions."""

import ast
import ctypes
import functools
from collections import namedtuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder
from abhv_mc.io.input_files import made_once
from abhv_mc.io.messages import InputError, Refusal, counted, one_of
from abhv_mc.io.units import parse_in_unit
from abhv_mc_vehicle.kernel.numerics.lane_math import sincos
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.foreign import NOMINAL
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros, variable_row
from abhv_mc_vehicle.kernel.plant.vehicle import (
    AXES,
    COEFFICIENTS,
    PARAMETER_INDEX,
    VARIABLES,
    Foreign,
    Vehicle,
)
from abhv_mc_vehicle.plant.effectiveness import count_rows
from abhv_mc_vehicle.user_code.compiled import build, compiled_names, lane_of, loop_text, tuple_text
from abhv_mc_vehicle.user_code.law_interface import Air, Effect, Measured, Motion, Rates, Sensed
from abhv_mc_vehicle.user_code.load_law import (
    check_fields,
    check_functions,
    check_returns,
    is_number,
)
from abhv_mc_vehicle.user_code.module import DYNAMICS, Module, refuse_in_words, run_module
from abhv_mc_vehicle.vehicle.file import pack_vehicle, read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import (
    N_THRUST,
    FunctionCode,
    VehicleCode,
    evaluate_functions,
    register,
)

WIDTH = 32  # number of points evaluated per call, except in flights
WANTED = "code with only floats, named tuples and functions of them"
_ARGUMENTS = {
    "aerodynamics": ("air", "controls", "rates", "settings"),
    "propulsion": ("air", "throttle", "controls", "rates", "settings"),
    "dynamics": ("states", "motion", "air", "controls", "settings"),
}
_RETURNED = {"aerodynamics": "Coefficients", "propulsion": "Thrust", "dynamics": "Effect"}


class Functions(NamedTuple):
    """Compiled functions of a vehicle; None for functions that are not defined."""

    aerodynamics: Any
    propulsion: Any
    dynamics: Any


@made_once
def load_vehicle(path: str | Path) -> Vehicle:
    """Read and pack a vehicle file, and load its functions if they are trusted.

    Raise :class:`abhv_mc.io.documents.InputError` if the vehicle is invalid.
    """
    file = read_vehicle_file(path)
    vehicle = pack_vehicle(file, PARAMETER_INDEX)
    rows = count_rows(vehicle)
    axes = vehicle.tables.axis_variable.size
    if rows > s.MAX_TABLE_ROWS:
        raise InputError(
            file.path,
            f"the tables fill {counted(rows, 'row')} (eight tables on equal axes share a row; "
            "derivatives with respect to deflections also count)",
            f"at most {s.MAX_TABLE_ROWS}",
        )
    if axes > s.MAX_AXES:
        raise InputError(
            file.path, f"the tables use {axes} different grids", f"at most {s.MAX_AXES}"
        )
    if file.code is None:
        return vehicle
    check_vehicle_trusted(path)
    return vehicle._replace(foreign=load_functions(file.code, vehicle))


def check_vehicle_trusted(path: str | Path, trusted: bool = False) -> None:
    """Raise InputError if a vehicle in a results folder has untrusted functions."""
    code = read_vehicle_file(path).code
    for function in code.functions() if code else ():
        if is_in_a_folder(Path(function.file)):
            check_trusted(UserSource(function.text, function.file), trusted)


_codes: dict[bytes, VehicleCode] = {}


def find_code(vehicle: Vehicle) -> VehicleCode | None:
    """Return the custom code of a loaded vehicle, or None if it has only tables."""
    return _codes.get(vehicle.foreign.digest.tobytes())


def load_functions(code: VehicleCode, vehicle: Vehicle) -> Foreign:
    """Compile a vehicle's functions, register them in this process and return their record."""
    functions = compile_functions(code, WIDTH)
    _codes[code.digest] = code
    register(code.digest, functools.partial(_evaluate, functions, vehicle.foreign.settings))
    return vehicle.foreign


@functools.lru_cache(maxsize=16)
def compile_functions(code: VehicleCode, width: int) -> Functions:
    """Compile the functions of a vehicle to loops over ``width`` lanes.

    If the code does not compile, raise InputError with the line in the user's file.
    """
    loops = dict.fromkeys(_ARGUMENTS)
    first = 0  # index of the function's first setting in the list of all settings
    for key, function_code in code.named_functions():
        if function_code is None:
            continue
        source = UserSource(function_code.text, function_code.file)
        module = run_module(source)
        with refuse_in_words(source, "the function of the vehicle", WANTED):
            function = function_code.function or _find_marked(module)
            if function not in module.texts:
                raise InputError(
                    source.file,
                    f"the file has no function '{function}'",
                    one_of(module.texts, function),
                )
            arguments = module.check_arguments(function, _ARGUMENTS[key])
            check_functions(module, function)
            check_returns(module, function, _is_constant, f"return {_RETURNED[key]}(...)")
            kinds: dict[str, Any] = {"air": Air, "rates": Rates, "controls": _controls(code)}
            if key == "dynamics":
                kinds["settings"] = namedtuple("Settings", dict(function_code.settings))
                kinds |= {"states": _states(code), "motion": Motion}
                values: dict[str, float | None] = {name: None for name, _ in function_code.settings}
            else:
                kinds["settings"] = module.names.get("Settings")
                values = _settings(module, function_code)
            check_fields(
                module, function, {name: kinds[name] for name in arguments if kinds.get(name)}
            )
            if key == "dynamics":
                _try_out(module, function, code, [kinds[name] for name in arguments])
            names = compiled_names(module)
            names |= {f"_{name}": kind for name, kind in kinds.items()}
            names |= {"_function": names[function], "_sincos": sincos}
        positions = {name: first + k for k, (name, _) in enumerate(function_code.settings)}
        first += len(positions)
        flow = (s.RHO, s.AIRSPEED) if key == "dynamics" else (s.F_DENSITY, s.F_AIRSPEED)
        reads = _read_settings(width, values, positions, key == "dynamics")
        body = [*_read_lane(width, code, *flow), reads]
        if key == "dynamics":
            body += _read_motion(width, code)
        body.append(f"made = _function({', '.join(arguments)})")
        body += _WRITERS[key](width, code, module)
        text = loop_text(width, [f"nominal = tick == {NOMINAL}"], body)
        loops[key] = build(module, function, text, names, expected=WANTED)
    return Functions(**loops)


def _find_marked(module: Module) -> str:
    """Return the name of the only function with the decorator @dynamics, or raise InputError."""
    marked = module.marked(DYNAMICS)
    if len(marked) != 1:
        problem = (
            f"the file has {counted(len(marked), 'function')} with @dynamics"
            if marked
            else "the file has no function with @dynamics"
        )
        raise InputError(
            module.source.file,
            problem,
            "exactly one function; import the decorator with 'from abhv_mc.extend import dynamics'",
            module.texts[list(marked)[1]].lineno if marked else None,
        )
    return next(iter(marked))


def _is_constant(value: ast.expr | None) -> bool:
    """Return whether a return value is missing or certainly invalid: a constant or a tuple."""
    return value is None or isinstance(value, ast.Constant | ast.Tuple)


def _try_out(module: Module, function: str, code: VehicleCode, kinds: list[Any]) -> None:
    """Raise InputError if custom dynamics do not return an Effect with one rate per state.

    All statements 'return Effect(rates=(...), ...)' are checked, because a trial evaluation reaches
    only one of the statements. Arithmetic errors in the trial evaluation are ignored.
    """
    text = module.texts[function]
    returns = [node for node in ast.walk(text) if isinstance(node, ast.Return)]
    for node in returns:
        keywords = node.value.keywords if isinstance(node.value, ast.Call) else []
        rates = next((item.value for item in keywords if item.arg == "rates"), None)
        if isinstance(rates, ast.Tuple) and not any(
            isinstance(item, ast.Starred) for item in rates.elts
        ):
            _check_count(module, code, len(rates.elts), node.lineno)
    try:
        effect = module.names[function](*(kind(*[1.0] * len(kind._fields)) for kind in kinds))
    except (ArithmeticError, ValueError):
        return
    line = returns[0].lineno
    if type(effect) is not Effect:
        raise InputError(
            module.source.file,
            f"the custom dynamics return {type(effect).__name__}",
            "'return Effect(rates=(...), ...)'",
            line,
        )
    are_numbers = isinstance(effect.rates, tuple) and all(
        isinstance(rate, int | float) for rate in effect.rates
    )
    if not are_numbers:
        raise InputError(module.source.file, f"found rates={effect.rates!r}", _rates_of(code), line)
    _check_count(module, code, len(effect.rates), line)
    for name in ("force", "moment"):
        value = getattr(effect, name)
        if not isinstance(value, tuple) or len(value) != 3:
            raise InputError(module.source.file, f"found {name}={value}", f"{name}=(x, y, z)", line)


def _check_count(module: Module, code: VehicleCode, count: int, line: int) -> None:
    """Raise InputError unless ``count`` equals the number of states."""
    if count != len(code.states):
        raise InputError(
            module.source.file,
            f"found {counted(count, 'rate')} for {counted(len(code.states), 'state')}",
            _rates_of(code),
            line,
        )


def _rates_of(code: VehicleCode) -> str:
    """Return a description of the rates that custom dynamics must return."""
    names = ", ".join(state.name for state in code.states)
    return f"a tuple with one rate for each state: {names}"


def function_line(function_code: FunctionCode | None) -> int | None:
    """Return the line at which a vehicle's function is defined."""
    if function_code is None:
        return None
    module = run_module(UserSource(function_code.text, function_code.file))
    return int(module.texts[function_code.function or _find_marked(module)].lineno)


def check_finite(vehicle: Vehicle, variables: Floats, density: float, speed: float) -> None:
    """Raise InputError if coefficients or thrust of a vehicle's functions are not finite.

    ``variables`` [variable, 1], ``density`` (kg/m3) and ``speed`` (m/s) define the flight
    condition.
    """
    code = find_code(vehicle)
    if code is None:
        return
    coefficients, thrust = evaluate_functions(vehicle, variables, density, speed)
    for function_code, values, quantity in (
        (code.aerodynamics, coefficients, "a coefficient"),
        (code.propulsion, thrust, "a component of force, moment or fuel flow"),
    ):
        if function_code is not None and not np.isfinite(values).all():
            raise InputError(
                function_code.file,
                f"{quantity} is not finite at the start of the mission",
                "finite numbers",
                function_line(function_code),
            )


@functools.cache
def _controls(code: VehicleCode) -> Any:
    names = (name for name, *_ in code.effectors)
    return namedtuple("Controls", (*AXES, *names, "equivalence_ratio", "throttle"))


@functools.cache
def _states(code: VehicleCode) -> Any:
    return namedtuple("States", [state.name for state in code.states])


def _settings(module: Module, function_code: FunctionCode) -> dict[str, float | None]:
    """Return the fields of class ``Settings``, if any. Raise InputError for invalid values.

    The value of a field is None if the vehicle file sets it, else the field's default.
    """
    kind: Any = module.names.get("Settings")
    entries = dict(function_code.settings)
    units = module.names.get("UNITS", {})
    fields = kind._fields if kind is not None else ()
    values: dict[str, float | None] = {}
    for name in entries:
        if name not in fields:
            expected = (
                one_of(fields, name) if fields else "a class Settings(NamedTuple) in the file"
            )
            raise InputError(function_code.file, f"unknown setting '{name}'", expected)
    for name in fields:
        try:
            number = (
                parse_in_unit(entries[name], units.get(name, "-"))
                if name in entries
                else kind._field_defaults.get(name)
            )
        except Refusal as refusal:
            raise InputError(
                function_code.file, f"invalid setting '{name}' ({refusal.found})", refusal.expected
            ) from None
        if not is_number(number):
            raise InputError(
                function_code.file,
                f"the setting '{name}' has no value",
                "a value in the vehicle file, or a default in class Settings",
            )
        values[name] = None if name in entries else float(number)
    return values


def _read_settings(
    width: int, values: dict[str, float | None], positions: dict[str, int], dispersed: bool
) -> str:
    """Return the source line that constructs the settings of a function.

    If ``dispersed`` is true, only the plant calls the function, so the flight's settings always
    apply.
    """

    def read(position: int) -> str:
        of_flight = lane_of(width, s.SETTING + position)
        return of_flight if dispersed else f"given[{position}] if nominal else {of_flight}"

    parts = [
        read(positions[name]) if default is None else repr(default)
        for name, default in values.items()
    ]
    return f"settings = {tuple_text('settings', parts) if parts else '0.0'}"


def _read_motion(width: int, code: VehicleCode) -> list[str]:
    """Return the source lines that construct states and motion for custom dynamics."""
    states = [lane_of(width, s.CUSTOM_STAGE + i) for i in range(len(code.states))]
    motion = [lane_of(width, s.MOTION + i) for i in range(len(Motion._fields))]
    return [
        f"states = {tuple_text('states', states)}",
        f"motion = {tuple_text('motion', motion)}",
    ]


def _read_lane(width: int, code: VehicleCode, density: int, airspeed: int) -> list[str]:
    """Return source lines that construct the arguments from rows of lane memory."""
    lane = functools.partial(lane_of, width)

    def of(name: str) -> str:
        return lane(variable_row(name))

    effectors = [of(f"effector_{i}") for i in range(len(code.effectors))]
    controls = [
        *(of(name) for name in AXES),
        *effectors,
        of("equivalence_ratio"),
        of("equivalence_ratio"),
    ]
    return [
        f"speed, density, mach = {lane(airspeed)}, {lane(density)}, {of('mach')}",
        "sound = speed / mach if mach > 0.0 else 340.0",
        "pressure = density * sound * sound / 1.4",
        f"air = _air({of('altitude')}, mach, density, pressure, sound, 0.5 * density * speed * "
        f"speed, speed, {of('angle_of_attack')}, {of('sideslip')})",
        f"rates = _rates({of('roll_rate_hat')}, {of('pitch_rate_hat')}, {of('yaw_rate_hat')})",
        f"controls = _controls({', '.join(controls)})",
        f"throttle = {of('equivalence_ratio')}",
    ]


def _write_coefficients(width: int, code: VehicleCode, _: Module) -> list[str]:
    """Return source lines that convert coefficients to stability axes and store them."""
    names = ("lift", "drag", "side", "made.Cl", "made.Cm", "made.Cn")
    return _FRAMES[code.frame] + [
        f"{lane_of(width, s.COEF + i)} = {name}" for i, name in enumerate(names)
    ]


def _write_thrust(width: int, code: VehicleCode, _: Module) -> list[str]:
    """Return source lines that store the force, moment and fuel flow of an engine."""
    first = {"force": s.F_THRUST, "moment": s.F_MOMENT}
    lines = [
        f"{lane_of(width, first[quantity] + i)} = made.{quantity}_{axis}"
        for quantity in first
        for i, axis in enumerate("xyz")
    ]
    return [*lines, f"{lane_of(width, s.F_FUEL_FLOW)} = made.fuel_flow"]


def _write_effect(width: int, code: VehicleCode, module: Module) -> list[str]:
    """Return source lines that store rates, force, moment and sensed quantities."""
    rows = {f"made.rates[{i}]": s.CUSTOM_RATE + i for i in range(len(code.states))}
    rows |= {f"made.force[{i}]": s.CUSTOM_FORCE + i for i in range(3)}
    rows |= {f"made.moment[{i}]": s.CUSTOM_MOMENT + i for i in range(3)}
    # Quantities that are not arguments of a Sensed call remain zero and need no code.
    called = {name for name, value in module.names.items() if value is Sensed}
    calls = [
        node
        for node in ast.walk(ast.parse(module.source.text))
        if isinstance(node, ast.Call)
        and (getattr(node.func, "id", "") in called or getattr(node.func, "attr", "") == "Sensed")
    ]
    named = {keyword.arg for call in calls for keyword in call.keywords}
    for i, name in enumerate(Measured._fields):
        if name in named or None in named or any(call.args for call in calls):
            rows[f"made.sensed.{name}"] = s.SENSED + i
    return [f"{lane_of(width, row)} = {name}" for name, row in rows.items()]


_WRITERS = {
    "aerodynamics": _write_coefficients,
    "propulsion": _write_thrust,
    "dynamics": _write_effect,
}
_FRAMES = {
    "body": [
        "sin_a, cos_a = _sincos(air.angle_of_attack)",
        "lift = made.CX * sin_a - made.CZ * cos_a",
        "drag = -made.CX * cos_a - made.CZ * sin_a",
        "side = made.CY",
    ],
    "stability": ["lift, drag, side = made.CL, made.CD, made.CY"],
    "wind": [  # CD is opposite to the velocity; CC is positive to the right of the velocity.
        "sin_b, cos_b = _sincos(air.sideslip)",
        "lift = made.CL",
        "drag = made.CD * cos_b + made.CC * sin_b",
        "side = made.CC * cos_b - made.CD * sin_b",
    ],
}


def _evaluate(
    functions: Functions, settings: Floats, variables: Floats, density: Floats, speed: Floats
) -> tuple[Floats, Floats]:
    """Return coefficients and thrust [row, point] for the registered vehicle."""
    points = variables.shape[1]
    coefficients = np.zeros((len(COEFFICIENTS), points))
    thrust = np.zeros((N_THRUST, points))
    Z = aligned_zeros((s.LAW, WIDTH))
    for first in range(0, points, WIDTH):
        points_of_call = np.minimum(np.arange(first, first + WIDTH), points - 1)
        n = min(WIDTH, points - first)
        Z[s.VAR : s.VAR + len(VARIABLES)] = variables[:, points_of_call]
        Z[s.F_DENSITY] = density[points_of_call]
        Z[s.F_AIRSPEED] = speed[points_of_call]
        if functions.aerodynamics is not None:
            call_loop(functions.aerodynamics, Z, settings)
            coefficients[:, first : first + n] = Z[s.COEF : s.COEF + len(COEFFICIENTS), :n]
        if functions.propulsion is not None:
            call_loop(functions.propulsion, Z, settings)
            thrust[:6, first : first + n] = Z[s.F_THRUST : s.F_THRUST + 6, :n]
            thrust[6, first : first + n] = Z[s.F_FUEL_FLOW, :n]
    return coefficients, thrust


def call_loop(loop: Any, Z: Floats, settings: Floats) -> None:
    """Call a compiled function for the lanes of ``Z`` with the vehicle's settings."""
    pointer = ctypes.POINTER(ctypes.c_double)
    settings_pointer = settings.ctypes.data_as(pointer)
    loop.ctypes(
        None,
        Z.ctypes.data_as(pointer),
        settings_pointer,
        settings_pointer,
        settings_pointer,
        NOMINAL,
        0.0,
    )
