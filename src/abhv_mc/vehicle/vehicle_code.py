"""Functions of a vehicle's own: which code, how it is called, and what it gives on the launching side.

What runs it is a layer above (:mod:`abhv_mc.user_code.vehicle_functions`) and is registered here by the code's digest.
"""

import functools
import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.documents import Document
from abhv_mc.io.input_error import InputError, Refusal
from abhv_mc.io.input_files import read_input
from abhv_mc.io.units import dimension_of, parse_any, parse_quantity, si_unit_of, unit_of
from abhv_mc.kernel.plant.parameter_names import PARAMETER_NAMES
from abhv_mc.kernel.plant.state import MAX_SETTINGS
from abhv_mc.kernel.plant.vehicle import VARIABLES, Foreign, Vehicle
from abhv_mc.kernel.world.atmosphere import atmosphere
from abhv_mc.vehicle.actuator_keys import ThrustFunction
from abhv_mc.vehicle.document import AerodynamicsFunction, VehicleDocument

N_THRUST = 7  # force x y z, moment x y z, fuel flow
STEP = 1e-5  # rad: slopes by central differences
_ALTITUDE, _MACH = VARIABLES.index("altitude"), VARIABLES.index("mach")


@dataclass(frozen=True)
class FunctionCode:
    """One function: the text of its file, its name, its settings as the vehicle file gives them."""

    text: str
    file: str
    function: str
    settings: tuple[tuple[str, Any], ...]


class Setting(NamedTuple):
    """A number that a vehicle file gives to a function, as a campaign may disperse it."""

    name: str  # such as dynamics.frequency
    unit: str  # SI
    value: float


class CustomState(NamedTuple):
    """A state of custom dynamics."""

    name: str
    unit: str
    start: float | None  # SI; None: its equilibrium at the trim
    limit: float = math.inf  # to either side


@dataclass(frozen=True)
class VehicleCode:
    """All code of a vehicle. It travels with a plan; no stored plan holds it."""

    aerodynamics: FunctionCode | None
    propulsion: FunctionCode | None
    dynamics: FunctionCode | None
    states: tuple[CustomState, ...]
    frame: str  # of the forces: body, stability, wind
    engine: tuple[
        float, float
    ]  # x, z of the moment reference from where the aerodynamics' moments are given, m
    effectors: tuple[
        tuple[str, float, float, float], ...
    ]  # with their deflection by aileron, rudder and elevator
    span: float
    chord: float

    def functions(self) -> Iterator[FunctionCode]:
        """The functions that there are."""
        yield from (function for _, function in self.named_functions() if function is not None)

    def named_functions(self) -> tuple[tuple[str, FunctionCode | None], ...]:
        """All of them by the key of the vehicle file, in the order of their settings."""
        return (
            ("aerodynamics", self.aerodynamics),
            ("propulsion", self.propulsion),
            ("dynamics", self.dynamics),
        )

    @functools.cached_property
    def settings(self) -> tuple[Setting, ...]:
        """The numbers of the file's settings, in the order of ``Foreign.settings``. Raise Refusal."""
        return tuple(
            Setting(f"{key}.{name}", si_unit_of(unit_of(value)), parse_any(value))
            for key, function in self.named_functions()
            for name, value in (function.settings if function else ())
        )

    @functools.cached_property
    def starts(self) -> tuple[Setting, ...]:
        """The initial dispersions of the states, which follow the settings."""
        return tuple(Setting(f"initial.{state.name}", state.unit, 0.0) for state in self.states)

    @property
    def digest(self) -> bytes:
        """SHA-256 of the texts and of all that decides how they are called; their places do not count."""
        parts = [
            (code.text, code.function, code.settings) if code else None
            for _, code in self.named_functions()
        ]
        how = self.frame, self.engine, self.effectors, self.span, self.chord, self.states
        return hashlib.sha256(repr((parts, *how)).encode()).digest()

    def pack(self) -> Foreign:
        """As the compiled plant has it."""
        return Foreign(
            int(self.aerodynamics is not None),
            int(self.propulsion is not None),
            *self.engine,
            np.frombuffer(self.digest, dtype=np.int64).copy(),
            np.array([setting.value for setting in self.settings], dtype=np.float64),
            len(self.states),
            np.array([state.limit for state in self.states], dtype=np.float64),
        )


def name_states(code: VehicleCode | None) -> tuple[tuple[str, str], ...]:
    """Names and units of custom states; none without them."""
    return tuple((state.name, state.unit) for state in code.states) if code else ()


def reference_point(content: VehicleDocument) -> tuple[float, float]:
    """x and z of the point about which the aerodynamics' moments are, from the moment reference of the file."""
    aerodynamics = content.aerodynamics
    if not isinstance(aerodynamics, AerodynamicsFunction):
        return 0.0, 0.0
    return aerodynamics.reference_point.x, aerodynamics.reference_point.z


