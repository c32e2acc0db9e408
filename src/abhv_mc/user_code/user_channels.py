"""Custom channels, compiled like control laws: one number per control tick."""

import functools
from typing import Any, NamedTuple

from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.laws.user import CHANNEL, MAX_CHANNELS
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.state import X, variable_row
from abhv_mc.user_code.compiled import (
    COMMAND_ROWS,
    REFERENCE_TEXT,
    build,
    compiled_names,
    lane_of,
    loop_text,
    tuple_text,
)
from abhv_mc.user_code.law_interface import Measured, MixedCommand, Reference
from abhv_mc.user_code.load_law import check_functions
from abhv_mc.user_code.module import CHANNEL as MARK
from abhv_mc.user_code.module import refuse_in_words, run_module
from abhv_mc.user_code.source import UserSource

# Rows of the true values, in the order of Measured.
_PATH = X + s.ALTITUDE, s.SPEED, s.GAMMA, s.CHI
_ANGLES = variable_row("angle_of_attack"), variable_row("sideslip"), s.BANK
_ACTUAL = (*_PATH, *_ANGLES, X + s.ROLL_RATE, X + s.PITCH_RATE, X + s.YAW_RATE)
# Measurements in every flight; other quantities exist only if the law requests them.
_Seen: Any = NamedTuple("Measured", [(name, float) for name in Measured._fields[: s.N_MEASURED]])  # type: ignore[misc]
_ARGUMENTS = ("actual", "measured", "reference", "command", "time", "dt")


@functools.lru_cache(maxsize=16)
def compile_channels(source: UserSource, width: int) -> Any:
    """Return the compiled loop over ``width`` lanes, with its ``address``.

    Raise InputError.
    """
    module = run_module(source)
    with refuse_in_words(source, "channels", "plain functions"):
        functions = module.marked(MARK)
        if not 1 <= len(functions) <= MAX_CHANNELS:
            raise InputError(source.file, f"{len(functions)} channels", f"1 to {MAX_CHANNELS}")
        signatures = {name: module.check_arguments(name, _ARGUMENTS) for name in functions}
        for name in functions:
            check_functions(module, name)
        names = compiled_names(module)
        names |= {f"_channel_{name}": names[name] for name in functions}
        names |= {"_Measured": _Seen, "_Reference": Reference, "_Command": MixedCommand}
        return build(module, _make_loop(signatures, width), names)


def _make_loop(signatures: dict[str, tuple[str, ...]], width: int) -> str:
    lane = functools.partial(lane_of, width)
    once = {"reference": REFERENCE_TEXT, "time": "tick * dt"}
    inside = {
        "actual": tuple_text("Measured", map(lane, _ACTUAL)),
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
