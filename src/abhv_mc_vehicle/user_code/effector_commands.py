"""Direct effector commands of control laws.

An example is ``Command(..., effectors={"left_flap": 0.1})``. Compiled code cannot use dictionaries,
so the values are passed as a tuple, sorted by name.
"""

import ast
import types
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError, one_of
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.law_file import UserController
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.user_code.law_source import read_law_source
from abhv_mc_vehicle.vehicle.actuators import drive, name_effectors
from abhv_mc_vehicle.vehicle.file import pack_vehicle, read_vehicle_file

_EXPECTED = 'Command(..., effectors={"name": ...}), with the same names in each Command of the law'


def find_commanded(source: UserSource) -> tuple[str, ...]:
    """Return the names of the effectors that a control law commands directly.

    The names are sorted for Python laws. The result is empty for a law that uses the control mix.
    """
    if source.recipe is not None:
        return tuple(source.recipe["effectors"])
    commanded: set[str] = set()
    for _, argument in _commands(ast.parse(source.text)):
        if isinstance(argument, ast.Dict):
            commanded.update(
                key.value
                for key in argument.keys
                if isinstance(key, ast.Constant) and isinstance(key.value, str)
            )
    return tuple(sorted(commanded))


def effector_rows(source: UserSource, effectors: tuple[str, ...]) -> tuple[int, ...]:
    """Return the rows of lane memory for the effectors that a control law commands."""
    return tuple(s.EFFECTOR_COMMAND + effectors.index(name) for name in find_commanded(source))


def commands_effectors(source: UserSource) -> bool:
    """Return whether any Command of a control law commands effectors."""
    if source.recipe is not None:
        return bool(find_commanded(source))
    return any(argument is not None for _, argument in _commands(ast.parse(source.text)))


def parse_law(source: UserSource) -> ast.Module:
    """Return the syntax tree of a law, with dictionaries of effectors replaced by tuples.

    Raise InputError if the Commands of the law name different effectors.
    """
    tree = ast.parse(source.text)
    names = find_commanded(source)
    calls = _commands(tree)
    if all(argument is None for _, argument in calls):
        return tree
    for call, argument in calls:
        keys = [
            key.value if isinstance(key, ast.Constant) else None
            for key in getattr(argument, "keys", ())
        ]
        if not isinstance(argument, ast.Dict) or tuple(sorted(map(str, keys))) != names:
            raise InputError(
                source.file,
                "the Commands of the law name different effectors",
                _EXPECTED,
                call.lineno,
                call.col_offset + 1,
            )
        values = dict(zip(keys, argument.values, strict=True))
        numbers: list[ast.expr] = [
            ast.Call(ast.Name("float", ast.Load()), [values[name]], [])
            for name in names  # The conversion makes all values floats.
        ]
        for keyword in call.keywords:
            if keyword.arg == "effectors":
                keyword.value = ast.copy_location(ast.Tuple(numbers, ast.Load()), argument)
    return ast.fix_missing_locations(tree)


def tuple_codes(source: UserSource) -> dict[str, types.CodeType]:
    """Return the code of functions, rewritten with tuples of effectors, by function name."""
    if not find_commanded(source):
        return {}
    code = compile(parse_law(source), source.file, "exec", dont_inherit=True)
    return {
        constant.co_name: constant
        for constant in code.co_consts
        if isinstance(constant, types.CodeType)
    }


def find_driven(vehicle: Path, controllers: Iterable[Path]) -> tuple[str, ...]:
    """Return the effectors if the vehicle has actuators or a law commands effectors.

    No custom code is run. The result is empty if a file is invalid; the error is reported when
    plans are made.
    """
    try:
        content = read_document(vehicle).data
        if not isinstance(content, dict) or not content.get("effectors"):
            return ()
        packed = pack_vehicle(read_vehicle_file(vehicle), {})
        laws = map(read_controller, controllers)
        own = (read_law_source(law) for law in laws if isinstance(law, UserController))
        return (
            name_effectors(packed)
            if packed.constants.driven or any(map(commands_effectors, own))
            else ()
        )
    except InputError:
        return ()


def drive_commanded(vehicle: Vehicle, source: UserSource) -> Vehicle:
    """Return the vehicle; if a control law commands effectors, add effector actuators.

    Raise InputError for effectors that the vehicle does not have.
    """
    if not commands_effectors(source):
        return vehicle
    effector_names = name_effectors(vehicle)
    for name in find_commanded(source):
        if name not in effector_names:
            raise InputError(
                source.file, f"the vehicle has no effector '{name}'", one_of(effector_names, name)
            )
    return drive(vehicle)


def _commands(tree: ast.Module) -> list[tuple[ast.Call, Any]]:
    """Return each call of Command with its argument ``effectors``, which may be None."""
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Command"
    ]
    return [
        (call, next((k.value for k in call.keywords if k.arg == "effectors"), None))
        for call in calls
    ]
