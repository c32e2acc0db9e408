"""Reading of the custom functions that a vehicle file names."""

import math
from pathlib import Path
from typing import Any

from abhv_mc.io.documents import Document
from abhv_mc.io.input_error import Refusal
from abhv_mc.io.input_files import read_input
from abhv_mc.io.phrases import counted
from abhv_mc.io.units import dimension_of, parse_any, parse_quantity, si_unit_of
from abhv_mc_vehicle.kernel.plant.parameter_names import PARAMETER_NAMES
from abhv_mc_vehicle.kernel.plant.state import MAX_SETTINGS
from abhv_mc_vehicle.vehicle.actuator_keys import ThrustFunction
from abhv_mc_vehicle.vehicle.document import AerodynamicsFunction, VehicleDocument
from abhv_mc_vehicle.vehicle.vehicle_code import CustomState, FunctionCode, VehicleCode


def reference_point(content: VehicleDocument) -> tuple[float, float]:
    """Return x and z (m) of the point about which a function states its moments."""
    aerodynamics = content.aerodynamics
    if not isinstance(aerodynamics, AerodynamicsFunction):
        return 0.0, 0.0
    return aerodynamics.reference_point.x, aerodynamics.reference_point.z


def make_code(document: Document, content: VehicleDocument) -> VehicleCode | None:
    """Return the custom code that a vehicle file names, or None; the code is not run.

    Raise InputError if the code is invalid.
    """

    def read(
        section: str, key: str, path: Path, function: str, settings: dict[str, Any]
    ) -> FunctionCode:
        for name, value in settings.items():
            try:
                parse_any(value)
            except Refusal as refusal:
                location = (section, "settings", name)
                raise document.error(location, refusal.found, refusal.expected) from None
        try:
            text = read_input(path).decode()
        except (OSError, UnicodeDecodeError) as error:
            problem = f"'{path.name}' cannot be read ({getattr(error, 'strerror', error)})"
            raise document.error((section, key), problem, "a readable Python file") from None
        return FunctionCode(text, str(path), function, tuple(settings.items()))

    def read_function(section: str, keys: AerodynamicsFunction | ThrustFunction) -> FunctionCode:
        return read(section, "python", Path(keys.python), keys.function, keys.settings)

    air, engine, custom = content.aerodynamics, content.propulsion, content.dynamics
    coefficients = (
        read_function("aerodynamics", air) if isinstance(air, AerodynamicsFunction) else None
    )
    thrust = read_function("propulsion", engine) if isinstance(engine, ThrustFunction) else None
    dynamics = (
        read("dynamics", "file", Path(custom.file), "", dict(custom.settings)) if custom else None
    )
    if coefficients is None and thrust is None and dynamics is None:
        return None
    limits, own_states = content.state_limits(), custom.states if custom else {}
    states = tuple(
        CustomState(
            name,
            si_unit_of(state.unit),
            None if state.start is None else parse_quantity(state.start, dimension_of(state.unit)),
            limits.get(name, math.inf),
        )
        for name, state in own_states.items()
    )
    x, z = reference_point(content)
    frame = air.frame if isinstance(air, AerodynamicsFunction) else "stability"
    mixed = tuple(
        (name, effector.aileron, effector.rudder, effector.elevator)
        for name, effector in content.effectors.items()
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
        circular=frozenset(name for name, state in own_states.items() if state.circular),
    )
    names = [setting.name for setting in (*code.settings, *code.starts)]
    if duplicates := set(names).intersection(PARAMETER_NAMES):
        duplicate = min(duplicates)
        section = "dynamics" if duplicate.startswith("initial.") else duplicate.partition(".")[0]
        problem = f"'{duplicate}' is the name of a built-in parameter"
        raise document.error((section,), problem, "another name")
    if len(code.settings) + len(states) > MAX_SETTINGS:
        problem = (
            f"the functions have {counted(len(code.settings), 'setting')} and "
            f"{counted(len(states), 'state')}"
        )
        raise document.error((), problem, f"at most {MAX_SETTINGS} in total")
    return code
