"""Compilation of control laws to loops over lanes, cached by the hash of the source text."""

import functools
import hashlib
import os
import re
import sys
import types
from collections import namedtuple
from collections.abc import Callable, Iterable
from typing import Any

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.kernel.cache import compilation_lock
from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.jit_pointer import Uncompilable, compile_pointer
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.user import MEMORY, N_ONBOARD, ONBOARD
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code.effector_commands import effector_rows, tuple_codes
from abhv_mc_vehicle.user_code.law_interface import (
    COMMAND_FIELDS,
    Coefficients,
    Command,
    Effect,
    Filtered,
    Measured,
    MixedCommand,
    Onboard,
    Reference,
    Sensed,
    Thrust,
    nest,
    onboard_fields,
)
from abhv_mc_vehicle.user_code.load_law import load_law
from abhv_mc_vehicle.user_code.module import MODULE, Law, Module, code_hash, refuse_in_words
from abhv_mc_vehicle.user_code.table import LookUp
from abhv_mc_vehicle.user_code.unpack import laws_folder, unpack

_CONTROLS = range(s.CMD, s.CMD + 4)
COMMAND_ROWS = (*_CONTROLS, s.GAMMA_CMD, s.ALPHA_CMD, s.BANK_CMD)  # lane-memory rows of a Command
LAW_FAILED = 50.0  # value of flight.outcome.Outcome.LAW_FAILED, which a higher layer defines
_GIVEN = "float('inf')"  # source text of law_interface.NOT_GIVEN
_MADE = (Command, Coefficients, Thrust, Sensed, Filtered)  # classes that accept any numbers
# lane-memory rows of the values of Onboard
ONBOARD_ROWS = (*range(ONBOARD, ONBOARD + N_ONBOARD), *_CONTROLS)
# lane-memory row of each quantity that laws outside of compiled code read
INPUT_ROWS = {
    **{f"measured.{name}": s.MEASURED + i for i, name in enumerate(Measured._fields)},
    **{f"onboard.{name}": row for name, row in zip(onboard_fields(), ONBOARD_ROWS, strict=True)},
}
COMMANDS = "commands."  # prefix of the names of command columns
WANTED = "code with only floats, named tuples and functions of them, or @controller(compiled=False)"
_NOISE = re.compile(
    r"(Failed in nopython mode|During: |File \"|- Resolution failure|\^|\[1\] |<source|def |return "
    r"|for lane |There are \d+ candidate|[\w, ]+ = _|$)"
)


@functools.lru_cache(maxsize=64)
def compile_law(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    effectors: tuple[str, ...] = (),
    dispersed_row: int = 0,
) -> Any:
    """Compile a control law and return its loop over ``width`` lanes.

    The loop has the attribute ``address``. ``gains`` are the names of the gain columns;
    ``effectors`` are the names of the vehicle's effectors if the law commands effectors.
    ``dispersed_row`` is the first row of the dispersed settings of each flight, or 0 if no setting
    is dispersed. If the code does not compile, raise InputError with the line in the user's file.
    """
    law = load_law(source)
    with refuse_in_words(source, "the law", WANTED):
        names = compiled_names(law.module)
        names |= {"_Measured": Measured, "_Reference": Reference, "_Onboard": Onboard}
        names |= {
            f"_{hint.__name__}": hint
            for hint in Onboard.__annotations__.values()
            if hasattr(hint, "_fields")
        }
        names |= {"_Memory": law.memory, "_Settings": law.settings, "_Commands": law.commands}
        names |= {
            "_Gains": make_gains_class(split_columns(gains)[0]),
            "_law": names[law.function.__name__],
        }
        return build(
            law.module,
            law.function.__name__,
            _make_loop(law, gains, width, effectors, dispersed_row),
            names,
            f"{gains}",
        )


