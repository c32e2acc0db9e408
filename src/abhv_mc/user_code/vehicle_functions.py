"""Custom vehicle functions: run, checked, compiled to loops and evaluated."""

import ctypes
import functools
from collections import namedtuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.input_files import made_once
from abhv_mc.io.units import parse_in_unit
from abhv_mc.kernel.numerics.lane_math import sincos
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.state import aligned_zeros, variable_row
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, VARIABLES, Foreign, Vehicle
from abhv_mc.plant.effectiveness import count_rows
from abhv_mc.user_code.compiled import build, compiled_names, lane_of, loop_text
from abhv_mc.user_code.law_interface import Air, Rates
from abhv_mc.user_code.load_law import check_functions, is_number
from abhv_mc.user_code.module import Module, refuse_in_words, run_module
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder
from abhv_mc.vehicle.file import pack_vehicle, read_vehicle_file
from abhv_mc.vehicle.vehicle_code import N_THRUST, FunctionCode, VehicleCode, register

WIDTH = 32  # points of a call in the launching process
WANTED = "floats, named tuples and functions of them"
_AXES = ("aileron", "rudder", "elevator")
_AERODYNAMICS = ("air", "controls", "rates", "settings")
_PROPULSION = ("air", "throttle", "controls", "rates", "settings")


class Functions(NamedTuple):
    """Compiled functions of a vehicle; None if it has tables instead."""

    aerodynamics: Any
    propulsion: Any
    aerodynamics_settings: Floats
    propulsion_settings: Floats


@made_once
def load_vehicle(path: str | Path) -> Vehicle:
    """Read and pack a vehicle file; run its functions if they are trusted.

    Raise :class:`abhv_mc.io.documents.InputError`.
    """
    file = read_vehicle_file(path)
    vehicle = pack_vehicle(file, PARAMETER_INDEX)
    rows, axes = count_rows(vehicle), vehicle.tables.axis_variable.size
    if rows > s.MAX_TABLE_ROWS:
        problem = (
            f"tables that fill {rows} rows (those on equal axes share rows in eights; slopes "
            f"with deflections count)"
        )
        raise InputError(file.path, problem, f"at most {s.MAX_TABLE_ROWS}")
    if axes > s.MAX_AXES:
        raise InputError(file.path, f"tables on {axes} different grids", f"at most {s.MAX_AXES}")
    if file.code is None:
        return vehicle
    check_vehicle_trusted(path)
    return vehicle._replace(foreign=load_functions(file.code, vehicle))


def check_vehicle_trusted(path: str | Path, trusted: bool = False) -> None:
    """Raise InputError for untrusted functions of a vehicle in a results folder."""
    code = read_vehicle_file(path).code
    for function in code.functions() if code else ():
        if is_in_a_folder(Path(function.file)):
            check_trusted(UserSource(function.text, function.file), trusted)


_codes: dict[bytes, VehicleCode] = {}


def find_code(vehicle: Vehicle) -> VehicleCode | None:
    """Return the code of a loaded vehicle, or None for tables."""
    return _codes.get(vehicle.foreign.digest.tobytes())


def load_functions(code: VehicleCode, vehicle: Vehicle) -> Foreign:
    """Compile and register a vehicle's functions here; return the packed settings."""
    functions = compile_functions(code, WIDTH)
    _codes[code.digest] = code
    register(code.digest, functools.partial(_evaluate, functions))
    return vehicle.foreign._replace(
        aerodynamics_settings=functions.aerodynamics_settings,
        propulsion_settings=functions.propulsion_settings,
    )


@functools.lru_cache(maxsize=16)
def compile_functions(code: VehicleCode, width: int) -> Functions:
    """Return the compiled loops over ``width`` lanes.

    Raise InputError, with the user's line, for code that does not compile.
    """
    loops: list[Any] = [None, None]
    settings = [np.zeros(1), np.zeros(1)]
    for i, function_code in enumerate((code.aerodynamics, code.propulsion)):
        if function_code is None:
            continue
        source = UserSource(function_code.text, function_code.file)
        module = run_module(source)
        with refuse_in_words(source, "a function of the vehicle", WANTED):
            if function_code.function not in module.texts:
                raise InputError(
                    source.file,
                    f"no function '{function_code.function}'",
                    one_of(module.texts, function_code.function),
                )
            arguments = module.check_arguments(
                function_code.function, (_AERODYNAMICS, _PROPULSION)[i]
            )
            check_functions(module, function_code.function)
            values = _settings(module, function_code)
            names = compiled_names(module)
            names |= {
                "_Air": Air,
                "_Rates": Rates,
                "_function": names[function_code.function],
                "_sincos": sincos,
            }
            names |= {"_Settings": module.names.get("Settings"), "_Controls": _controls(code)}
        setting_values = ", ".join(f"given[{k}]" for k in range(len(values)))
        once = [f"settings = {f'_Settings({setting_values})' if names['_Settings'] else '0.0'}"]
        body = [*_read_lane(width, code), f"made = _function({', '.join(arguments)})"]
        body += (_write_coefficients, _write_thrust)[i](width, code)
        loops[i] = build(module, loop_text(width, once, body), names, function_code.function)
        settings[i] = np.array(values or (0.0,))
    return Functions(*loops, *settings)


@functools.cache
def _controls(code: VehicleCode) -> Any:
    names = (name for name, *_ in code.effectors)
    return namedtuple("Controls", (*_AXES, *names, "equivalence_ratio", "throttle"))


