"""A law as an FMU for co-simulation (FMI 2.0, 3.0): unpacked and described by fmpy, called by its functions' addresses.

One instance flies a flight from its start to its end and is reset for the next one; a flight's lane holds its number.
A control tick sets the inputs, makes one communication step of the control period and reads the outputs, which are
the commands of this tick.
"""

import contextlib
import ctypes
import functools
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.compiler_target import code_folder
from abhv_mc.control.columns import REFERENCE
from abhv_mc.control.laws.user import FAULT, MEMORY
from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.units import parse_unit
from abhv_mc.jit import compiler
from abhv_mc.jit_pointer import call_c, floats_at
from abhv_mc.numerics.float_bits import float_bits
from abhv_mc.plant import state as s
from abhv_mc.user_code.c_source import recipe_of, refuse_platform
from abhv_mc.user_code.child import may_run_here
from abhv_mc.user_code.compiled import COMMAND_ROWS, build_loop
from abhv_mc.user_code.law_interface import COMMAND_FIELDS, NOT_GIVEN, Measured, find_unit
from abhv_mc.user_code.plain import LAW_FAILED
from abhv_mc.user_code.source import OwnSource
from abhv_mc.user_code.unpack import unpack

_INITIALIZATION = ("EnterInitializationMode", "ExitInitializationMode")
_INSTANTIATE = {2: "Instantiate", 3: "InstantiateCoSimulation"}
_FUNCTIONS = {  # by version: what sets up a flight, then what a tick calls
    2: (
        "Reset",
        "SetupExperiment",
        "EnterInitializationMode",
        "ExitInitializationMode",
        "SetReal",
        "DoStep",
        "GetReal",
    ),
    3: ("Reset", "Reset", "EnterInitializationMode", "ExitInitializationMode", "SetFloat64", "DoStep", "GetFloat64"),
}


class Wire(NamedTuple):
    """A variable of the FMU and the quantity that it is wired to: SI is ``offset + factor * value``."""

    name: str  # measured.altitude, gains.k, time, or a field of Command
    reference: int
    factor: float
    offset: float


class Fmu(NamedTuple):
    """An FMU in this process."""

    version: int
    dll: Any
    instantiate: Callable[[], int]  # a new instance's address, 0 where there is none
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    params: tuple[Wire, ...]


@functools.lru_cache(maxsize=16)
def load_fmu(source: OwnSource) -> Fmu:
    """Unpack an FMU and load its library into this process. Raises InputError for what cannot fly."""
    if not may_run_here():
        raise RuntimeError("native code of a user's is run by workers and the child alone")
    if (words := refuse_platform(source)) is not None:
        raise InputError(source.file, None, None, words, "an FMU flown where it was read")
    try:
        import fmpy
    except ImportError:
        wish = "pip install 'abhv-mc[fmu]'"
        raise InputError(source.file, None, None, "no fmpy in this installation", wish) from None
    recipe: Any = recipe_of(source)
    try:
        folder = _unzip(source, recipe["file"])
        described = fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # of zipfile, lxml and fmpy alike
        raise InputError(source.file, None, None, f"no FMU that can be read ({error})", "an FMU") from None
    version = int(described.fmiVersion[0])
    simulation = described.coSimulation
    if version not in _FUNCTIONS or simulation is None:
        found = f"an FMU of FMI {described.fmiVersion}{'' if simulation else ' without co-simulation'}"
        raise InputError(source.file, None, None, found, "co-simulation of FMI 2.0 or 3.0")
    if simulation.canBeInstantiatedOnlyOncePerProcess:
        found = "an FMU that can be instantiated only once a process"
        raise InputError(source.file, None, None, found, "one instance a flight, many side by side")
    wiring = _Wiring(source, described, version)
    platform = fmpy.platform if version == 2 else fmpy.platform_tuple
    library = folder / "binaries" / platform / f"{simulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    try:
        dll = ctypes.CDLL(str(library))
        for name in (*_FUNCTIONS[version], "FreeInstance", _INSTANTIATE[version]):
            getattr(dll, f"fmi{version}{name}")
    except (OSError, AttributeError) as error:
        found = f"an FMU whose library does not load here ({error})"
        raise InputError(source.file, None, None, found, "one with binaries for this platform") from None
    inputs = tuple(wiring.wire(name, wired) for name, wired in recipe["inputs"].items())
    outputs = tuple(wiring.wire(name, field) for field, name in recipe["outputs"].items())
    return Fmu(
        version,
        dll,
        _make_instantiate(version, dll, described, folder),
        inputs,
        outputs,
        tuple(wiring.wire(name, "") for name in recipe["params"]),
    )


