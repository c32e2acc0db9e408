"""The settings and commands of a user law, as its controller file gives them."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control.law_file import PythonController
from abhv_mc.io.documents import Document, InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import TIME, parse_in_unit, parse_quantity
from abhv_mc.user_code.compiled import COMMANDS
from abhv_mc.user_code.module import Law


def make_user_settings(document: Document, controller: PythonController, law: Law) -> Floats:
    """The numbers of the class ``Settings`` in its order, SI. Raises InputErrors with line and column."""
    kind = law.settings
    known = kind._fields if kind is not None else ()
    errors: list[InputError] = []
    for name in controller.settings:
        if name not in known:
            expected = one_of(known, name) if known else "no settings: the law has no class Settings"
            errors.append(document.key_error(("settings", name), f"unknown key '{name}'", expected))
    values = []
    for name in known:
        if name not in controller.settings:
            if name not in kind._field_defaults:
                errors.append(document.error(("settings",), f"no key '{name}'", f"'{name}' here"))
            values.append(float(kind._field_defaults.get(name, np.nan)))
            continue
        try:
            values.append(parse_in_unit(controller.settings[name], law.mark.units.get(name, "-")))
        except Refusal as refusal:
            errors.append(document.error(("settings", name), refusal.found, refusal.expected))
    if errors:
        raise InputErrors(errors)
    return np.array(values, dtype=np.float64)


class CommandSteps(NamedTuple):
    """The commands of a law: each holds a value from a time on."""

    names: tuple[str, ...]
    times: tuple[Floats, ...]  # [step] of each, s, the first 0
    values: tuple[Floats, ...]  # [step] of each, SI

    def columns(self, time: Floats) -> Floats:
        """Values ``[tick, command]`` at control ticks (s)."""
        held = [
            values[np.searchsorted(times, time + 1e-9, side="right") - 1]
            for times, values in zip(self.times, self.values, strict=True)
        ]
        return np.stack(held, axis=1) if held else np.empty((time.size, 0))

    def column_names(self) -> tuple[str, ...]:
        """Names of these columns among the gains'."""
        return tuple(f"{COMMANDS}{name}" for name in self.names)


NO_COMMANDS = CommandSteps((), (), ())


def make_commands(document: Document, controller: PythonController, law: Law) -> CommandSteps:
    """The commands that a law names, in the order of its class ``Commands``. Raises InputErrors with their places."""
    kind = law.commands if "commands" in law.arguments else None
    known = kind._fields if kind is not None else ()
    defaults = kind._field_defaults if kind is not None else {}
    errors: list[InputError] = []
    for name in controller.commands:
        if name not in known:
            expected = one_of(known, name) if known else "no commands: the law has no class Commands"
            errors.append(document.key_error(("commands", name), f"the unknown key '{name}'", expected))
    times, values = [], []
    for name in known:
        unit, given = law.mark.units.get(name, "-"), controller.commands.get(name)
        steps = given if isinstance(given, dict) else {"0 s": given}
        at, held = [], []
        try:
            for time, value in steps.items():
                at.append(parse_quantity(time, TIME))
                held.append(defaults.get(name, np.nan) if value is None else parse_in_unit(value, unit))
            if not at or at[0] != 0.0 or sorted(set(at)) != at:
                raise Refusal(f"values from {', '.join(map(str, steps))} on", "times that rise from 0 s")
            if not np.isfinite(held).all():
                raise Refusal(f"no value for '{name}'", "one here, or a default in the class")
        except Refusal as refusal:
            errors.append(document.error(("commands", name), refusal.found, refusal.expected))
        times.append(np.array(at, dtype=np.float64))
        values.append(np.array(held, dtype=np.float64))
    if errors:
        raise InputErrors(errors)
    return CommandSteps(known, tuple(times), tuple(values))
