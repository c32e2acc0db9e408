"""What the kernel calls for an FMU: the text of a loop over the lanes for a wiring, compiled."""

import functools
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.kernel.jit_pointer import call_c, floats_at
from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.kernel.laws.user import FAULT, MEMORY
from abhv_mc.kernel.numerics.float_bits import float_bits
from abhv_mc.kernel.plant import state as s
from abhv_mc.user_code.compiled import COMMAND_ROWS, ONBOARD_ROWS, build_loop, find_place, indent, lane_of
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, NOT_GIVEN, Measured, onboard_fields
from abhv_mc.user_code.plain_law import LAW_FAILED

FLAGS = 8  # numbers' room for what a step of FMI 3.0 says


class Wire(NamedTuple):
    """A variable of the FMU and the quantity that it is wired to: SI is ``offset + factor * value``."""

    name: str  # measured.altitude, gains.k, time, or a field of Command
    reference: int
    factor: float
    offset: float


_HEAD = """\
def loop(context, Z, row, column, given, tick, dt):
    reset, setup, enter, leave = context[0], context[1], context[2], context[3]
    put, step, get = context[4], context[5], context[6]
    params, inputs, outputs, states = context[7], context[8], context[9], context[10]
    place, instances = context[11], context[12]
    value, out, flags = floats_at(place + {at_inputs}), floats_at(place + {at_outputs}), place + {at_flags}
    numbers, kept = floats_at(instances), floats_at(place + {at_states})
    time, r, k = tick * dt, tick * {columns}, tick * {gains}
    for lane in range({width}):
        if Z[{fault} + lane] > 0.0:
            continue
        number = lane
"""
_CALL = """\
        instance, failed, total = float_bits(numbers[number]), 0, 0.0
{fill}
        for i in range({n_inputs}):
            total += value[i]
        if {begins}:
            failed = call_c(reset, (instance,))
{begin}
        if failed <= 1:
            failed = call_c(put, (instance, inputs, {n_inputs}, place + {at_inputs}{count_inputs}))
        if failed <= 1 and total - total == 0.0:
            failed = call_c(step, (instance, time, dt, yes{flags}))
        if failed <= 1:
            failed = call_c(get, (instance, outputs, {n_outputs}, place + {at_outputs}{count_outputs}))
{keep}
        if failed > 1:
            Z[{fault} + lane] = {law_failed}
            for i in range({n_outputs}):
                out[i] = 0.0
        elif total - total != 0.0:
            out[0] = nan
{write}
"""
_BEGIN = {
    2: (
        "failed = max(failed, call_c(setup, (instance, no, 0.0, time, no, 0.0)))",
        "failed = max(failed, call_c(enter, (instance,)))",
    ),
    3: ("failed = max(failed, call_c(enter, (instance, no, 0.0, time, no, 0.0)))",),
}


@functools.cache
def compile_fmu_adapter(
    version: int,
    inputs: tuple[Wire, ...],
    outputs: tuple[Wire, ...],
    params: int,
    gains: tuple[str, ...],
    width: int,
    remade: int | None,
    effectors: tuple[tuple[str, int], ...] = (),
) -> Any:
    """The compiled loop for a wiring; ``remade``: states that are in the lanes' rows and set anew at each tick.

    ``effectors``: name and row of those that it commands.
    """
    written = dict(zip(COMMAND_FIELDS, COMMAND_ROWS, strict=True)) | {
        f"effectors.{name}": row for name, row in effectors
    }

    at = functools.partial(lane_of, width)

    def source(name: str) -> str:
        group, _, field = name.partition(".")
        if group == "measured":
            return at(s.MEASURED + Measured._fields.index(field))
        if group == "reference":
            return f"row[r + {REFERENCE.index(field)}]"
        if group == "onboard":
            return at(ONBOARD_ROWS[onboard_fields().index(field)])
        return "time" if group == "time" else f"column[k + {gains.index(field)}]"

    def to_fmu(wire: Wire) -> str:
        plain = source(wire.name)
        return plain if (wire.factor, wire.offset) == (1.0, 0.0) else f"({plain} - {wire.offset!r}) / {wire.factor!r}"

    def from_fmu(field: str) -> str:
        for i, wire in enumerate(outputs):
            if wire.name == field:
                plain = (wire.factor, wire.offset) == (1.0, 0.0)
                return f"out[{i}]" if plain else f"{wire.offset!r} + {wire.factor!r} * out[{i}]"
        return "inf"

    at_inputs, at_outputs = 8 * params, 8 * (params + len(inputs))
    at_flags = at_outputs + 8 * len(outputs)
    at_states = at_flags + 8 * FLAGS
    count = {2: "", 3: ", {}"}[version]
    begin = list(_BEGIN[version])
    if params:
        sets = f"failed = max(failed, call_c(put, (instance, params, {params}, place{count.format(params)})))"
        begin.insert(len(begin) - 1, sets)
    rows = [at(MEMORY + i) for i in range(remade or 0)]
    kept = f"(instance, states, {len(rows)}, place + {at_states}{count.format(len(rows))})"
    if rows:
        given = [*(f"kept[{i}] = {row}" for i, row in enumerate(rows)), f"failed = max(failed, call_c(put, {kept}))"]
        begin[-1:-1] = ["if tick > 0:", *(f"    {line}" for line in given)]
    into = f"place + {at_inputs}{count.format(len(inputs))}"
    begin.append(f"failed = max(failed, call_c(put, (instance, inputs, {len(inputs)}, {into})))")
    begin.append("failed = max(failed, call_c(leave, (instance,)))")
    keep = [
        "if failed <= 1:",
        f"    failed = call_c(get, {kept})",
        *(f"    {r} = kept[{i}]" for i, r in enumerate(rows)),
    ]
    text = (_HEAD + (find_place(width, 14, "context[13]", written.values()) if remade is None else "") + _CALL).format(
        at_inputs=at_inputs,
        at_outputs=at_outputs,
        at_flags=at_flags,
        at_states=at_states,
        begins="tick == 0" if remade is None else "True",
        keep=indent(8, keep),
        columns=len(REFERENCE),
        gains=len(gains),
        width=width,
        fault=FAULT * width,
        n_inputs=len(inputs),
        n_outputs=len(outputs),
        count_inputs=count.format(len(inputs)),
        count_outputs=count.format(len(outputs)),
        fill=indent(8, [f"value[{i}] = {to_fmu(wire)}" for i, wire in enumerate(inputs)]),
        begin=indent(12, begin),
        flags={2: "", 3: ", flags, flags + 8, flags + 16, flags + 24"}[version],
        law_failed=LAW_FAILED,
        write=indent(8, [f"{at(row)} = {from_fmu(field)}" for field, row in written.items()]),
    )
    names = {"floats_at": floats_at, "float_bits": float_bits, "call_c": call_c, "inf": NOT_GIVEN}
    names |= {"nan": float("nan"), "yes": np.int32(1), "no": np.int32(0)}
    return build_loop("fmu", text, names)
