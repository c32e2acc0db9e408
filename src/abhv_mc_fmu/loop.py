"""Compiled loop over lanes that calls an FMU, generated for an assignment of variables."""

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.user import MEMORY
from abhv_mc_vehicle.kernel.numerics.float_bits import bits_float, float_bits
from abhv_mc_vehicle.user_code.compiled import COMMAND_ROWS, INPUT_ROWS, indent, lane_of
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS
from abhv_mc_vehicle.user_code.native_loop import build_native

FLAGS = 8  # array elements reserved for the flags that a step returns in FMI 3.0


FLOAT = "Float64"
INTEGERS = {f"{sign}Int{bits}": (not sign, bits) for sign in ("", "U") for bits in (8, 16, 32, 64)}
NAMES = {  # names available to the generated code
    "floor": math.floor,
    "int64": np.int64,
    "int32": np.int32,
    "float32": np.float32,
    "float64": np.float64,
}


class Wire(NamedTuple):
    """FMU variable and its quantity; the value in SI units is ``offset + factor * value``."""

    name: str  # name such as measured.altitude, gains.k, time, or a field of Command
    reference: int
    factor: float
    offset: float
    kind: str = FLOAT  # FMI 3.0 type; Boolean is followed by its number of bytes


def _ends(kind: str) -> tuple[float, float]:
    """Return the range of an integer type, within the range of signed 64-bit integers."""
    signed, bits = INTEGERS[kind]
    if bits == 64:
        return (-(2.0**63) if signed else 0.0), 2.0**63 - 1024.0
    return (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0) if signed else (0.0, 2.0**bits - 1.0)


def pack(kind: str, value: float) -> int:
    """Return a value as an integer with the same low bytes, or 0 for 64-bit floats."""
    if kind == FLOAT:
        return 0
    if kind.startswith("Boolean"):
        return int(value != 0.0)
    if kind == "Float32":
        return int(np.float32(value).view(np.uint32))
    low, high = _ends(kind)
    return math.floor(min(max(value, low), high) + 0.5)


def encode(kind: str, value: str) -> str:
    """Return the source expression that computes :func:`pack`."""
    if kind.startswith("Boolean"):
        return f"(1 if {value} != 0.0 else 0)"
    if kind == "Float32":
        return f"(int64(float32({value}).view(int32)) & 0xFFFFFFFF)"
    low, high = _ends(kind)
    return f"int64(floor(min(max({value}, {low!r}), {high!r}) + 0.5))"


def decode(kind: str, bits: str) -> str:
    """Return the source expression that converts the low bytes of an integer to a float."""
    if kind.startswith("Boolean"):
        return f"(1.0 if ({bits} & {2 ** (8 * int(kind[7:])) - 1}) != 0 else 0.0)"
    if kind == "Float32":
        return f"float64(int32(({bits} << 32) >> 32).view(float32))"
    signed, width = INTEGERS[kind]
    if width == 64:
        return f"float64({bits})"
    if signed:
        return f"float64(({bits} << {64 - width}) >> {64 - width})"
    return f"float64({bits} & {2**width - 1})"


