"""A law as an FMU for co-simulation (FMI 2.0, 3.0): unpacked and described by fmpy, called by its functions' addresses.

One instance flies a flight from its start to its end and is reset for the next one; a flight's lane holds its number.
A control tick sets the inputs, makes one communication step of the control period and reads the outputs, which are
the commands of this tick. Where slopes are taken, the states that the FMU names are set as start values at each tick.
"""

import ctypes
import functools
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import parse_any, parse_unit, unit_of
from abhv_mc.kernel.laws.user import MAX_MEMORY
from abhv_mc.user_code.child import check_may_run
from abhv_mc.user_code.effector_commands import effector_rows, find_commanded
from abhv_mc.user_code.law_interface import find_unit
from abhv_mc.user_code.native_loop import LawBackend, OpenLaw
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import filled_once, unpack
from abhv_mc_fmu.loop import FLAGS, FLOAT, Wire, compile_fmu_adapter, pack

_FUNCTIONS = {  # by version: what sets up a flight, then what a tick calls; what makes and frees an instance
    2: (
        *("Reset", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode"),
        *("SetReal", "DoStep", "GetReal", "Instantiate", "FreeInstance"),
    ),
    3: (
        *("Reset", "Reset", "EnterInitializationMode", "ExitInitializationMode"),
        *("SetFloat64", "DoStep", "GetFloat64", "InstantiateCoSimulation", "FreeInstance"),
    ),
}


_KINDS = {  # of variables by version, as FMI 3.0 calls them
    2: {"Real": FLOAT, "Integer": "Int32", "Enumeration": "Int32", "Boolean": "Boolean4"},
    3: {
        **{name: name for name in (FLOAT, "Float32")},
        **{
            f"{sign}Int{bits}": f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)
        },
        "Enumeration": "Int64",
        "Boolean": "Boolean1",
    },
}


class Fmu(NamedTuple):
    """An FMU in this process."""

    version: int
    functions: tuple[Any, ...]  # of what a flight calls
    typed: tuple[Any, ...]  # of parameters, inputs and outputs that are no 64-bit floats, in turn
    instantiate: Callable[[], int]  # a new instance's address, 0 where there is none
    free: Any
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    params: tuple[Wire, ...]
    states: dict[
        str, tuple[int, float | None]
    ]  # reference and start value of the states that it names


@functools.lru_cache(maxsize=16)
def _describe(source: UserSource) -> tuple[Path, Any]:
    """The folder of an unpacked FMU, and fmpy's description of it. Raises InputError."""
    try:
        import fmpy
    except ImportError:
        wish = "pip install fmpy"
        raise InputError(source.file, "no fmpy in this installation", wish) from None
    recipe: Any = source.recipe
    try:
        file = str(unpack(source) / recipe["file"])
        folder = filled_once(f"fmu_{source.hash[:24]}", lambda made: fmpy.extract(file, str(made)))
        return folder, fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # of zipfile, lxml and fmpy alike
        raise InputError(source.file, f"no FMU that can be read ({error})", "an FMU") from None