@functools.lru_cache(maxsize=64)
def compile_filter(source: UserSource, settings: tuple[float, ...], width: int) -> Any:
    """Compile a measurement filter and return its loop over ``width`` lanes.

    The loop has the attribute ``address``. If the code does not compile, raise InputError with the
    line in the user's file.
    """
    law = load_law(source)
    lane = functools.partial(lane_of, width)
    with refuse_in_words(source, "the filter", WANTED):
        names = compiled_names(law.module)
        names |= {"_Measured": Measured, "_Reference": Reference, "_Memory": law.memory}
        names |= {"_Settings": law.settings, "_law": names[law.function.__name__]}
        once = {
            "reference": REFERENCE_TEXT,
            "settings": tuple_text("Settings", map(repr, settings)),
            "time": "tick * dt",
        }
        lines = [f"measured = {_measured_text(lane)}", *_memory_lines(law, lane)]
        lines += [f"{_returned(law, 'filtered')} = _law({', '.join(law.arguments)})"]
        lines += _keep_memory(law, lane)
        for i, field in enumerate(Measured._fields):
            row = lane(s.MEASURED + i)
            lines.append(f"{row} = {row} if filtered.{field} == {_GIVEN} else filtered.{field}")
        before = [f"{name} = {once[name]}" for name in law.arguments if name in once]
        text = loop_text(width, before, lines)
        return build(law.module, law.function.__name__, text, names, "filter")


