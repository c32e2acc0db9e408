"""Loop over lanes that calls native code, and loading of control laws in C.

FMUs use the same loop.

The loop over the lanes (SIMD lanes, one flight each) fills the structs of abhv_law.h and calls the
step function. Each lane stores the index of the state of its flight. Native code runs in workers
and the child process, never in the main process.
"""

import ctypes
import functools
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import indent
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import check_may_run
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError, counted
from abhv_mc_vehicle.kernel.jit_pointer import address_of, call_c, floats_at
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.user import FAULT, MAX_MEMORY, MEMORY
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ACTUATORS
from abhv_mc_vehicle.user_code.compiled import (
    COMMAND_ROWS,
    LAW_FAILED,
    ONBOARD_ROWS,
    build_loop,
    lane_of,
)
from abhv_mc_vehicle.user_code.effector_commands import effector_rows
from abhv_mc_vehicle.user_code.law_interface import NOT_GIVEN
from abhv_mc_vehicle.user_code.law_source import describe_layout, interface
from abhv_mc_vehicle.user_code.unpack import BUILT, unpack


class OpenLaw(NamedTuple):
    """Control law that is ready to be called, with the objects that its calls require."""

    address: int
    context: int
    held: Any
    close: Callable[[], Any] = lambda: None


class LawBackend(NamedTuple):
    """Functions that prepare a control law in native code for flights.

    ``open`` prepares the law for flights; its arguments are those of
    :func:`open_c_law`, and it may raise InputError. ``find_memory``
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


_SYSTEM = (
    "/lib",
    "/lib64",
    "/usr/lib",
    "/usr/lib64",
    "/System",
    "/usr/local/lib",
    sys.prefix,
    sys.base_prefix,
)
_LINE = 64  # alignment of each flight's state, bytes
# offsets of the command and of the memory in the buffer, bytes
_COMMAND = 8 * (s.N_SEEN + len(ONBOARD_ROWS))
_NUMBERS = _COMMAND + 8 * (len(COMMAND_ROWS) + MAX_ACTUATORS)


class CLibrary(NamedTuple):
    """Addresses of the functions of a loaded library, 0 for missing optional functions."""

    init: int
    step: int
    get: int
    set: int
    state_size: int  # size of the state of a flight, bytes
    handle: Any


@functools.lru_cache(maxsize=16)
def load_library(source: UserSource) -> CLibrary:
    """Load the shared library of a control law into this process.

    Raise InputError if the library is not a control law or was built for another interface.
    """
    check_may_run()
    recipe: Any = source.recipe
    path = unpack(source) / (recipe["library"] or BUILT)
    before = _mapped()
    try:
        handle = ctypes.CDLL(str(path), mode=os.RTLD_NOW | os.RTLD_LOCAL)
    except OSError as error:
        message = str(error).replace(str(path.parent) + os.sep, "")
        missing = f"'files: [{message.partition(':')[0]}]' in the controller file"
        expected = missing if "cannot open shared object" in message else "a shared library"
        raise InputError(
            source.file, f"the library cannot be loaded ({message})", expected
        ) from None
    allowed = tuple(f"{os.path.realpath(folder)}{os.sep}" for folder in (path.parent, *_SYSTEM))
    for loaded in sorted(_mapped() - before):
        if not loaded.startswith(allowed):
            raise InputError(
                source.file,
                f"the library links to {loaded}, which is not declared",
                f"'files: [{Path(loaded).name}]' in the controller file",
            )

    def find(name: str) -> int:
        problem = getattr(handle, f"abhv_law_{name}", None)
        return 0 if problem is None else int(ctypes.cast(problem, ctypes.c_void_p).value or 0)

    size, init, step, get, put = map(find, ("state_size", "init", "step", "state_get", "state_set"))
    for name in ("state_size", "init", "step"):
        if not find(name):
            raise InputError(
                source.file,
                f"the library has no function abhv_law_{name}",
                "a library with this function, as declared in abhv_law.h",
            )
    if (get == 0) != (put == 0):
        raise InputError(
            source.file,
            f"the library has only abhv_law_state_{'get' if get else 'set'}",
            "both abhv_law_state_get and abhv_law_state_set, or neither",
        )
    if address := find("interface"):
        version = ctypes.string_at(address).decode(errors="replace")
        expected = f"{interface(recipe['onboard'])} {describe_layout(recipe['settings'])}"
        if version != expected:
            raise InputError(
                source.file,
                f"the library was built with other headers ({version})",
                f"a library built with the headers of this controller ({expected})",
            )
    return CLibrary(init, step, get, put, int(ctypes.CFUNCTYPE(ctypes.c_size_t)(size)()), handle)


def _mapped() -> set[str]:
    """Return the files from which this process has loaded code, if the system lists them."""
    try:
        lines = Path("/proc/self/maps").read_text("utf-8").splitlines()
    except OSError:
        return set()
    return {os.path.realpath(line.split(maxsplit=5)[5]) for line in lines if line.count("/")}


def find_c_memory(source: UserSource, settings: Floats, first: Floats) -> dict[str, float] | None:
    """Return the initial values of a control law's memory by name, or None.

    The result is None if the law does not expose its memory. This function must be called in the
    child process. Raise InputError if the initialization of the law fails.
    """
    library = load_library(source)
    if not library.get:
        return {} if library.state_size == 0 else None
    state = aligned_zeros(library.state_size // 8 + 8)
    setting_values = np.append(settings, 0.0)
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    if call(library.init)(
        setting_values.ctypes.data, np.ascontiguousarray(first).ctypes.data, state.ctypes.data
    ):
        raise InputError(source.file, "the function abhv_law_init failed", "the return value 0")
    read = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(library.get)
    count = read(state.ctypes.data, None)
    if not 0 <= count <= MAX_MEMORY:
        raise InputError(
            source.file,
            f"the memory of the law has {counted(count, 'number')}",
            f"0 to {MAX_MEMORY}",
        )
    values = np.zeros(count + 1)
    read(state.ctypes.data, values.ctypes.data)
    return {f"memory_{i}": value for i, value in enumerate(values[:count].tolist())}


def open_c_law(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    n_states: int,
    memory: int | None,
    seen: int,
    effectors: tuple[str, ...],
) -> OpenLaw:
    """Return the control law for ``width`` lanes and ``n_states`` simultaneous flights.

    ``effectors`` are the vehicle's effectors. If the law exposes its memory of ``memory`` numbers,
    these numbers are stored in rows of lane memory, as for a compiled law, and the state of the law
    is restored from these rows at each tick. Only the first ``seen`` measured quantities are passed
    to the law; the others are NaN.
    """
    library = load_library(source)
    recipe: Any = source.recipe
    loop = compile_adapter(width, memory, seen, recipe["onboard"], effector_rows(source, effectors))
    stride = -(-max(library.state_size, 1) // _LINE) * _LINE
    states = aligned_zeros(stride // 8 * n_states)
    buffer = aligned_zeros(_NUMBERS // 8 + MAX_MEMORY)
    buffer[seen : s.N_SEEN] = np.nan
    addresses = [library.init, library.step, library.get, library.set]
    context = np.array(
        [*addresses, states.ctypes.data, stride, n_states, 0, len(gains), buffer.ctypes.data],
        np.int64,
    )
    return OpenLaw(
        int(loop.address), int(context.ctypes.data), (loop, states, buffer, context, library)
    )


@functools.cache
def compile_adapter(
    width: int, memory: int | None, n_measured: int, onboard: bool, effectors: tuple[int, ...]
) -> Any:
    """Return the compiled loop that calls a control law in C.

    ``memory`` and ``n_measured`` are the arguments ``memory`` and ``seen`` of :func:`open_c_law`.
    ``effectors`` are the lane-memory rows of the commanded effectors.
    """
    commanded = (*COMMAND_ROWS, *effectors)
    lane_row = functools.partial(lane_of, width)
    rows = [lane_row(MEMORY + i) for i in range(memory or 0)]
    before = f"""\
