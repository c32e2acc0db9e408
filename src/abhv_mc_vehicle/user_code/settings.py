"""Settings and commands of custom control laws, read from controller files."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.documents import Document
from abhv_mc.io.messages import InputErrors, Refusal, joined, one_of
from abhv_mc.io.units import TIME, parse_in_unit, parse_quantity
from abhv_mc_vehicle.control.law_file import PythonController
from abhv_mc_vehicle.user_code.compiled import COMMANDS
from abhv_mc_vehicle.user_code.module import Law

T = TypeVar("T")


def make_user_settings(document: Document, controller: PythonController, law: Law) -> Floats:
    """Return the values of class ``Settings`` in SI. Raise InputErrors for invalid entries."""

    def number(name: str, unit: str, default: float) -> float:
        if name not in controller.settings and np.isnan(default):
            raise Refusal(f"the key '{name}' is missing", f"a mapping with the key '{name}'")
        return (
            parse_in_unit(controller.settings[name], unit)
            if name in controller.settings
            else float(default)
        )

    settings = _read_fields(document, law, "settings", law.settings, controller.settings, number)
    return np.array(list(settings.values()), np.float64)


def _read_fields(
    document: Document,
    law: Law,
    key: str,
    kind: Any,
    entries: Mapping[str, Any],
    read: Callable[[str, str, float], T],
) -> dict[str, T]:
    """Return the value of each field of a class, read by ``read(name, unit, default)``.

    Raise InputErrors with the source locations of invalid entries.
    """
    fields = kind._fields if kind is not None else ()
    errors = []
    for name in entries:
        if name not in fields:
            expected = (
                one_of(fields, name)
                if fields
                else f"no {key}, because the law has no class {key.capitalize()}"
            )
            errors.append(document.key_error((key, name), f"unknown key '{name}'", expected))
    values = {}
    for name in fields:
        try:
            values[name] = read(
                name, law.mark.units.get(name, "-"), kind._field_defaults.get(name, np.nan)
            )
        except Refusal as refusal:
            location = (key, name) if name in entries else (key,)
            errors.append(document.error(location, refusal.found, refusal.expected))
    if errors:
        raise InputErrors(errors)
    return values


class CommandSteps(NamedTuple):
    """Commands of a control law as step functions of time."""

    names: tuple[str, ...]
    times: tuple[Floats, ...]  # step times [step] of each command, s; the first is 0
    values: tuple[Floats, ...]  # values [step] of each command, SI

    def columns(self, time: Floats) -> Floats:
        """Return the values of the commands [tick, command] at the control ticks ``time`` (s)."""
        columns_of_values = [
            values[np.searchsorted(times, time + 1e-9, side="right") - 1]
            for times, values in zip(self.times, self.values, strict=True)
        ]
        return (
            np.stack(columns_of_values, axis=1) if columns_of_values else np.empty((time.size, 0))
        )

    def column_names(self) -> tuple[str, ...]:
        """Return the names of the command columns in the table of gains."""
        return tuple(f"{COMMANDS}{name}" for name in self.names)


NO_COMMANDS = CommandSteps((), (), ())


def make_commands(document: Document, controller: PythonController, law: Law) -> CommandSteps:
    """Return the commands of a law in the order of class ``Commands``.

    Raise InputErrors with the source locations of all invalid entries.
    """

    def steps(name: str, unit: str, default: float) -> tuple[Floats, Floats]:
        entry = controller.commands.get(name)
        by_time = entry if isinstance(entry, dict) else {"0 s": entry}
        start_times = [parse_quantity(time, TIME) for time in by_time]
        step_values = [
            default if value is None else parse_in_unit(value, unit) for value in by_time.values()
        ]
        if not start_times or start_times[0] != 0.0 or sorted(set(start_times)) != start_times:
            raise Refusal(
                f"the command has the times {joined(list(map(str, by_time)))}",
                "times that start at 0 s and increase",
            )
        if not np.isfinite(step_values).all():
            raise Refusal(
                f"'{name}' has no value",
                "a value in the controller file, or a default in the class",
            )
        return np.array(start_times, np.float64), np.array(step_values, np.float64)

    kind = law.commands if "commands" in law.arguments else None
    commands = _read_fields(document, law, "commands", kind, controller.commands, steps)
    return CommandSteps(
        tuple(commands),
        tuple(start_times for start_times, _ in commands.values()),
        tuple(step_values for _, step_values in commands.values()),
    )