def split_columns(names: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the gain columns, and of the command columns."""
    commands = tuple(name for name in names if name.startswith(COMMANDS))
    return names[: len(names) - len(commands)], commands


@functools.cache
def make_gains_class(names: tuple[str, ...]) -> Any:
    """Return the named tuple class passed to a control law as ``gains``."""
    return namedtuple("Gains", names)


def tuple_text(kind: str, parts: Iterable[str]) -> str:
    """Return the source text that constructs a named tuple."""
    return f"_{kind}({', '.join(parts)})"


REFERENCE_TEXT = tuple_text(
    "Reference", [f"row[tick * {len(REFERENCE)} + {i}]" for i in range(len(REFERENCE))]
)


def lane_of(width: int, row: int) -> str:
    """Return source text that refers to the current lane's value in a row of lane memory."""
    return f"Z[{row * width} + lane]"


def indent(spaces: int, lines: list[str]) -> str:
    """Return the lines indented by ``spaces``, or an indented `pass` if there are no lines."""
    return "\n".join(" " * spaces + line for line in lines or ["pass"])


def loop_text(width: int, once: list[str], inside: list[str]) -> str:
    """Return the source text of a loop over lanes.

    The lines ``once`` run before the loop, and the lines ``inside`` run for each lane.
    """
    lines = [indent(4, once), f"    for lane in range({width}):", indent(8, inside)]
    return "\n".join(["def loop(context, Z, row, column, given, tick, dt):", *lines, ""])


def build(
    module: Module,
    function: str,
    text: str,
    names: dict[str, Any],
    salt: str = "",
    expected: str = WANTED,
) -> Any:
    """Compile generated source text that calls ``function``; return the compiled ``loop``.

    Raise InputError at the line that numba reports, or else at the line of the function.
    """
    try:
        return build_loop(f"{module.source.hash} {salt}", text, names)
    except Uncompilable as error:
        raise _explain(module, error, module.texts[function].lineno, expected) from None


def build_loop(salt: str, text: str, names: dict[str, Any]) -> Any:
    """Compile source text that uses ``names``; return the compiled function ``loop``.

    ``salt`` distinguishes loops of equal text that use different names. Raise Uncompilable if
    compilation fails.
    """
    key = hashlib.sha256(f"{salt} {text} {code_hash()}".encode()).hexdigest()[:24]
    path = laws_folder() / f"law_{key}.py"
    if not path.exists():
        with atomic_write(path) as temporary:
            temporary.write_text(text, "utf-8")
    home = types.ModuleType(
        f"abhv_mc_loop_{key}"
    )  # numba finds cached code by the name of its module.
    sys.modules[home.__name__] = home
    home.__dict__.update(names, __name__=home.__name__, __file__=str(path))
    exec(
        compile(text, str(path), "exec", dont_inherit=True), home.__dict__
    )  # abhv-mc generated this source text, which calls custom functions.
    with compilation_lock(path.parent.parent, f"{path.stem}.loop"):
        return compile_pointer(home.__dict__["loop"])


def compiled_names(module: Module) -> dict[str, Any]:
    """Return the global names of a file, with their objects converted for numba.

    Tables become look-up functions, and classes become functions that convert their arguments to
    floats.
    """
    folder = str(unpack(module.source)) + os.sep if module.source.files else ""
    return dict(_compile_names(module.names, folder, {}, tuple_codes(module.source)))


def _compile_names(
    globals_of_module: dict[str, Any],
    folder: str,
    namespaces: dict[int, dict[str, Any]],
    codes: dict[str, types.CodeType],
) -> dict[str, Any]:
    """Return the names of a module and of the modules it imports from the law's ``folder``.

    ``codes`` contains functions that are compiled from rewritten text.
    """
    if id(globals_of_module) in namespaces:
        return namespaces[id(globals_of_module)]
    name = globals_of_module["__name__"]
    mark = hashlib.sha256(folder.encode()).hexdigest()[
        :16
    ]  # Modules of different laws may have the same name.
    home = types.ModuleType(name if name.startswith(MODULE) else f"{MODULE}{mark}_{name}")
    sys.modules[home.__name__] = home  # numba caches functions under their module name.
    names = home.__dict__
    names.update({**globals_of_module, "__name__": home.__name__})
    namespaces[id(globals_of_module)] = names
    for (
        name,
        value,
    ) in globals_of_module.items():  # isinstance() could run custom code of the objects.
        if type(value) is types.FunctionType and value.__globals__ is globals_of_module:
            copy = types.FunctionType(
                codes.get(name, value.__code__), names, name, value.__defaults__, value.__closure__
            )
            copy.__kwdefaults__ = value.__kwdefaults__
            names[name] = scalar(copy)
        elif type(value) is types.FunctionType and _is_in(folder, value.__globals__):
            names[name] = _compile_names(value.__globals__, folder, namespaces, {})[value.__name__]
        elif type(value) is types.ModuleType and _is_in(folder, value.__dict__):
            _compile_names(value.__dict__, folder, namespaces, {})
            names[name] = sys.modules[namespaces[id(value.__dict__)]["__name__"]]
        elif value is Effect:
            names[name] = _make_effect_maker(home.__name__)
        elif issubclass(type(value), LookUp):
            names[name] = value.make_compiled()
        elif (
            issubclass(type(value), type)
            and hasattr(value, "_fields")
            and (value in _MADE or name == "Memory")
        ):
            mixed = value is Command and not codes
            names[name] = _make_maker(
                MixedCommand if mixed else value, home.__name__, value._field_defaults
            )
    return names


def _is_in(folder: str, names: dict[str, Any]) -> bool:
    return bool(folder) and str(names.get("__file__", "")).startswith(folder)


def _make_maker(kind: Any, home: str, defaults: dict[str, Any]) -> Any:
    """Return a compiled function that converts numbers to a named tuple of floats.

    The field ``effectors`` remains a tuple and is not converted.
    """
    defaults = {name: value for name, value in defaults.items() if name != "effectors"}
    parameters = [f"{name}=_{name}" if name in defaults else name for name in kind._fields]
    parameters = [f"{name}=()" if name == "effectors" else name for name in parameters]
    floats = ", ".join(name if name == "effectors" else f"float({name})" for name in kind._fields)
    names: dict[str, Any] = {f"_{name}": float(value) for name, value in defaults.items()} | {
        "_kind": kind,
        "__name__": home,
    }
    exec(f"def make({', '.join(parameters)}):\n    return _kind({floats})\n", names)
    return scalar(names["make"])


def _make_effect_maker(home: str) -> Any:
    """Return a compiled function that makes an Effect, with force and moment as floats."""
    names: dict[str, Any] = {"_kind": Effect, "_sensed": Sensed(), "__name__": home}
    nothing = "(0.0, 0.0, 0.0)"
    floats = ", ".join(
        f"(float({vector}[0]), float({vector}[1]), float({vector}[2]))"
        for vector in ("force", "moment")
    )
    parameters = f"rates, force={nothing}, moment={nothing}, sensed=_sensed"
    exec(f"def make({parameters}):\n    return _kind(rates, {floats}, sensed)\n", names)
    return scalar(names["make"])


def _measured_text(lane: Callable[[int], str]) -> str:
    return tuple_text("Measured", [lane(s.MEASURED + i) for i in range(s.N_SEEN)])


def _memory_lines(law: Law, lane: Callable[[int], str]) -> list[str]:
    """Return the lines that build the memory of a law, if any, from rows of lane memory.

    At the first tick, the memory has its default values. Each value is assigned to a variable
    first, because numba cannot compile a call with more than 30 arguments if one is a conditional
    expression.
    """
    if "memory" not in law.arguments:
        return []
    starts = [repr(float(law.memory._field_defaults[field])) for field in law.memory._fields]
    values = [
        f"m_{i} = {start} if tick == 0 else {lane(MEMORY + i)}" for i, start in enumerate(starts)
    ]
    return [*values, f"memory = {tuple_text('Memory', (f'm_{i}' for i in range(len(starts))))}"]


def _returned(law: Law, name: str) -> str:
    """Return the source text of the assignment targets for a law's result."""
    return f"{name}, after" if "memory" in law.arguments else name


def _keep_memory(law: Law, lane: Callable[[int], str]) -> list[str]:
    """Return the lines that store a law's memory after the tick."""
    fields = law.memory._fields if "memory" in law.arguments else ()
    return [f"{lane(MEMORY + i)} = after.{field}" for i, field in enumerate(fields)]


def _make_loop(
    law: Law, gains: tuple[str, ...], width: int, effectors: tuple[str, ...], dispersed_row: int
) -> str:
    """Return the source text of the loop over lanes.

    The number of lanes is a constant in the text, so that the compiler can vectorize the loop.
    """
    lane = functools.partial(lane_of, width)
    columns = [f"column[tick * {len(gains)} + {i}]" for i in range(len(gains))]
    designed = len(split_columns(gains)[0])
    settings = law.settings._fields if law.settings is not None else ()
    inside: dict[str, str] = {}
    values = [f"given[{i}]" for i in range(len(settings))]
    for k, name in enumerate(law.mark.dispersable if dispersed_row else ()):
        values[settings.index(name)] = lane(dispersed_row + k)
    once = {
        "reference": REFERENCE_TEXT,
        "gains": tuple_text("Gains", columns[:designed]),
        "commands": tuple_text("Commands", columns[designed:]),
        "time": "tick * dt",
    }
    (inside if dispersed_row else once)["settings"] = tuple_text("Settings", values)
    inside |= {
        "measured": _measured_text(lane),
        "onboard": nest(
            Onboard, map(lane, ONBOARD_ROWS), lambda kind, parts: tuple_text(kind.__name__, parts)
        ),
    }
    before, lines = (
        [f"{name} = {values[name]}" for name in law.arguments if name in values]
        for values in (once, inside)
    )
    lines += _memory_lines(law, lane)
    lines.append(f"{_returned(law, 'command')} = _law({', '.join(law.arguments)})")
    lines += _keep_memory(law, lane)
    lines += [
        f"{lane(row)} = command.effectors[{i}]"
        for i, row in enumerate(effector_rows(law.source, effectors))
    ]
    lines += [
        f"{lane(row)} = command.{field}"
        for field, row in zip(COMMAND_FIELDS, COMMAND_ROWS, strict=True)
    ]
    lines += [f"if command.throttle != {_GIVEN}:", f"    {lane(s.CMD_ETA)} = command.throttle"]
    return loop_text(width, before, lines)


def _explain(module: Module, error: Uncompilable, first_line: int, expected: str) -> InputError:
    """Return an InputError with a shortened numba message and its line in the user's file.

    If the message contains no such line, the error is located at ``first_line``.
    """
    source = module.source
    line: int | None = error.line if error.file == source.file else None
    for match in re.finditer(re.escape(f'File "{source.file}", line ') + r"(\d+)", error.message):
        line = line or int(match.group(1))
    for match in re.finditer(re.escape(source.file) + r" \((\d+)\)", error.message):
        line = int(match.group(1))
    message_lines = [text.strip() for text in error.message.splitlines()]
    useful = [text for text in message_lines if text and not _NOISE.match(text)]
    if "Unknown attribute 'aileron'" in error.message or "wrong tuple length" in error.message:
        return InputError(
            source.file,
            "the law does not return a Command",
            "'return Command(...)', or 'return Command(...), Memory(...)' for a law with memory",
            line or first_line,
        )
    reason = "; ".join(text.rstrip(".:") for text in useful[:3])
    return InputError(
        source.file, f"the code does not compile ({reason:.300})", expected, line or first_line
    )
