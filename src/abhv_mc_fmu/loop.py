"""What the kernel calls for an FMU: the text of a loop over the lanes for a wiring, compiled."""

import functools
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.kernel.laws.user import MEMORY
from abhv_mc.kernel.numerics.float_bits import float_bits
from abhv_mc.kernel.plant import state as s
from abhv_mc.user_code.compiled import COMMAND_ROWS, ONBOARD_ROWS, indent, lane_of
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, Measured, onboard_fields
from abhv_mc.user_code.native_loop import build_native

FLAGS = 8  # numbers' room for what a step of FMI 3.0 says


class Wire(NamedTuple):
    """A variable of the FMU and the quantity that it is wired to: SI is ``offset + factor * value``."""

    name: str  # measured.altitude, gains.k, time, or a field of Command
    reference: int
    factor: float
    offset: float


@functools.cache
def compile_fmu_adapter(
    version: int,
    inputs: tuple[Wire, ...],
    outputs: tuple[Wire, ...],
    params: int,
    gains: tuple[str, ...],
    *,
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
        return (
            plain
            if (wire.factor, wire.offset) == (1.0, 0.0)
            else f"({plain} - {wire.offset!r}) / {wire.factor!r}"
        )

    def from_fmu(field: str) -> str:
        for i, wire in enumerate(outputs):
            if wire.name == field:
                plain = (wire.factor, wire.offset) == (1.0, 0.0)
                return f"out[{i}]" if plain else f"{wire.offset!r} + {wire.factor!r} * out[{i}]"
        return "inf"

    n_inputs, n_outputs = len(inputs), len(outputs)
    at_outputs = 8 * (params + n_inputs)
    at_flags = at_outputs + 8 * n_outputs
    at_states = at_flags + 8 * FLAGS

    def call(function: str, group: str, numbers: int, byte: int) -> str:
        again = f", {numbers}" if version == 3 else ""
        return f"call_c({function}, (instance, {group}, {numbers}, place + {byte}{again}))"

    rows = [at(MEMORY + i) for i in range(remade or 0)]
    timing = "(instance, no, 0.0, time, no, 0.0)"
    put_inputs = call("put", "inputs", n_inputs, 8 * params)
    begin = [f"failed = max(failed, call_c(setup, {timing}))"] if version == 2 else []
    if params:
        begin.append(f"failed = max(failed, {call('put', 'params', params, 0)})")
    if rows:
        begin += ["if tick > 0:", *(f"    kept[{i}] = {row}" for i, row in enumerate(rows))]
        begin.append(f"    failed = max(failed, {call('put', 'states', len(rows), at_states)})")
    begin.append(
        f"failed = max(failed, call_c(enter, {timing if version == 3 else '(instance,)'}))"
    )
    begin += [
        f"failed = max(failed, {put_inputs})",
        "failed = max(failed, call_c(leave, (instance,)))",
    ]
    keep = [f"    {row} = kept[{i}]" for i, row in enumerate(rows)]
    keep = (
        ["if failed <= 1:", f"    failed = {call('get', 'states', len(rows), at_states)}", *keep]
        if rows
        else []
    )
    told = ", flags, flags + 8, flags + 16, flags + 24" if version == 3 else ""
    before = f"""\
reset, setup, enter, leave = context[0], context[1], context[2], context[3]
put, step, get = context[4], context[5], context[6]
params, inputs, outputs, states = context[7], context[8], context[9], context[10]
place, instances = context[11], context[12]
value, out, flags = floats_at(place + {8 * params}), floats_at(place + {at_outputs}), place + {at_flags}
numbers, kept = floats_at(instances), floats_at(place + {at_states})
time, r, k = tick * dt, tick * {len(REFERENCE)}, tick * {len(gains)}"""
    each = f"""\
instance = float_bits(numbers[number])
{indent(0, [f"value[{i}] = {to_fmu(wire)}" for i, wire in enumerate(inputs)])}
for i in range({n_inputs}):
    total += value[i]
if {"tick == 0" if remade is None else "True"}:
    failed = call_c(reset, (instance,))
{indent(4, begin)}
if failed <= 1:
    failed = {put_inputs}
if failed <= 1 and total - total == 0.0:
    failed = call_c(step, (instance, time, dt, yes{told}))
if failed <= 1:
    failed = {call("get", "outputs", n_outputs, at_outputs)}
{indent(0, keep)}"""
    names = {"float_bits": float_bits, "yes": np.int32(1), "no": np.int32(0)}
    texts = {row: from_fmu(field) for field, row in written.items()}
    place = (14, "context[13]") if remade is None else None
    return build_native(width, before, each, "failed > 1", n_outputs, texts, place, names)
