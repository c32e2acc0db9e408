"""Compilation of custom channels, functions that each return one value per control tick."""

import functools
from collections import namedtuple
from typing import Any

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError, counted
from abhv_mc_vehicle.kernel.laws.user import CHANNEL, MAX_CHANNELS, MEMORY
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import STATE_INDEX, X, variable_row
from abhv_mc_vehicle.kernel.plant.vehicle import ACCELERATIONS
from abhv_mc_vehicle.user_code.compiled import (
    COMMAND_ROWS,
    REFERENCE_TEXT,
    build,
    compiled_names,
    lane_of,
    loop_text,
    tuple_text,
)
from abhv_mc_vehicle.user_code.law_interface import Measured, MixedCommand, Reference
from abhv_mc_vehicle.user_code.load_law import check_fields, check_functions
from abhv_mc_vehicle.user_code.module import CHANNEL as MARK
from abhv_mc_vehicle.user_code.module import refuse_in_words, run_module

# Measurements available in every flight, regardless of what the law requests.
_NAMES = Measured._fields[: s.N_MEASURED]
_Seen = namedtuple("Measured", _NAMES)  # type: ignore[misc]
# Lane-memory rows of true values; the first rows are in the order of Measured.
_ACTUAL = {
    **dict(zip(_NAMES, (X + s.ALTITUDE, s.SPEED, s.GAMMA, s.CHI), strict=False)),
    **{name: variable_row(name) for name in ("angle_of_attack", "sideslip")},
    "bank": s.BANK,
    **{name: X + STATE_INDEX[name] for name in ("roll_rate", "pitch_rate", "yaw_rate")},
    **{name: X + STATE_INDEX[name] for name in ("latitude", "longitude")},
    "north": s.NORTH,
    "east": s.EAST,
    **{name: s.SPECIFIC_X + i for i, name in enumerate(ACCELERATIONS)},
    **{name: X + STATE_INDEX[name] for name in ("q0", "q1", "q2", "q3")},
}
_Actual = namedtuple("Actual", _ACTUAL)  # type: ignore[misc]
_ARGUMENTS = ("actual", "measured", "memory", "reference", "command", "time", "dt")


@functools.lru_cache(maxsize=16)
def compile_channels(source: UserSource, width: int, memory: Any) -> Any:
    """Compile custom channels and return their loop over ``width`` lanes.

    The loop has the attribute ``address``. ``memory`` is the class of the law's memory if lane
    memory stores the memory, else None. Raise InputError if a channel cannot be compiled.
    """
    module = run_module(source)
    with refuse_in_words(source, "the file of channels", "plain functions"):
        functions = module.marked(MARK)
        if not 1 <= len(functions) <= MAX_CHANNELS:
            raise InputError(
                source.file, f"found {counted(len(functions), 'channel')}", f"1 to {MAX_CHANNELS}"
            )
        signatures = {name: module.check_arguments(name, _ARGUMENTS) for name in functions}
        kinds = {"actual": _Actual, "measured": _Seen} | ({"memory": memory} if memory else {})
        for name, arguments in signatures.items():
            if "memory" in arguments and not memory:
                raise InputError(
                    source.file,
                    f"the channel '{name}' uses 'memory', which at least one controller does not "
                    "provide",
                    "a campaign in which each controller is a compiled law or filter with a class "
                    "Memory",
                    module.texts[name].lineno,
                )
            check_functions(module, name)
            check_fields(module, name, {key: kinds[key] for key in arguments if key in kinds})
        names = compiled_names(module)
        names |= {f"_channel_{name}": names[name] for name in functions}
        names |= {"_Measured": _Seen, "_Actual": _Actual, "_Memory": memory}
        names |= {"_Reference": Reference, "_Command": MixedCommand}
        fields = memory._fields if memory else ()
        text = _make_loop(signatures, width, fields)
        return build(module, next(iter(functions)), text, names, f"{fields}")


def _make_loop(signatures: dict[str, tuple[str, ...]], width: int, memory: tuple[str, ...]) -> str:
    lane = functools.partial(lane_of, width)
    once = {"reference": REFERENCE_TEXT, "time": "tick * dt"}
    inside = {
        "actual": tuple_text("Actual", map(lane, _ACTUAL.values())),
        "memory": tuple_text("Memory", [lane(MEMORY + i) for i in range(len(memory))]),
        "measured": tuple_text("Measured", [lane(s.MEASURED + i) for i in range(s.N_MEASURED)]),
        "command": tuple_text("Command", map(lane, (*COMMAND_ROWS, s.CMD_ETA))),
    }
    named = {argument for arguments in signatures.values() for argument in arguments}
    before, lines = (
        [f"{name} = {text}" for name, text in arguments_of_loop.items() if name in named]
        for arguments_of_loop in (once, inside)
    )
    for i, (name, arguments) in enumerate(signatures.items()):
        lines.append(f"{lane(CHANNEL + i)} = _channel_{name}({', '.join(arguments)})")
    return loop_text(width, before, lines)