def _make_instantiate(version: int, dll: Any, described: Any, folder: Path) -> Callable[[], int]:
    """What makes an instance, by the structures of fmpy; without messages, which nobody would read."""
    from fmpy import fmi2, fmi3

    make = getattr(dll, f"fmi{version}{_INSTANTIATE[version]}")
    make.restype = ctypes.c_void_p
    name, token = described.coSimulation.modelIdentifier.encode(), described.guid.encode()
    if version == 2:
        where = (folder / "resources").as_uri().encode()
        callbacks = ctypes.byref(fmi2.defaultCallbacks)
        return lambda: int(make(name, 1, token, where, callbacks, 0, 0) or 0)
    where = f"{folder / 'resources'}{os.sep}".encode()
    log = fmi3.fmi3LogMessageCallback(fmi3.printLogMessage)
    no, none = ctypes.c_bool(False), fmi3.fmi3IntermediateUpdateCallback()
    return lambda: int(make(name, token, where, no, no, no, no, None, ctypes.c_size_t(0), None, log, none) or 0)


def _unzip(source: OwnSource, name: str) -> Path:
    import fmpy

    laws = code_folder(compiler()) / "laws"
    folder = laws / f"fmu_{source.hash[:24]}"
    if not folder.exists():
        made = tempfile.mkdtemp(dir=laws)
        fmpy.extract(str(unpack(source) / name), made)
        with contextlib.suppress(OSError):  # another process was first
            Path(made).rename(folder)
        shutil.rmtree(made, ignore_errors=True)
    return folder


@dataclass(frozen=True)
class _Wiring:
    source: OwnSource
    described: Any
    version: int

    def wire(self, name: str, wired: str) -> Wire:
        """Raises InputError for a variable that there is not, of another type, or in a unit of another dimension."""
        variables = {variable.name: variable for variable in self.described.modelVariables}
        variable = variables.get(name)
        if variable is None:
            raise InputError(self.source.file, None, None, f"no variable '{name}'", one_of(variables, name))
        if variable.type not in ("Real", "Float64") or variable.shape:
            found = f"the variable '{name}' of the type {variable.type}"
            raise InputError(self.source.file, None, None, found, "a scalar floating point number")
        unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
        factor, offset = self._find_unit(name, unit, find_unit(wired)) if unit else (1.0, 0.0)
        return Wire(wired, int(variable.valueReference), factor, offset)

    def _find_unit(self, name: str, unit: str, wanted: str | None) -> tuple[float, float]:
        base = {each.name: each.baseUnit for each in self.described.unitDefinitions}.get(unit)
        try:
            factor, exponents = parse_unit(unit) if base is None else (base.factor, (base.m, base.kg, base.s, base.rad))
        except Refusal:
            found = f"the unit '{unit}' of '{name}', which the FMU does not define"
            raise InputError(self.source.file, None, None, found, "a unit with its base units") from None
        if wanted is not None and exponents[:3] != parse_unit(wanted)[1][:3]:  # radians are often left out
            raise InputError(self.source.file, None, None, f"'{name}' in {unit}", f"a quantity in {wanted}")
        return factor, 0.0 if base is None else base.offset


@dataclass(frozen=True)
class FmuFlights:
    """An FMU's instances for the flights of one call: what the kernel calls, and all that must live meanwhile."""

    address: int
    context: int
    fmu: Fmu
    instances: np.ndarray
    held: tuple[Any, ...]

    def close(self) -> None:
        """Free every instance."""
        free = getattr(self.fmu.dll, f"fmi{self.fmu.version}FreeInstance")
        free.argtypes, free.restype = [ctypes.c_void_p], None
        for instance in self.instances.tolist():
            free(instance)


def open_fmu(source: OwnSource, gains: tuple[str, ...], width: int, places: int) -> FmuFlights:
    """The law for ``width`` lanes, with instances for ``places`` flights. Raises InputError."""
    fmu = load_fmu(source)
    unknown = [wire.name for wire in fmu.inputs if wire.name.startswith("gains.") and wire.name[6:] not in gains]
    if unknown:
        raise InputError(
            source.file, None, None, f"an input from '{unknown[0]}'", one_of([f"gains.{g}" for g in gains])
        )
    recipe: Any = recipe_of(source)
    loop = compile_fmu_adapter(fmu.version, fmu.inputs, fmu.outputs, len(fmu.params), gains, width)
    instances = np.array([fmu.instantiate() for _ in range(places)], np.int64)
    if not instances.all():
        raise InputError(source.file, None, None, "an FMU that makes no instance", "one for each of many flights")
    starts = [
        (value - wire.offset) / wire.factor for wire, value in zip(fmu.params, recipe["params"].values(), strict=True)
    ]
    values = np.array([*starts, *(0.0 for _ in range(len(fmu.inputs) + len(fmu.outputs) + 8))])
    groups = (fmu.params, fmu.inputs, fmu.outputs)
    references = [np.array([wire.reference for wire in group] or [0], np.uint32) for group in groups]
    prefix = f"fmi{fmu.version}"
    functions = [
        int(ctypes.cast(getattr(fmu.dll, prefix + name), ctypes.c_void_p).value or 0)
        for name in _FUNCTIONS[fmu.version]
    ]
    pointers = [array.ctypes.data for array in (*references, values, instances)]
    context = np.array([*functions, *pointers, places, 0], np.int64)
    return FmuFlights(int(loop.address), int(context.ctypes.data), fmu, instances, (loop, values, references, context))


