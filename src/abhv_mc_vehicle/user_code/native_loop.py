"""Loop over lanes that calls native code, used for laws in C and FMUs."""

from collections.abc import Callable, Mapping
from textwrap import indent
from typing import Any, NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.source import UserSource
from abhv_mc_vehicle.kernel.jit_pointer import call_c, floats_at
from abhv_mc_vehicle.kernel.laws.user import FAULT, MEMORY
from abhv_mc_vehicle.user_code.compiled import LAW_FAILED, build_loop, lane_of
from abhv_mc_vehicle.user_code.law_interface import NOT_GIVEN


class OpenLaw(NamedTuple):
    """Control law that is ready to be called, with the objects that its calls require."""

    address: int
    context: int
    held: Any
    close: Callable[[], Any] = lambda: None


class LawBackend(NamedTuple):
    """Functions that prepare a control law in native code for flights.

    ``open`` prepares the law for flights; its arguments are those of
    :func:`abhv_mc_vehicle.user_code.c_law.open_c_law`, and it may raise InputError. ``find_memory``
    takes the source, the settings and the first row of the reference. It returns the initial values
    of the law's memory by name, or None if the law does not expose its memory. ``find_misfits``
    takes the source and returns the mismatches between controller file and law, each as keys, value
    found and value expected. ``find_memory`` and ``find_misfits`` run in a child process. See
    :mod:`abhv_mc.entry_points`.
    """

    open: Callable[..., OpenLaw]
    find_memory: Callable[[UserSource, Floats, Floats], dict[str, float] | None]
    find_misfits: Callable[[UserSource], list[tuple[tuple[str, str], str, str]]] | None = None


def build_native(
    width: int,
    before: str,
    body: str,
    bad: str,
    outputs: int,
    written: Mapping[int, str],
    slot: tuple[int, str] | None,
    names: dict[str, Any],
) -> Any:
    """Compile the loop over lanes that calls native code.

    ``before`` contains the lines before the loop, ``body`` the lines for each lane, and ``written``
    the value stored in each row after the body. The body sets ``total`` (NaN if the law cannot be
    evaluated), ``failed`` and the ``outputs`` numbers in ``out``. The flight ends if the expression
    ``bad`` is true. Each lane stores the index of the memory of its flight. ``slot`` contains the
    position of the next index in the context and the number of indices; it is None if rows of lane
    memory store the law's memory.
    """
    lane = f"""\
if Z[{FAULT * width} + lane] > 0.0:
    continue
number, total, failed = lane, 0.0, 0
{_find_place(width, *slot) if slot else ""}
{body}
if {bad}:
    Z[{FAULT * width} + lane] = {LAW_FAILED}
    for i in range({outputs}):
        out[i] = 0.0
elif total - total != 0.0:
    out[0] = nan
"""
    lane += "".join(f"{lane_of(width, row)} = {value}\n" for row, value in written.items())
    head = f"def loop(context, Z, row, column, given, tick, dt):\n{indent(before, ' ' * 4)}\n"
    text = f"{head}    for lane in range({width}):\n{indent(lane, ' ' * 8)}"
    names_of_loop = {
        "floats_at": floats_at,
        "call_c": call_c,
        "inf": NOT_GIVEN,
        "nan": float("nan"),
    }
    return build_loop("native", text, names_of_loop | names)


def _find_place(width: int, following: int, n_states: str) -> str:
    slot = f"Z[{MEMORY * width} + lane]"
    return f"""\
if tick == 0:
    number = context[{following}]
    context[{following}] = (number + 1) % {n_states}
    {slot} = number
else:
    number = int({slot})"""