@functools.cache
def compile_fmu_adapter(
    version: int,
    inputs: tuple[Wire, ...],
    outputs: tuple[Wire, ...],
    params: tuple[Wire, ...],
    gains: tuple[str, ...],
    *,
    width: int,
    remade: int | None,
    effectors: tuple[tuple[str, int], ...],
) -> Any:
    """Compile the loop for an assignment of variables.

    ``remade`` is the number of states stored in the lanes and set at each tick. ``effectors`` are
    the names and rows of the commanded effectors. One call sets or reads all variables that are
    64-bit floats; each variable of another type has eight bytes and a separate call.
    """
    written = dict(zip(COMMAND_FIELDS, COMMAND_ROWS, strict=True)) | {
        f"effectors.{name}": row for name, row in effectors
    }

    lane = functools.partial(lane_of, width)

    def source(name: str) -> str:
        group, _, field = name.partition(".")
        if name in INPUT_ROWS:
            return lane(INPUT_ROWS[name])
        if group == "reference":
            return f"row[r + {REFERENCE.index(field)}]"
        return "time" if group == "time" else f"column[k + {gains.index(field)}]"

    def to_fmu(wire: Wire) -> str:
        value = source(wire.name)
        return (
            value
            if (wire.factor, wire.offset) == (1.0, 0.0)
            else f"({value} - {wire.offset!r}) / {wire.factor!r}"
        )

    def from_fmu(field: str) -> str:
        for i, wire in enumerate(outputs):
            if wire.name == field:
                is_unscaled = (wire.factor, wire.offset) == (1.0, 0.0)
                return (
                    f"out[{i}]" if is_unscaled else f"{wire.offset!r} + {wire.factor!r} * out[{i}]"
                )
        return "inf"

    n_params, n_inputs, n_floats = (
        sum(wire.kind == FLOAT for wire in group) for group in (params, inputs, outputs)
    )
    typed = [*params[n_params:], *inputs[n_inputs:], *outputs[n_floats:]]
    n_outputs = len(outputs)
    at_outputs = 8 * (n_params + n_inputs)
    at_flags = at_outputs + 8 * n_outputs
    at_states = at_flags + 8 * FLAGS
    at_typed = at_states + 8 * (remade or 0)

    def call(function: str, group: str, numbers: int, byte: int) -> str:
        count = f", {numbers}" if version == 3 else ""
        return f"call_c({function}, (instance, {group}, {numbers}, place + {byte}{count}))"

    def call_typed(wire: Wire) -> str:
        k = typed.index(wire)
        count = ", 1" if version == 3 else ""
        arguments = f"(instance, typed_references + {4 * k}, 1, place + {at_typed + 8 * k}{count})"
        return f"failed = max(failed, call_c(context[{15 + k}], {arguments}))"

    typed_in, typed_out = inputs[n_inputs:], outputs[n_floats:]
    set_typed = [call_typed(wire) for wire in typed_in]
    fill = [f"value[{i}] = {to_fmu(wire)}" for i, wire in enumerate(inputs[:n_inputs])]
    for wire in typed_in:
        fill += [
            f"number_in = {to_fmu(wire)}",
            "total += number_in",
            f"slots[{typed.index(wire)}] = bits_float({encode(wire.kind, 'number_in')})",
        ]
    read = [call_typed(wire) for wire in typed_out]
    for i, wire in enumerate(typed_out, n_floats):
        bits = f"float_bits(slots[{typed.index(wire)}])"
        read.append(f"out[{i}] = {decode(wire.kind, bits)}")
    rows = [lane(MEMORY + i) for i in range(remade or 0)]
    timing = "(instance, no, 0.0, time, no, 0.0)"
    put_inputs = call("put", "inputs", n_inputs, 8 * n_params)
    begin = [f"failed = max(failed, call_c(setup, {timing}))"] if version == 2 else []
    if n_params:
        begin.append(f"failed = max(failed, {call('put', 'params', n_params, 0)})")
    begin += [call_typed(wire) for wire in params[n_params:]]
    if rows:
        begin += ["if tick > 0:", *(f"    kept[{i}] = {row}" for i, row in enumerate(rows))]
        begin.append(f"    failed = max(failed, {call('put', 'states', len(rows), at_states)})")
    begin.append(
        f"failed = max(failed, call_c(enter, {timing if version == 3 else '(instance,)'}))"
    )
    begin += [
        f"failed = max(failed, {put_inputs})",
        *set_typed,
        "failed = max(failed, call_c(leave, (instance,)))",
    ]
    keep = [f"    {row} = kept[{i}]" for i, row in enumerate(rows)]
    keep = (
        ["if failed <= 1:", f"    failed = {call('get', 'states', len(rows), at_states)}", *keep]
        if rows
        else []
    )
    flag_pointers = ", flags, flags + 8, flags + 16, flags + 24" if version == 3 else ""
    setup = f"""\
reset, setup, enter, leave = context[0], context[1], context[2], context[3]
put, step, get = context[4], context[5], context[6]
params, inputs, outputs, states = context[7], context[8], context[9], context[10]
place, instances = context[11], context[12]
value, out, flags = floats_at(place + {8 * n_params}), floats_at(place + {at_outputs}), \
place + {at_flags}
numbers, kept = floats_at(instances), floats_at(place + {at_states})
slots, typed_references = floats_at(place + {at_typed}), context[{15 + len(typed)}]
time, r, k = tick * dt, tick * {len(REFERENCE)}, tick * {len(gains)}"""
    body = f"""\
instance = float_bits(numbers[number])
{indent(0, fill)}
for i in range({n_inputs}):
    total += value[i]
if {"tick == 0" if remade is None else "True"}:
    failed = call_c(reset, (instance,))
{indent(4, begin)}
if failed <= 1:
    failed = {put_inputs}
{indent(4, set_typed)}
if failed <= 1 and total - total == 0.0:
    failed = call_c(step, (instance, time, dt, yes{flag_pointers}))
if failed <= 1:
    failed = {call("get", "outputs", n_floats, at_outputs)}
{indent(4, read)}
{indent(0, keep)}"""
    names: dict[str, Any] = {"float_bits": float_bits, "yes": np.int32(1), "no": np.int32(0)}
    if typed:
        names |= {**NAMES, "bits_float": bits_float}
    texts = {row: from_fmu(field) for field, row in written.items()}
    instance_slot = (14, "context[13]") if remade is None else None
    return build_native(width, setup, body, "failed > 1", n_outputs, texts, instance_slot, names)
