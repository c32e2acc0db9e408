"""What a law commands of the vehicle's effectors themselves: ``Command(..., effectors={"left_flap": 0.1})``.

Compiled code has no dictionaries: the numbers of a law to be compiled become a tuple, in the order of their names.
"""

import ast
import types
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.law_file import UserController
from abhv_mc.io.documents import read_document
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.vehicle import Vehicle
from abhv_mc.user_code.law_source import read_law_source
from abhv_mc.user_code.source import UserSource
from abhv_mc.vehicle.actuators import drive, name_effectors
from abhv_mc.vehicle.file import pack_vehicle, read_vehicle_file

_EXPECTED = 'Command(..., effectors={"name": ...}), the same names in each Command of the law'


def find_commanded(source: UserSource) -> tuple[str, ...]:
    """The effectors that a law commands, of one in Python sorted; none for a law that leaves them to their mix."""
    if source.recipe is not None:
        return tuple(source.recipe["effectors"])
    found: set[str] = set()
    for _, given in _commands(ast.parse(source.text)):
        if isinstance(given, ast.Dict):
            found.update(
                key.value
                for key in given.keys
                if isinstance(key, ast.Constant) and isinstance(key.value, str)
            )
    return tuple(sorted(found))


def effector_rows(source: UserSource, effectors: tuple[str, ...]) -> tuple[int, ...]:
    """Rows of the lane memory of the ``effectors``, the vehicle's, that a law commands."""
    return tuple(s.EFFECTOR_COMMAND + effectors.index(name) for name in find_commanded(source))


def commands_effectors(source: UserSource) -> bool:
    """Whether a law commands effectors, in any of its Commands."""
    if source.recipe is not None:
        return bool(find_commanded(source))
    return any(given is not None for _, given in _commands(ast.parse(source.text)))


def parse_law(source: UserSource) -> ast.Module:
    """The text with tuples for the effectors of its Commands. Raises InputError for what cannot be one."""
    tree = ast.parse(source.text)
    names = find_commanded(source)
    calls = _commands(tree)
    if all(given is None for _, given in calls):
        return tree
    for call, given in calls:
        keys = [
            key.value if isinstance(key, ast.Constant) else None
            for key in getattr(given, "keys", ())
        ]
        if not isinstance(given, ast.Dict) or tuple(sorted(map(str, keys))) != names:
            raise InputError(
                source.file,
                "other effectors in a Command",
                _EXPECTED,
                call.lineno,
                call.col_offset + 1,
            )
        values = dict(zip(keys, given.values, strict=True))
        numbers: list[ast.expr] = [
            ast.Call(ast.Name("float", ast.Load()), [values[name]], [])
            for name in names  # all of one type
        ]
        for keyword in call.keywords:
            if keyword.arg == "effectors":
                keyword.value = ast.copy_location(ast.Tuple(numbers, ast.Load()), given)
    return ast.fix_missing_locations(tree)


def tuple_codes(source: UserSource) -> dict[str, types.CodeType]:
    """Code of the functions of a law with such tuples, by name; none for a law without."""
    if not find_commanded(source):
        return {}
    code = compile(parse_law(source), source.file, "exec", dont_inherit=True)
    return {each.co_name: each for each in code.co_consts if isinstance(each, types.CodeType)}


def find_driven(vehicle: Path, controllers: Iterable[Path]) -> tuple[str, ...]:
    """Names of a vehicle's effectors where it gives them actuators or a law commands some; nothing is run.

    None where a file is wrong: whoever makes the plans says so.
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
    """The vehicle as a law flies it: one that commands effectors finds an actuator at each of them.

    Raises InputError for effectors that the vehicle does not have.
    """
    if not commands_effectors(source):
        return vehicle
    known = name_effectors(vehicle)
    for name in find_commanded(source):
        if name not in known:
            raise InputError(source.file, f"the effector '{name}'", one_of(known, name))
    return drive(vehicle)


def _commands(tree: ast.Module) -> list[tuple[ast.Call, Any]]:
    """Each Command that is made, and what it is given as effectors; None where nothing."""
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Command"
    ]
    return [
        (call, next((k.value for k in call.keywords if k.arg == "effectors"), None))
        for call in calls
    ]
