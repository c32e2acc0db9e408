"""Parameters of a vehicle's flights: built-in parameters and settings of custom code."""

import ast
import functools
from collections.abc import Iterable
from pathlib import Path

from abhv_mc.custom_code.source import compile_text, read_source
from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.io.messages import InputError
from abhv_mc.io.units import parse_any, si_unit_of, unit_of
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.law_file import PythonController
from abhv_mc_vehicle.plant.parameters import OURS, PARAMETERS
from abhv_mc_vehicle.vehicle.file import read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import VehicleCode, name_states


@functools.lru_cache(maxsize=16)
def vehicle_parameters(code: VehicleCode | None) -> Parameters:
    """Return the parameters in the order of the columns of parameter arrays."""
    if code is None:
        return OURS
    docs = {
        **{
            setting: f"setting of the vehicle's {setting.name.partition('.')[0]} function"
            for setting in code.settings
        },
        **dict.fromkeys(code.starts, "offset of the custom state's initial value"),
    }
    return Parameters(
        (*PARAMETERS, *(Parameter(*setting, doc, of_user=True) for setting, doc in docs.items()))
    )


def read_vehicle_parameters(
    vehicle: str | Path, controllers: Iterable[Path] = ()
) -> tuple[Parameters, tuple[tuple[str, str, bool], ...]]:
    """Return the parameters of a vehicle and its controllers, and the custom states.

    Raise InputError if a file is invalid.
    """
    code = read_vehicle_file(vehicle).code
    return add_law_parameters(vehicle_parameters(code), controllers), name_states(code)


def add_law_parameters(parameters: Parameters, controllers: Iterable[Path]) -> Parameters:
    """Return the parameters, including dispersable settings of Python laws as ``law.NAME``.

    The nominal values are the values in the controller files. The control laws are not run. Raise
    InputError for settings that cannot be dispersed.
    """
    added: dict[str, Parameter] = {}
    for path in controllers:
        try:
            controller = read_controller(path)
        except InputError:  # The error is reported when the controller is prepared.
            continue
        if not isinstance(controller, PythonController) or controller.around is not None:
            continue
        for name in _find_dispersable(controller.file):
            if name not in controller.settings:
                raise InputError(
                    path,
                    f"the dispersable setting '{name}' has no value",
                    f"'settings: {{{name}: ...}}' with the nominal value",
                )
            text = controller.settings[name]
            parameter = Parameter(
                f"law.{name}",
                si_unit_of(unit_of(text)),
                parse_any(text),
                "dispersable setting of the custom control law",
                of_user=True,
            )
            if added.setdefault(parameter.name, parameter) != parameter:
                raise InputError(
                    path,
                    f"the dispersable setting '{name}: {text}' differs from the value in another "
                    "controller file",
                    "the same value in all controllers, or another name",
                )
    return Parameters((*parameters.records, *added.values())) if added else parameters


def _find_dispersable(path: Path) -> tuple[str, ...]:
    """Return the names in ``@controller(dispersable=(...))``, without running the file."""
    for node in ast.walk(compile_text(read_source(path), ast.PyCF_ONLY_AST)):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "controller":
            for word in node.keywords:
                if word.arg == "dispersable":
                    try:
                        names = ast.literal_eval(word.value)
                    except ValueError:
                        names = None
                    if not isinstance(names, tuple) or not all(isinstance(n, str) for n in names):
                        raise InputError(
                            path,
                            "invalid 'dispersable'",
                            'a tuple of names: dispersable=("bandwidth",)',
                            word.value.lineno,
                        )
                    return names
    return ()