_LOOP = """\
def loop(context, Z, row, column, given, tick, dt):
    reset, setup, enter, leave = context[0], context[1], context[2], context[3]
    put, step, get = context[4], context[5], context[6]
    params, inputs, outputs, place, instances = context[7], context[8], context[9], context[10], context[11]
    value, out, flags = floats_at(place + {at_inputs}), floats_at(place + {at_outputs}), place + {at_flags}
    numbers = floats_at(instances)
    time, r, k = tick * dt, tick * {columns}, tick * {gains}
    for lane in range({width}):
        if Z[{fault} + lane] > 0.0:
            continue
        if tick == 0:
            number = context[13]
            context[13] = (number + 1) % context[12]
            Z[{memory} + lane] = number
        else:
            number = int(Z[{memory} + lane])
            if lane > 0 and Z[{memory} + lane] == Z[{memory} + lane - 1]:  # a spare lane that repeats a flight
{repeat}
                continue
        instance, failed, total = float_bits(numbers[number]), 0, 0.0
{fill}
        for i in range({n_inputs}):
            total += value[i]
        if tick == 0:
            failed = call_c(reset, (instance,))
{begin}
        if failed <= 1:
            failed = call_c(put, (instance, inputs, {n_inputs}, place + {at_inputs}{count_inputs}))
        if failed <= 1 and total - total == 0.0:
            failed = call_c(step, (instance, time, dt, yes{flags}))
        if failed <= 1:
            failed = call_c(get, (instance, outputs, {n_outputs}, place + {at_outputs}{count_outputs}))
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
        "failed = max(failed, call_c(setup, (instance, no, 0.0, 0.0, no, 0.0)))",
        "failed = max(failed, call_c(enter, (instance,)))",
    ),
    3: ("failed = max(failed, call_c(enter, (instance, no, 0.0, 0.0, no, 0.0)))",),
}


@functools.cache
def compile_fmu_adapter(
    version: int, inputs: tuple[Wire, ...], outputs: tuple[Wire, ...], params: int, gains: tuple[str, ...], width: int
) -> Any:
    """The compiled loop for a wiring."""

    def at(row: int) -> str:
        return f"Z[{row * width} + lane]"

    def lines(indent: int, items: list[str]) -> str:
        return "\n".join(" " * indent + item for item in items)

    def source(name: str) -> str:
        group, _, field = name.partition(".")
        if group == "measured":
            return at(s.MEASURED + Measured._fields.index(field))
        if group == "reference":
            return f"row[r + {REFERENCE.index(field)}]"
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
    count = {2: "", 3: ", {}"}[version]
    begin = list(_BEGIN[version])
    if params:
        sets = f"failed = max(failed, call_c(put, (instance, params, {params}, place{count.format(params)})))"
        begin.insert(len(begin) - 1, sets)
    into = f"place + {at_inputs}{count.format(len(inputs))}"
    begin.append(f"failed = max(failed, call_c(put, (instance, inputs, {len(inputs)}, {into})))")
    begin.append("failed = max(failed, call_c(leave, (instance,)))")
    text = _LOOP.format(
        at_inputs=at_inputs,
        at_outputs=at_outputs,
        at_flags=at_flags,
        columns=len(REFERENCE),
        gains=len(gains),
        width=width,
        fault=FAULT * width,
        memory=MEMORY * width,
        n_inputs=len(inputs),
        n_outputs=len(outputs),
        count_inputs=count.format(len(inputs)),
        count_outputs=count.format(len(outputs)),
        repeat=lines(16, [f"{at(row)} = {at(row)[:-1]} - 1]" for row in (*COMMAND_ROWS, FAULT)]),
        fill=lines(8, [f"value[{i}] = {to_fmu(wire)}" for i, wire in enumerate(inputs)]),
        begin=lines(12, begin),
        flags={2: "", 3: ", flags, flags + 8, flags + 16, flags + 24"}[version],
        law_failed=LAW_FAILED,
        write=lines(8, [f"{at(row)} = {from_fmu(f)}" for row, f in zip(COMMAND_ROWS, COMMAND_FIELDS, strict=True)]),
    )
    names = {"floats_at": floats_at, "float_bits": float_bits, "call_c": call_c, "inf": NOT_GIVEN}
    names |= {"nan": float("nan"), "yes": np.int32(1), "no": np.int32(0)}
    return build_loop("fmu", text, names)
