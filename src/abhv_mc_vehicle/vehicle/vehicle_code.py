"""Custom functions of a vehicle: source code, and evaluation outside the simulator.

The module :mod:`abhv_mc_vehicle.user_code.vehicle_functions` compiles the functions, and registers
an evaluator in this module under the digest of the code.
"""

import functools
import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import InputError
from abhv_mc.io.units import parse_any, si_unit_of, unit_of
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Foreign, Vehicle
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere

N_THRUST = 7  # number of values of a propulsion function: force, moment, fuel flow
STEP = 1e-5  # step of the central differences, rad
_ALTITUDE, _MACH = VARIABLES.index("altitude"), VARIABLES.index("mach")


@dataclass(frozen=True)
class FunctionCode:
    """Custom function: source file, function name, and settings from the vehicle file."""

    text: str
    file: str
    function: str
    settings: tuple[tuple[str, Any], ...]


class Setting(NamedTuple):
    """Setting of a custom function, which a campaign may disperse."""

    name: str  # name such as dynamics.frequency
    unit: str  # SI unit of the value
    value: float


class CustomState(NamedTuple):
    """State variable of custom dynamics."""

    name: str
    unit: str
    # initial value in SI; None if the state starts in equilibrium at the trim point
    start: float | None
    limit: float = math.inf  # maximum magnitude of the state


@dataclass(frozen=True)
class VehicleCode:
    """Custom code of a vehicle, which is sent to workers with a plan but not stored with it."""

    aerodynamics: FunctionCode | None
    propulsion: FunctionCode | None
    dynamics: FunctionCode | None
    states: tuple[CustomState, ...]
    frame: str  # axes of the aerodynamic forces: body, stability or wind
    # x and z (m) of the moment reference, relative to the point about which the engine function
    # returns its moments
    engine: tuple[float, float]
    # (name, deflections per unit of aileron, rudder and elevator)
    effectors: tuple[tuple[str, float, float, float], ...]
    span: float
    chord: float
    circular: frozenset[str] = frozenset()  # names of circular states

    def functions(self) -> Iterator[FunctionCode]:
        """Yield the custom functions that are defined."""
        yield from (function for _, function in self.named_functions() if function is not None)

    def named_functions(self) -> tuple[tuple[str, FunctionCode | None], ...]:
        """Return each section of the vehicle file with its custom function or None."""
        return (
            ("aerodynamics", self.aerodynamics),
            ("propulsion", self.propulsion),
            ("dynamics", self.dynamics),
        )

    @functools.cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Values of the settings, in the order of ``Foreign.settings``.

        Raise Refusal if a value is invalid.
        """
        return tuple(
            Setting(f"{key}.{name}", si_unit_of(unit_of(value)), parse_any(value))
            for key, function in self.named_functions()
            for name, value in (function.settings if function else ())
        )

    @functools.cached_property
    def starts(self) -> tuple[Setting, ...]:
        """Dispersions of the initial states, which follow the settings in parameter arrays."""
        return tuple(Setting(f"initial.{state.name}", state.unit, 0.0) for state in self.states)

    @property
    def digest(self) -> bytes:
        """SHA-256 digest of the sources and calling conventions, but not of file paths."""
        parts = [
            (code.text, code.function, code.settings) if code else None
            for _, code in self.named_functions()
        ]
        conventions = self.frame, self.engine, self.effectors, self.span, self.chord, self.states
        return hashlib.sha256(repr((parts, *conventions)).encode()).digest()

    def pack(self) -> Foreign:
        """Return the custom code in the form that the compiled plant uses."""
        return Foreign(
            int(self.aerodynamics is not None),
            int(self.propulsion is not None),
            *self.engine,
            np.frombuffer(self.digest, dtype=np.int64).copy(),
            np.array([setting.value for setting in self.settings], dtype=np.float64),
            len(self.states),
            np.array([state.limit for state in self.states], dtype=np.float64),
        )


def name_states(code: VehicleCode | None) -> tuple[tuple[str, str, bool], ...]:
    """Return the names and units of custom states, and whether each state is circular."""
    if code is None:
        return ()
    return tuple((state.name, state.unit, state.name in code.circular) for state in code.states)


Evaluator = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
_evaluators: dict[bytes, Evaluator] = {}


def register(digest: bytes, evaluate: Evaluator) -> None:
    """Register the evaluator of vehicle functions with the given digest."""
    _evaluators[digest] = evaluate


def evaluate_functions(
    vehicle: Vehicle, variables: Any, density: Any = None, speed: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return stability-axis coefficients [coefficient, point] and thrust [7, point].

    The imaginary part of a complex argument is a direction, along which derivatives are computed by
    central differences. Density (kg/m3) and speed (m/s) default to those of the standard atmosphere
    at the altitude and Mach number of the variables.
    """
    digest = vehicle.foreign.digest.tobytes()
    if digest not in _evaluators:
        raise InputError(
            "vehicle",
            "the functions were not loaded",
            "a vehicle read by load_vehicle, which loads the functions",
        )
    shape = variables.shape[1:]
    points = variables.reshape(len(variables), -1)
    if density is None or speed is None:
        air = [atmosphere(float(altitude)) for altitude in np.real(points[_ALTITUDE])]
        density = np.reshape([layer[0] for layer in air], shape)
        speed = variables[_MACH] * np.reshape([layer[3] for layer in air], shape)
    arguments = [points, *(np.broadcast_to(value, shape).reshape(-1) for value in (density, speed))]
    evaluate = _evaluators[digest]
    real = [np.ascontiguousarray(np.real(value), dtype=np.float64) for value in arguments]
    if not any(np.iscomplexobj(value) for value in arguments):
        results = evaluate(*real)
        return results[0].reshape(-1, *shape), results[1].reshape(-1, *shape)
    directions = [np.imag(value) for value in arguments]
    size = np.maximum.reduce(
        [np.abs(directions[0]).max(axis=0), np.abs(directions[1]), np.abs(directions[2])]
    )
    unit = [value / np.where(size > 0.0, size, 1.0) for value in directions]
    middle = evaluate(*real)
    ends = [
        evaluate(*(value + step * direction for value, direction in zip(real, unit, strict=True)))
        for step in (STEP, -STEP)
    ]
    complex_results = [
        (value + 1j * size * (above - below) / (2.0 * STEP)).reshape(-1, *shape)
        for value, above, below in zip(middle, *ends, strict=True)
    ]
    return complex_results[0], complex_results[1]
