"""A law as an FMU for co-simulation (FMI 2.0, 3.0): unpacked and described by fmpy, called by its functions' addresses.

One instance flies a flight from its start to its end and is reset for the next one; a flight's lane holds its number.
A control tick sets the inputs, makes one communication step of the control period and reads the outputs, which are
the commands of this tick. Where slopes are taken, the states that the FMU names are set as start values at each tick.
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

from abhv_mc.io.input_error import InputError, Refusal, one_of
from abhv_mc.io.units import parse_any, parse_unit, unit_of
from abhv_mc.kernel.compiler_target import code_folder
from abhv_mc.kernel.jit import compiler
from abhv_mc.kernel.laws.user import MAX_MEMORY
from abhv_mc.user_code.c_source import recipe_of, refuse_platform
from abhv_mc.user_code.child import may_run_here
from abhv_mc.user_code.effector_commands import effector_rows, find_commanded
from abhv_mc.user_code.fmu_loop import FLAGS, Wire, compile_fmu_adapter
from abhv_mc.user_code.law_interface import find_unit
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import unpack

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


class Fmu(NamedTuple):
    """An FMU in this process."""

    version: int
    dll: Any
    instantiate: Callable[[], int]  # a new instance's address, 0 where there is none
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    params: tuple[Wire, ...]
    states: dict[str, tuple[int, float | None]]  # reference and start value of the states that it names


@functools.lru_cache(maxsize=16)
def load_fmu(source: UserSource) -> Fmu:
    """Unpack an FMU and load its library into this process. Raises InputError for what cannot fly."""
    if not may_run_here():
        raise RuntimeError("native code of a user's is run by workers and the child alone")
    if (words := refuse_platform(source)) is not None:
        raise InputError(source.file, words, "an FMU flown where it was read")
    try:
        import fmpy
    except ImportError:
        wish = "pip install 'abhv-mc[fmu]'"
        raise InputError(source.file, "no fmpy in this installation", wish) from None
    recipe: Any = recipe_of(source)
    try:
        folder = _unzip(source, recipe["file"])
        described = fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # of zipfile, lxml and fmpy alike
        raise InputError(source.file, f"no FMU that can be read ({error})", "an FMU") from None
    version = int(described.fmiVersion[0])
    simulation = described.coSimulation
    if version not in _FUNCTIONS or simulation is None:
        found = f"an FMU of FMI {described.fmiVersion}{'' if simulation else ' without co-simulation'}"
        raise InputError(source.file, found, "co-simulation of FMI 2.0 or 3.0")
    if simulation.canBeInstantiatedOnlyOncePerProcess:
        found = "an FMU that can be instantiated only once a process"
        raise InputError(source.file, found, "one instance a flight, many side by side")
    wiring = _Wiring(source, described, version)
    platform = fmpy.platform if version == 2 else fmpy.platform_tuple
    library = folder / "binaries" / platform / f"{simulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    try:
        dll = ctypes.CDLL(str(library))
        for name in (*_FUNCTIONS[version], "FreeInstance", _INSTANTIATE[version]):
            getattr(dll, f"fmi{version}{name}")
    except (OSError, AttributeError) as error:
        found = f"an FMU whose library does not load here ({error})"
        raise InputError(source.file, found, "one with binaries for this platform") from None
    inputs = tuple(wiring.wire(name, wired) for name, wired in recipe["inputs"].items())
    outputs = tuple(
        wiring.wire(name, f"effectors.{field}" if field in recipe["effectors"] else field)
        for field, name in recipe["outputs"].items()
    )
    return Fmu(
        version,
        dll,
        _make_instantiate(version, dll, described, folder),
        inputs,
        outputs,
        tuple(wiring.wire(name, "", value) for name, value in recipe["params"].items()),
        {
            state.name: (int(state.valueReference), None if state.start is None else float(state.start))
            for state in (rate.variable.derivative for rate in described.derivatives)
        },
    )


def find_states(source: UserSource) -> dict[str, float] | None:
    """The states of an FMU as they start; None where one cannot be set. Called in the child."""
    starts = {name: start for name, (_, start) in load_fmu(source).states.items() if start is not None}
    return starts if len(starts) == len(load_fmu(source).states) <= MAX_MEMORY else None


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


def _unzip(source: UserSource, name: str) -> Path:
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
    source: UserSource
    described: Any
    version: int

    def wire(self, name: str, wired: str, value: str | float | None = None) -> Wire:
        """A variable and what it is wired to, or a parameter and its ``value``.

        Raises InputError for a variable that there is not, of another type, or in a unit of another dimension.
        """
        variables = {variable.name: variable for variable in self.described.modelVariables}
        variable = variables.get(name)
        if variable is None:
            raise InputError(self.source.file, f"no variable '{name}'", one_of(variables, name))
        if variable.type not in ("Real", "Float64") or variable.shape:
            found = f"the variable '{name}' of the type {variable.type}"
            raise InputError(self.source.file, found, "a scalar floating point number")
        unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
        factor, offset = self._find_unit(name, unit, wired, value) if unit else (1.0, 0.0)
        return Wire(wired, int(variable.valueReference), factor, offset)

    def _find_unit(self, name: str, unit: str, wired: str, value: str | float | None) -> tuple[float, float]:
        base = {each.name: each.baseUnit for each in self.described.unitDefinitions}.get(unit)
        try:
            factor, exponents = parse_unit(unit) if base is None else (base.factor, (base.m, base.kg, base.s, base.rad))
        except Refusal:
            found = f"the unit '{unit}' of '{name}', which the FMU does not define"
            raise InputError(self.source.file, found, "a unit with its base units") from None
        expected = find_unit(wired) if value is None else unit_of(value)
        given = parse_unit(expected or "")[1]
        places = 4 if value is not None and not any(given) else 3  # radians are often left out
        if expected is not None and exponents[:places] != given[:places]:
            found = f"'{name}' in {unit}" if value is None else f"'{name}: {value}' of a parameter in {unit}"
            raise InputError(self.source.file, found, f"a quantity in {expected if value is None else unit}")
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


def open_fmu(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    places: int,
    memory_in_rows: bool = False,
    effectors: tuple[str, ...] = (),
) -> FmuFlights:
    """The law for ``width`` lanes, with instances for ``places`` flights; ``effectors`` are the vehicle's.

    With ``memory_in_rows`` the lanes' rows hold the states that the FMU names, as those of a compiled law, and an
    instance is reset and given them at each tick. Raises InputError.
    """
    fmu = load_fmu(source)
    states = tuple(reference for reference, _ in fmu.states.values()) if memory_in_rows else ()
    places = width if memory_in_rows else places
    unknown = [wire.name for wire in fmu.inputs if wire.name.startswith("gains.") and wire.name[6:] not in gains]
    if unknown:
        raise InputError(source.file, f"an input from '{unknown[0]}'", one_of([f"gains.{g}" for g in gains]))
    recipe: Any = recipe_of(source)
    remade = len(states) if memory_in_rows else None
    rows = tuple(zip(find_commanded(source), effector_rows(source, effectors), strict=True))
    loop = compile_fmu_adapter(fmu.version, fmu.inputs, fmu.outputs, len(fmu.params), gains, width, remade, rows)
    instances = np.array([fmu.instantiate() for _ in range(places)], np.int64)
    if not instances.all():
        raise InputError(source.file, "an FMU that makes no instance", "one for each of many flights")
    starts = [
        (parse_any(value) - wire.offset) / wire.factor
        for wire, value in zip(fmu.params, recipe["params"].values(), strict=True)
    ]
    values = np.append(starts, np.zeros(len(fmu.inputs) + len(fmu.outputs) + FLAGS + len(states)))
    groups = [tuple(wire.reference for wire in group) for group in (fmu.params, fmu.inputs, fmu.outputs)]
    references = [np.array(group or [0], np.uint32) for group in (*groups, states)]
    prefix = f"fmi{fmu.version}"
    functions = [
        int(ctypes.cast(getattr(fmu.dll, prefix + name), ctypes.c_void_p).value or 0)
        for name in _FUNCTIONS[fmu.version]
    ]
    pointers = [array.ctypes.data for array in (*references, values, instances)]
    context = np.array([*functions, *pointers, places, 0], np.int64)
    return FmuFlights(int(loop.address), int(context.ctypes.data), fmu, instances, (loop, values, references, context))