def _settings(module: Module, function_code: FunctionCode) -> tuple[float, ...]:
    """Return the numbers of class ``Settings``, empty without one. Raise InputError."""
    kind: Any = module.names.get("Settings")
    entries, units = dict(function_code.settings), module.names.get("UNITS", {})
    fields = kind._fields if kind is not None else ()
    values = []
    for name in entries:
        if name not in fields:
            expected = (
                one_of(fields, name) if fields else "a class Settings(NamedTuple) in the file"
            )
            raise InputError(function_code.file, f"the setting '{name}'", expected)
    for name in fields:
        try:
            number = (
                parse_in_unit(entries[name], units.get(name, "-"))
                if name in entries
                else kind._field_defaults.get(name)
            )
        except Refusal as refusal:
            raise InputError(
                function_code.file, f"{name}: {refusal.found}", refusal.expected
            ) from None
        if not is_number(number):
            raise InputError(
                function_code.file, f"no number for the setting '{name}'", "one, or a default"
            )
        values.append(float(number))
    return tuple(values)


def _read_lane(width: int, code: VehicleCode) -> list[str]:
    """Return lines that build a lane's arguments from rows of the lane memory."""

    lane = functools.partial(lane_of, width)

    def of(name: str) -> str:
        return lane(variable_row(name))

    effectors = [of(f"effector_{i}") for i in range(len(code.effectors))]
    controls = [
        *(of(name) for name in _AXES),
        *effectors,
        of("equivalence_ratio"),
        of("equivalence_ratio"),
    ]
    return [
        f"speed, density, mach = {lane(s.F_AIRSPEED)}, {lane(s.F_DENSITY)}, {of('mach')}",
        "sound = speed / mach if mach > 0.0 else 340.0",
        "pressure = density * sound * sound / 1.4",
        f"air = _Air({of('altitude')}, mach, density, pressure, sound, 0.5 * density * speed * speed, speed, "
        f"{of('angle_of_attack')}, {of('sideslip')})",
        f"rates = _Rates({of('roll_rate_hat')}, {of('pitch_rate_hat')}, {of('yaw_rate_hat')})",
        f"controls = _Controls({', '.join(controls)})",
        f"throttle = {of('equivalence_ratio')}",
    ]


def _write_coefficients(width: int, code: VehicleCode) -> list[str]:
    """Return lines that store coefficients of any frame as stability axes."""
    names = ("lift", "drag", "side", "made.Cl", "made.Cm", "made.Cn")
    return _FRAMES[code.frame] + [
        f"{lane_of(width, s.COEF + i)} = {name}" for i, name in enumerate(names)
    ]


def _write_thrust(width: int, code: VehicleCode) -> list[str]:
    """Return lines that store an engine's force, moment and fuel flow."""
    first = {"force": s.F_THRUST, "moment": s.F_MOMENT}
    lines = [
        f"{lane_of(width, first[quantity] + i)} = made.{quantity}_{axis}"
        for quantity in first
        for i, axis in enumerate("xyz")
    ]
    return [*lines, f"{lane_of(width, s.F_FUEL_FLOW)} = made.fuel_flow"]


_FRAMES = {
    "body": [
        "sin_a, cos_a = _sincos(air.angle_of_attack)",
        "lift = made.CX * sin_a - made.CZ * cos_a",
        "drag = -made.CX * cos_a - made.CZ * sin_a",
        "side = made.CY",
    ],
    "stability": ["lift, drag, side = made.CL, made.CD, made.CY"],
    "wind": [  # CD against the velocity, CC to the right of it
        "sin_b, cos_b = _sincos(air.sideslip)",
        "lift = made.CL",
        "drag = made.CD * cos_b + made.CC * sin_b",
        "side = made.CC * cos_b - made.CD * sin_b",
    ],
}


def _evaluate(
    functions: Functions, variables: Floats, density: Floats, speed: Floats
) -> tuple[Floats, Floats]:
    """Return coefficients and thrust [row, point] for the registered vehicle."""
    points = variables.shape[1]
    coefficients, thrust = np.zeros((len(COEFFICIENTS), points)), np.zeros((N_THRUST, points))
    Z = aligned_zeros((s.LAW, WIDTH))
    for first in range(0, points, WIDTH):
        points_of_call = np.minimum(np.arange(first, first + WIDTH), points - 1)
        n = min(WIDTH, points - first)
        Z[s.VAR : s.VAR + len(VARIABLES)] = variables[:, points_of_call]
        Z[s.F_DENSITY], Z[s.F_AIRSPEED] = density[points_of_call], speed[points_of_call]
        if functions.aerodynamics is not None:
            _call(functions.aerodynamics, Z, functions.aerodynamics_settings)
            coefficients[:, first : first + n] = Z[s.COEF : s.COEF + len(COEFFICIENTS), :n]
        if functions.propulsion is not None:
            _call(functions.propulsion, Z, functions.propulsion_settings)
            thrust[:6, first : first + n] = Z[s.F_THRUST : s.F_THRUST + 6, :n]
            thrust[6, first : first + n] = Z[s.F_FUEL_FLOW, :n]
    return coefficients, thrust


def _call(loop: Any, Z: Floats, settings: Floats) -> None:
    pointer = ctypes.POINTER(ctypes.c_double)
    settings_pointer = settings.ctypes.data_as(pointer)
    loop.ctypes(
        None,
        Z.ctypes.data_as(pointer),
        settings_pointer,
        settings_pointer,
        settings_pointer,
        0,
        0.0,
    )