@functools.lru_cache(maxsize=16)
def load_fmu(source: UserSource) -> Fmu:
    """Unpack an FMU and load its library into this process. Raises InputError for what cannot fly."""
    check_may_run()
    folder, described = _describe(source)
    import fmpy

    recipe: Any = source.recipe
    version, simulation = int(described.fmiVersion[0]), described.coSimulation
    if (
        version not in _FUNCTIONS
        or simulation is None
        or simulation.canBeInstantiatedOnlyOncePerProcess
    ):
        found = f"an FMU of FMI {described.fmiVersion} without co-simulation, or with one instance a process"
        raise InputError(
            source.file, found, "co-simulation of FMI 2.0 or 3.0, one instance a flight"
        )
    platform = fmpy.platform if version == 2 else fmpy.platform_tuple
    library = (
        folder
        / "binaries"
        / platform
        / f"{simulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    )
    try:
        dll = ctypes.CDLL(str(library))
        *functions, make, free = (
            getattr(dll, f"fmi{version}{name}") for name in _FUNCTIONS[version]
        )
    except (OSError, AttributeError) as error:
        found = f"an FMU whose library does not load here ({error})"
        raise InputError(source.file, found, "one with binaries for this platform") from None
    make.restype, free.restype, free.argtypes = ctypes.c_void_p, None, [ctypes.c_void_p]
    (params, inputs, outputs), misfits = _read_wires(described, recipe, source.file)
    if misfits:
        raise InputErrors([InputError(source.file, *each[1:]) for each in misfits])
    try:
        typed = [
            getattr(dll, f"fmi{version}{verb}{_spoken(version, wire.kind)}")
            for verb, group in (("Set", (*params, *inputs)), ("Get", outputs))
            for wire in group
            if wire.kind != FLOAT
        ]
    except AttributeError as error:
        raise InputError(source.file, f"an FMU without a function ({error})", "all") from None
    return Fmu(
        version,
        tuple(functions),
        tuple(typed),
        _make_instantiate(make, version, described, folder),
        free,
        inputs,
        outputs,
        params,
        {
            state.name: (
                int(state.valueReference),
                None if state.start is None else float(state.start),
            )
            for state in (rate.variable.derivative for rate in described.derivatives)
        },
    )


def _spoken(version: int, kind: str) -> str:
    """The end of the names of the functions of a kind."""
    if kind.startswith("Boolean"):
        return "Boolean"
    return {FLOAT: "Real", "Int32": "Integer"}[kind] if version == 2 else kind


Misfit = tuple[tuple[str, str], str, str]  # keys in the controller file, found, expected


def _read_wires(
    described: Any, recipe: Mapping[str, Any], file: str
) -> tuple[tuple[tuple[Wire, ...], ...], list[Misfit]]:
    """Parameters, inputs and outputs of a law, of each first the 64-bit floats; and what does not fit."""
    misfits: list[Misfit] = []

    def read(key: str, items: Iterable[tuple[str, str, str, Any]]) -> tuple[Wire, ...]:
        wires = []
        for at, name, wired, value in items:
            try:
                wires.append(_wire(file, described, name, wired, value))
            except InputError as error:
                place = "inputs" if at in recipe["constants"] and key == "params" else key
                misfits.append(((place, at), error.found, error.expected))
        return tuple(sorted(wires, key=lambda wire: wire.kind != FLOAT))

    own = recipe["effectors"]
    groups = (
        read("params", ((name, name, name, value) for name, value in recipe["params"].items())),
        read("inputs", ((name, name, wired, None) for name, wired in recipe["inputs"].items())),
        read(
            "outputs",
            (
                (field, name, f"effectors.{field}" if field in own else field, None)
                for field, name in recipe["outputs"].items()
            ),
        ),
    )
    return groups, misfits


def find_misfits(source: UserSource) -> list[Misfit]:
    """What of a law's wiring does not fit its FMU, whose library is not loaded. Raises InputError for no FMU."""
    recipe: Any = source.recipe
    return _read_wires(_describe(source)[1], recipe, source.file)[1]


def find_states(source: UserSource, *_: Floats) -> dict[str, float] | None:
    """The states of an FMU as they start; None where one cannot be set. Called in the child."""
    starts = {
        name: start for name, (_, start) in load_fmu(source).states.items() if start is not None
    }
    return starts if len(starts) == len(load_fmu(source).states) <= MAX_MEMORY else None


def _make_instantiate(make: Any, version: int, described: Any, folder: Path) -> Callable[[], int]:
    """What makes an instance, by the structures of fmpy; without messages, which nobody would read."""
    from fmpy import fmi2, fmi3

    name, token = described.coSimulation.modelIdentifier.encode(), described.guid.encode()
    if version == 2:
        where = (folder / "resources").as_uri().encode()
        return lambda: int(
            make(name, 1, token, where, ctypes.byref(fmi2.defaultCallbacks), 0, 0) or 0
        )
    where = f"{folder / 'resources'}{os.sep}".encode()
    log = fmi3.fmi3LogMessageCallback(fmi3.printLogMessage)
    no, none = ctypes.c_bool(False), fmi3.fmi3IntermediateUpdateCallback()
    return lambda: int(
        make(name, token, where, no, no, no, no, None, ctypes.c_size_t(0), None, log, none) or 0
    )


def _wire(
    file: str, described: Any, name: str, wired: str, value: str | float | None = None
) -> Wire:
    """A variable and what it is wired to, or a parameter and its ``value``.

    Raises InputError for a variable that there is not, of another type, or in a unit of another dimension.
    """
    variables = {variable.name: variable for variable in described.modelVariables}
    variable = variables.get(name)
    if variable is None:
        raise InputError(file, f"no variable '{name}'", one_of(variables, name))
    kinds = _KINDS[int(described.fmiVersion[0])]
    kind = kinds.get(variable.type)
    if kind is None or variable.shape:
        found = f"the variable '{name}' of the type {variable.type}"
        raise InputError(file, found, f"a scalar of {one_of(kinds)}")
    unit = variable.unit or (
        variable.declaredType.unit if variable.declaredType is not None else None
    )
    if not unit:
        return Wire(wired, int(variable.valueReference), 1.0, 0.0, kind)
    base = {each.name: each.baseUnit for each in described.unitDefinitions}.get(unit)
    try:
        factor, exponents = (
            parse_unit(unit) if base is None else (base.factor, (base.m, base.kg, base.s, base.rad))
        )
    except Refusal:
        found = f"the unit '{unit}' of '{name}', which the FMU does not define"
        raise InputError(file, found, "a unit with its base units") from None
    expected = find_unit(wired) if value is None else unit_of(value)
    given = parse_unit(expected or "")[1]
    places = 4 if value is not None and not any(given) else 3  # radians are often left out
    if expected is not None and exponents[:places] != given[:places]:
        found = (
            f"'{name}' in {unit}"
            if value is None
            else f"'{name}: {value}' of a parameter in {unit}"
        )
        raise InputError(file, found, f"a quantity in {expected if value is None else unit}")
    offset = 0.0 if base is None else base.offset
    return Wire(wired, int(variable.valueReference), factor, offset, kind)


def open_fmu(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    places: int,
    memory: int | None,
    _: int,
    effectors: tuple[str, ...],
) -> OpenLaw:
    """The law for ``width`` lanes, with instances for ``places`` flights; ``effectors`` are the vehicle's.

    With ``memory`` the lanes' rows hold the states that the FMU names, as those of a compiled law, and an instance is
    reset and given them at each tick. Raises InputError.
    """
    fmu = load_fmu(source)
    states = tuple(reference for reference, _ in fmu.states.values()) if memory is not None else ()
    places = places if memory is None else width
    unknown = [
        wire.name
        for wire in fmu.inputs
        if wire.name.startswith("gains.") and wire.name[6:] not in gains
    ]
    if unknown:
        raise InputError(
            source.file, f"an input from '{unknown[0]}'", one_of([f"gains.{g}" for g in gains])
        )
    recipe: Any = source.recipe
    rows = tuple(zip(find_commanded(source), effector_rows(source, effectors), strict=True))
    loop = compile_fmu_adapter(
        fmu.version,
        fmu.inputs,
        fmu.outputs,
        fmu.params,
        gains,
        width=width,
        remade=memory,
        effectors=rows,
    )
    instances = np.array([fmu.instantiate() for _ in range(places)], np.int64)
    if not instances.all():
        raise InputError(
            source.file, "an FMU that makes no instance", "one for each of many flights"
        )
    starts = {
        wire: (parse_any(recipe["params"][wire.name]) - wire.offset) / wire.factor
        for wire in fmu.params
    }
    wires = [wire for group in (fmu.params, fmu.inputs, fmu.outputs) for wire in group]
    typed = [wire for wire in wires if wire.kind != FLOAT]
    values = np.concatenate(
        [
            [value for wire, value in starts.items() if wire.kind == FLOAT],
            np.zeros(len(fmu.outputs) + sum(wire.kind == FLOAT for wire in fmu.inputs)),
            np.zeros(FLAGS + len(states)),
            np.array([pack(wire.kind, starts.get(wire, 0.0)) for wire in typed], np.int64).view(
                np.float64
            ),
        ]
    )
    groups = [
        [wire.reference for wire in group if wire.kind == FLOAT]
        for group in (fmu.params, fmu.inputs, fmu.outputs)
    ]
    references = [np.array(group or [0], np.uint32) for group in (*groups, states)]
    references.append(np.array([wire.reference for wire in typed] or [0], np.uint32))
    functions, more = (
        [int(ctypes.cast(function, ctypes.c_void_p).value or 0) for function in group]
        for group in (fmu.functions, fmu.typed)
    )
    pointers = [array.ctypes.data for array in (*references[:4], values, instances)]
    context = np.array(
        [*functions, *pointers, places, 0, *more, references[4].ctypes.data], np.int64
    )
    held = loop, values, references, context
    return OpenLaw(
        int(loop.address),
        int(context.ctypes.data),
        held,
        lambda: any(map(fmu.free, instances.tolist())),
    )


FMU = LawBackend(open_fmu, find_states, find_misfits)
