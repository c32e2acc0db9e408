"""What laws in C and FMUs share: the loop over the lanes in which native code is called."""

from collections.abc import Callable, Iterable, Mapping
from textwrap import indent
from typing import Any, NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc.kernel.jit_pointer import call_c, floats_at
from abhv_mc.kernel.laws.user import FAULT, MEMORY
from abhv_mc.user_code.compiled import LAW_FAILED, build_loop, lane_of
from abhv_mc.user_code.law_interface import NOT_GIVEN
from abhv_mc.user_code.source import UserSource


class OpenLaw(NamedTuple):
    """A law for the flights of one call: what the kernel calls, and all that must live meanwhile."""

    address: int
    context: int
    held: Any
    close: Callable[[], Any] = lambda: None


class LawBackend(NamedTuple):
    """Functions that make a control law in native code ready to fly.

    ``open`` takes the source, names of gains, lanes, flights at the same time, numbers of memory in the lanes' rows or
    None, measured values and names of effectors; it raises InputError. ``find_memory`` takes the source, the settings
    and the first row of the reference, and returns the numbers that the law remembers at the start by name, or None if
    it does not give them. ``find_misfits`` takes the source and returns what of the controller file does not fit the
    law: keys, what is found and what is expected. Both run in a child process. A package registers a backend in the
    group ``abhv_mc.law_backends``, by the value of ``law`` in the controller file.
    """

    open: Callable[..., OpenLaw]
    find_memory: Callable[[UserSource, Floats, Floats], dict[str, float] | None]
    find_misfits: Callable[[UserSource], list[tuple[tuple[str, str], str, str]]] | None = None


def build_native(
    width: int,
    before: str,
    each: str,
    bad: str,
    outputs: int,
    written: Mapping[int, str],
    place: tuple[int, str] | None,
    names: dict[str, Any],
) -> Any:
    """Compile a loop: lines ``before`` its lanes, those of ``each``, and what each row is then ``written`` with.

    The lines make ``total``, not-a-number where the law cannot be asked, ``failed``, by which the flight ends where it
    is ``bad``, and the numbers ``out``, so many ``outputs``. The memory of a flight lies in a ``place`` of which its
    lane holds the number: where in the context the next one's stands, and how many there are; None where the lanes'
    rows hold it.
    """
    lane = f"""\
if Z[{FAULT * width} + lane] > 0.0:
    continue
number, total, failed = lane, 0.0, 0
{_find_place(width, *place, (*written, FAULT)) if place else ""}
{each}
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
    known = {"floats_at": floats_at, "call_c": call_c, "inf": NOT_GIVEN, "nan": float("nan")}
    return build_loop("native", text, known | names)


def _find_place(width: int, following: int, places: str, rows: Iterable[int]) -> str:
    held = f"Z[{MEMORY * width} + lane"
    repeat = "\n".join(
        f"        {lane_of(width, row)} = {lane_of(width, row)[:-1]} - 1]" for row in rows
    )
    return f"""\
if tick == 0:
    number = context[{following}]
    context[{following}] = (number + 1) % {places}
    {held}] = number
else:
    number = int({held}])
    if lane > 0 and {held}] == {held} - 1]:  # a spare lane that repeats a flight
{repeat}
        continue"""
