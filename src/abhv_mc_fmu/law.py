"""Control law implemented by an FMU for co-simulation (FMI 2.0 and 3.0).

fmpy unpacks the FMU and reads its description; compiled code calls its functions by address. One
instance computes a flight from start to end and is reset for the next flight; the lane of a flight
stores the number of the instance. A control tick sets the inputs, makes one communication step of
the control period and reads the outputs, which are the commands. For linearization, the states that
the FMU declares are set as initial values at each tick.
"""

import ctypes
import functools
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import check_may_run
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import parse_any, parse_unit, unit_of
from abhv_mc_fmu.loop import FLAGS, FLOAT, INTEGERS, Wire, compile_fmu_adapter, pack
from abhv_mc_vehicle.kernel.laws.user import MAX_MEMORY
from abhv_mc_vehicle.user_code.effector_commands import effector_rows, find_commanded
from abhv_mc_vehicle.user_code.law_interface import find_unit
from abhv_mc_vehicle.user_code.native_loop import LawBackend, OpenLaw
from abhv_mc_vehicle.user_code.unpack import filled_once, unpack

# functions, by FMI version, that set up a flight, compute a tick, and create and free an instance
_FUNCTIONS = {
    2: (
        *("Reset", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode"),
        *("SetReal", "DoStep", "GetReal", "Instantiate", "FreeInstance"),
    ),
    3: (
        *("Reset", "Reset", "EnterInitializationMode", "ExitInitializationMode"),
        *("SetFloat64", "DoStep", "GetFloat64", "InstantiateCoSimulation", "FreeInstance"),
    ),
}


_KINDS = {  # type in FMI 3.0, by FMI version and type of a variable
    2: {"Real": FLOAT, "Integer": "Int32", "Enumeration": "Int32", "Boolean": "Boolean4"},
    3: {
        **{name: name for name in (FLOAT, "Float32", *INTEGERS)},
        "Enumeration": "Int64",
        "Boolean": "Boolean1",
    },
}


class Fmu(NamedTuple):
    """FMU with a library loaded into this process."""

    version: int
    functions: tuple[Any, ...]  # functions called during a flight
    typed: tuple[Any, ...]  # functions for variables that are not 64-bit floats
    # function that returns the address of a new instance, or 0 if this fails
    instantiate: Callable[[], int]
    free: Any
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    params: tuple[Wire, ...]
    # reference and initial value of each state, by name
    states: dict[str, tuple[int, float | None]]


@functools.lru_cache(maxsize=16)
def _describe(source: UserSource) -> tuple[Path, Any]:
    """Return the folder of an unpacked FMU and its model description.

    Raise InputError if fmpy is missing or the FMU cannot be read.
    """
    try:
        import fmpy
    except ImportError:
        raise InputError(
            source.file,
            "the package fmpy is not installed",
            "the package fmpy, which FMUs require (pip install fmpy)",
        ) from None
    recipe: Any = source.recipe
    try:
        file = str(unpack(source) / recipe["file"])
        folder = filled_once(
            f"fmu_{source.hash[:24]}", lambda target: fmpy.extract(file, str(target))
        )
        return folder, fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # zipfile, lxml and fmpy have no common base class of errors.
        raise InputError(source.file, f"the FMU cannot be read ({error})", "a valid FMU") from None


@functools.lru_cache(maxsize=16)
def load_fmu(source: UserSource) -> Fmu:
    """Unpack an FMU and load its library. Raise InputError if it is unsuitable."""
    check_may_run()
    folder, description = _describe(source)
    import fmpy

    recipe: Any = source.recipe
    version = int(description.fmiVersion[0])
    simulation = description.coSimulation
    if (
        version not in _FUNCTIONS
        or simulation is None
        or simulation.canBeInstantiatedOnlyOncePerProcess
    ):
        raise InputError(
            source.file,
            f"the FMU (FMI {description.fmiVersion}) has no co-simulation, or allows only one "
            "instance per process",
            "an FMU for co-simulation (FMI 2.0 or 3.0) that allows several instances",
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
        *functions, create, free = (
            getattr(dll, f"fmi{version}{name}") for name in _FUNCTIONS[version]
        )
    except (OSError, AttributeError) as error:
        raise InputError(
            source.file,
            f"the library of the FMU cannot be loaded ({error})",
            "an FMU with binaries for this platform",
        ) from None
    create.restype = ctypes.c_void_p
    free.restype = None
    free.argtypes = [ctypes.c_void_p]
    (params, inputs, outputs), misfits = _read_wires(description, recipe, source.file)
    if misfits:
        raise InputErrors([InputError(source.file, *misfit[1:]) for misfit in misfits])
    try:
        typed = [
            getattr(dll, f"fmi{version}{verb}{_function_suffix(version, wire.kind)}")
            for verb, group in (("Set", (*params, *inputs)), ("Get", outputs))
            for wire in group
            if wire.kind != FLOAT
        ]
    except AttributeError as error:
        raise InputError(
            source.file,
            f"the FMU lacks a function ({error})",
            "an FMU with all functions of the standard",
        ) from None
    return Fmu(
        version=version,
        functions=tuple(functions),
        typed=tuple(typed),
        instantiate=_make_instantiate(create, version, description, folder),
        free=free,
        inputs=inputs,
        outputs=outputs,
        params=params,
        states={
            state.name: (
                int(state.valueReference),
                None if state.start is None else float(state.start),
            )
            for state in (rate.variable.derivative for rate in description.derivatives)
        },
    )


def _function_suffix(version: int, kind: str) -> str:
    """Return the suffix of function names for a type, as in ``fmi2SetReal``."""
    if kind.startswith("Boolean"):
        return "Boolean"
    return {FLOAT: "Real", "Int32": "Integer"}[kind] if version == 2 else kind


# keys in the controller file, problem, and what is expected
Misfit = tuple[tuple[str, str], str, str]


def _read_wires(
    description: Any, recipe: Mapping[str, Any], file: str
) -> tuple[tuple[tuple[Wire, ...], ...], list[Misfit]]:
    """Return the parameters, inputs and outputs of a law, and errors in their assignment.

    In each group, 64-bit floats come before other types.
    """
    misfits: list[Misfit] = []

    def read(key: str, items: Iterable[tuple[str, str, str, Any]]) -> tuple[Wire, ...]:
        wires = []
        for field, name, quantity, value in items:
            try:
                wires.append(_wire(file, description, name, quantity, value))
            except InputError as error:
                is_constant = key == "params" and field in recipe["constants"]
                section = "inputs" if is_constant else key
                misfits.append(((section, field), error.found, error.expected))
        return tuple(sorted(wires, key=lambda wire: wire.kind != FLOAT))

    effectors = recipe["effectors"]
    groups = (
        read("params", ((name, name, name, value) for name, value in recipe["params"].items())),
        read("inputs", ((name, name, wired, None) for name, wired in recipe["inputs"].items())),
        read(
            "outputs",
            (
                (field, name, f"effectors.{field}" if field in effectors else field, None)
                for field, name in recipe["outputs"].items()
            ),
        ),
    )
    return groups, misfits


def find_misfits(source: UserSource) -> list[Misfit]:
    """Return the errors in the assignment of variables, without loading the library.

    Raise InputError if the FMU cannot be read.
    """
    recipe: Any = source.recipe
    return _read_wires(_describe(source)[1], recipe, source.file)[1]


def find_states(source: UserSource, *_: Floats) -> dict[str, float] | None:
    """Return the initial values of an FMU's states, or None if a state cannot be set.

    Call this function in the child process.
    """
    states = load_fmu(source).states
    starts = {name: start for name, (_, start) in states.items() if start is not None}
    return starts if len(starts) == len(states) <= MAX_MEMORY else None


def _make_instantiate(
    create: Any, version: int, description: Any, folder: Path
) -> Callable[[], int]:
    """Return a function that creates an instance of the FMU with logging disabled."""
    from fmpy import fmi2, fmi3

    name = description.coSimulation.modelIdentifier.encode()
    token = description.guid.encode()
    if version == 2:
        resources = (folder / "resources").as_uri().encode()
        return lambda: int(
            create(name, 1, token, resources, ctypes.byref(fmi2.defaultCallbacks), 0, 0) or 0
        )
    resources = f"{folder / 'resources'}{os.sep}".encode()
    log = fmi3.fmi3LogMessageCallback(fmi3.printLogMessage)
    false = ctypes.c_bool(False)
    no_callback = fmi3.fmi3IntermediateUpdateCallback()
    flags = (false,) * 4
    callbacks = (None, ctypes.c_size_t(0), None, log, no_callback)
    return lambda: int(create(name, token, resources, *flags, *callbacks) or 0)


def _wire(file: str, description: Any, name: str, quantity: str, value: str | float | None) -> Wire:
    """Return a variable with its assigned quantity, or a parameter with its ``value``.

    Raise InputError if the variable does not exist, has an unsuitable type, or has a unit of
    another dimension.
    """
    variables = {variable.name: variable for variable in description.modelVariables}
    variable = variables.get(name)
    if variable is None:
        raise InputError(file, f"unknown variable '{name}'", one_of(variables, name))
    kinds = _KINDS[int(description.fmiVersion[0])]
    kind = kinds.get(variable.type)
    if kind is None or variable.shape:
        raise InputError(
            file,
            f"the variable '{name}' has the type {variable.type}",
            f"a scalar with a type that is {one_of(kinds)}",
        )
    unit = variable.unit or (variable.declaredType and variable.declaredType.unit)
    if not unit:
        return Wire(quantity, int(variable.valueReference), 1.0, 0.0, kind)
    bases = {definition.name: definition.baseUnit for definition in description.unitDefinitions}
    base = bases.get(unit)
    try:
        if base is None:
            factor, exponents = parse_unit(unit)
        else:
            factor, exponents = base.factor, (base.m, base.kg, base.s, base.rad, base.K)
    except Refusal:
        raise InputError(
            file,
            f"the FMU does not define the unit '{unit}' of '{name}'",
            "a unit that is defined by base units",
        ) from None
    expected = find_unit(quantity) if value is None else unit_of(value)
    dimension = parse_unit(expected or "")[1]
    # Units of FMUs often omit the radian, so it is not compared for quantities with a dimension.
    compared = 5 if value is not None and not any(dimension) else 3
    if expected is not None and exponents[:compared] != dimension[:compared]:
        if value is not None:
            raise InputError(
                file, f"found '{name}: {value}' for a parameter in {unit}", f"a quantity in {unit}"
            )
        raise InputError(file, f"'{name}' has the unit {unit}", f"a quantity in {expected}")
    offset = 0.0 if base is None else base.offset
    return Wire(quantity, int(variable.valueReference), factor, offset, kind)


def open_fmu(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    flights: int,
    memory: int | None,
    _: int,
    effectors: tuple[str, ...],
) -> OpenLaw:
    """Open the law for ``width`` lanes, with an instance for each of ``flights`` flights.

    ``effectors`` are the vehicle's effectors. If ``memory`` is given, the rows of the lanes store
    the declared states of the FMU, like the memory of a compiled law, and each tick resets an
    instance and sets its states. Raise InputError if the FMU or the assignment is unsuitable.
    """
    fmu = load_fmu(source)
    states = tuple(reference for reference, _ in fmu.states.values()) if memory is not None else ()
    flights = flights if memory is None else width
    unknown = [
        wire.name
        for wire in fmu.inputs
        if wire.name.startswith("gains.") and wire.name[6:] not in gains
    ]
    if unknown:
        raise InputError(
            source.file,
            f"an input has the unknown source '{unknown[0]}'",
            one_of([f"gains.{g}" for g in gains]),
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
    instances = np.array([fmu.instantiate() for _ in range(flights)], np.int64)
    if not instances.all():
        raise InputError(
            source.file, "the FMU creates no instance", "an FMU that can be instantiated many times"
        )
    starts = {
        wire: (parse_any(recipe["params"][wire.name]) - wire.offset) / wire.factor
        for wire in fmu.params
    }
    groups = fmu.params, fmu.inputs, fmu.outputs
    floats = [[wire for wire in group if wire.kind == FLOAT] for group in groups]
    typed = [wire for group in groups for wire in group if wire.kind != FLOAT]
    packed = np.array([pack(wire.kind, starts.get(wire, 0.0)) for wire in typed], np.int64)
    zeros = np.zeros(len(floats[1]) + len(fmu.outputs) + FLAGS + len(states))
    values = np.concatenate([[starts[wire] for wire in floats[0]], zeros, packed.view(np.float64)])
    numbers = [wire.reference for wire in typed]
    references = [
        np.array(group or [0], np.uint32)
        for group in (*([wire.reference for wire in group] for group in floats), states, numbers)
    ]
    functions, typed_functions = (
        [int(ctypes.cast(function, ctypes.c_void_p).value or 0) for function in group]
        for group in (fmu.functions, fmu.typed)
    )
    pointers = [array.ctypes.data for array in (*references[:4], values, instances)]
    context = np.array(
        [*functions, *pointers, flights, 0, *typed_functions, references[4].ctypes.data], np.int64
    )
    resources = loop, values, references, context
    return OpenLaw(
        int(loop.address),
        int(context.ctypes.data),
        resources,
        lambda: any(map(fmu.free, instances.tolist())),
    )


FMU = LawBackend(open_fmu, find_states, find_misfits)