def make_code(document: Document, content: VehicleDocument) -> VehicleCode | None:
    """The code that a vehicle file names, read but not run; None for a vehicle of tables. Raises InputError."""

    def read(
        part: str, key: str, path: Path, function: str, settings: dict[str, Any]
    ) -> FunctionCode:
        for name, value in settings.items():
            try:
                parse_any(value)
            except Refusal as refusal:
                place = (part, "settings", name)
                raise document.error(place, refusal.found, refusal.expected) from None
        try:
            text = read_input(path).decode()
        except (OSError, UnicodeDecodeError) as error:
            found = f"'{path.name}', which cannot be read ({getattr(error, 'strerror', error)})"
            raise document.error((part, key), found, "a Python file") from None
        return FunctionCode(text, str(path), function, tuple(settings.items()))

    def read_function(part: str, of: AerodynamicsFunction | ThrustFunction) -> FunctionCode:
        return read(part, "python", Path(of.python), of.function, of.settings)

    air, engine, own = content.aerodynamics, content.propulsion, content.dynamics
    coefficients = (
        read_function("aerodynamics", air) if isinstance(air, AerodynamicsFunction) else None
    )
    thrust = read_function("propulsion", engine) if isinstance(engine, ThrustFunction) else None
    dynamics = read("dynamics", "file", Path(own.file), "", dict(own.settings)) if own else None
    if coefficients is None and thrust is None and dynamics is None:
        return None
    limits = content.state_limits()
    states = tuple(
        CustomState(
            name,
            si_unit_of(state.unit),
            None if state.start is None else parse_quantity(state.start, dimension_of(state.unit)),
            limits.get(name, math.inf),
        )
        for name, state in (own.states if own else {}).items()
    )
    x, z = reference_point(content)
    frame = air.frame if isinstance(air, AerodynamicsFunction) else "stability"
    mixed = tuple(
        (name, own.aileron, own.rudder, own.elevator) for name, own in content.effectors.items()
    )
    code = VehicleCode(
        aerodynamics=coefficients,
        propulsion=thrust,
        dynamics=dynamics,
        states=states,
        frame=frame,
        engine=(-x, -z),
        effectors=mixed,
        span=content.reference.span,
        chord=content.reference.chord,
    )
    names = [setting.name for setting in (*code.settings, *code.starts)]
    if taken := set(names).intersection(PARAMETER_NAMES):
        word = min(taken)
        part = "dynamics" if word.startswith("initial.") else word.partition(".")[0]
        raise document.error((part,), f"'{word}', which is another parameter", "another name")
    if len(code.settings) + len(states) > MAX_SETTINGS:
        found = f"{len(code.settings)} settings and {len(states)} states"
        raise document.error((), found, f"at most {MAX_SETTINGS} together")
    return code


Evaluator = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
_evaluators: dict[bytes, Evaluator] = {}


def register(digest: bytes, evaluate: Evaluator) -> None:
    """Have a vehicle's functions evaluated by ``evaluate``, for :func:`evaluate_functions`."""
    _evaluators[digest] = evaluate


def evaluate_functions(
    vehicle: Vehicle, variables: Any, density: Any = None, speed: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients ``[coefficient, point]``, in stability axes, and thrust ``[7, point]`` of a vehicle's own functions.

    A complex argument's imaginary part is a direction along which the slope is a central difference. Without density
    (kg/m3) and speed (m/s) those of the standard atmosphere at the variables' altitude and Mach number.
    """
    digest = vehicle.foreign.digest.tobytes()
    if digest not in _evaluators:
        raise InputError(
            "vehicle", "functions that were not loaded", "load_vehicle, which runs their file"
        )
    shape = variables.shape[1:]
    points = variables.reshape(len(variables), -1)
    if density is None or speed is None:
        air = [atmosphere(float(altitude)) for altitude in np.real(points[_ALTITUDE])]
        density = np.reshape([one[0] for one in air], shape)
        speed = variables[_MACH] * np.reshape([one[3] for one in air], shape)
    given = [points, *(np.broadcast_to(value, shape).reshape(-1) for value in (density, speed))]
    evaluate = _evaluators[digest]
    real = [np.ascontiguousarray(np.real(value), dtype=np.float64) for value in given]
    if not any(np.iscomplexobj(value) for value in given):
        found = evaluate(*real)
        return found[0].reshape(-1, *shape), found[1].reshape(-1, *shape)
    turn = [np.imag(value) for value in given]
    size = np.maximum.reduce([np.abs(turn[0]).max(axis=0), np.abs(turn[1]), np.abs(turn[2])])
    unit = [value / np.where(size > 0.0, size, 1.0) for value in turn]
    middle = evaluate(*real)
    ends = [
        evaluate(*(value + step * way for value, way in zip(real, unit, strict=True)))
        for step in (STEP, -STEP)
    ]
    made = [
        (at + 1j * size * (above - below) / (2.0 * STEP)).reshape(-1, *shape)
        for at, above, below in zip(middle, *ends, strict=True)
    ]
    return made[0], made[1]