init, step, get, put = context[0], context[1], context[2], context[3]
states, stride, places, buffer = context[4], context[5], context[6], context[9]
seen, out, numbers = floats_at(buffer), floats_at(buffer + {_COMMAND}), \
floats_at(buffer + {_NUMBERS})
first, reference = address_of(row), address_of(row) + {8 * len(REFERENCE)} * tick
gains, settings, time = address_of(column) + 8 * context[8] * tick, address_of(given), tick * dt"""
    lines = f"""\
state = states + number * stride
if {"tick == 0" if memory is None else "True"}:
    words = floats_at(state)
    for i in range(stride // 8):
        words[i] = 0.0
    failed = call_c(init, (settings, first, state))
""".splitlines()
    if rows:
        lines.append("if tick > 0 and failed == 0:")
        lines += [f"    numbers[{i}] = {row}" for i, row in enumerate(rows)]
        lines.append(f"    failed = call_c(put, (state, buffer + {_NUMBERS}))")
    lines += [f"seen[{i}] = {lane_row(s.MEASURED + i)}" for i in range(n_measured)]
    lines += [f"total += seen[{i}]" for i in range(s.N_MEASURED)]
    lines += [
        f"seen[{s.N_SEEN + i}] = {lane_row(row)}"
        for i, row in enumerate(ONBOARD_ROWS if onboard else ())
    ]
    lines += f"""\
for i in range(4, {len(commanded)}):
    out[i] = inf
if failed == 0 and total - total == 0.0:
    failed = call_c(step, (buffer, reference, gains, settings, time, dt, state, \
buffer + {_COMMAND}))
""".splitlines()
    if rows:
        lines += ["if failed == 0:", f"    call_c(get, (state, buffer + {_NUMBERS}))"]
        lines += [f"    {row} = numbers[{i}]" for i, row in enumerate(rows)]
    written = {row: f"out[{i}]" for i, row in enumerate(commanded)}
    slot = (7, "places") if memory is None else None
    names = {"address_of": address_of}
    return build_native(
        width, before, "\n".join(lines), "failed != 0", len(commanded), written, slot, names
    )
