"""The settings and commands of a user law, as its controller file gives them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control.law_file import PythonController
from abhv_mc.io.documents import Document, InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import TIME, parse_in_unit, parse_quantity
from abhv_mc.user_code.compiled import COMMANDS
from abhv_mc.user_code.module import Law

T = TypeVar("T")


def make_user_settings(document: Document, controller: PythonController, law: Law) -> Floats:
    """The numbers of the class ``Settings`` in its order, SI. Raises InputErrors with line and column."""

    def number(name: str, unit: str, default: float) -> float:
        if name not in controller.settings and np.isnan(default):
            raise Refusal(f"no key '{name}'", f"'{name}' here")
        return (
            parse_in_unit(controller.settings[name], unit)
            if name in controller.settings
            else float(default)
        )

    made = _read_fields(document, law, "settings", law.settings, controller.settings, number)
    return np.array(list(made.values()), dtype=np.float64)


def _read_fields(
    document: Document,
    law: Law,
    key: str,
    kind: Any,
    given: Mapping[str, Any],
    read: Callable[[str, str, float], T],
) -> dict[str, T]:
    """What ``read`` makes of each field of a class: of its name, unit and default. Raises InputErrors with places."""
    known = kind._fields if kind is not None else ()
    errors: list[InputError] = []
    for name in given:
        if name not in known:
            expected = (
                one_of(known, name)
                if known
                else f"no {key}: the law has no class {key.capitalize()}"
            )
            errors.append(document.key_error((key, name), f"unknown key '{name}'", expected))
    made = {}
    for name in known:
        try:
            made[name] = read(
                name, law.mark.units.get(name, "-"), kind._field_defaults.get(name, np.nan)
            )
        except Refusal as refusal:
            place = (key, name) if name in given else (key,)
            errors.append(document.error(place, refusal.found, refusal.expected))
    if errors:
        raise InputErrors(errors)
    return made


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

    def steps(name: str, unit: str, default: float) -> tuple[Floats, Floats]:
        given = controller.commands.get(name)
        by_time = given if isinstance(given, dict) else {"0 s": given}
        at = [parse_quantity(time, TIME) for time in by_time]
        held = [
            default if value is None else parse_in_unit(value, unit) for value in by_time.values()
        ]
        if not at or at[0] != 0.0 or sorted(set(at)) != at:
            raise Refusal(
                f"values from {', '.join(map(str, by_time))} on", "times that rise from 0 s"
            )
        if not np.isfinite(held).all():
            raise Refusal(f"no value for '{name}'", "one here, or a default in the class")
        return np.array(at, dtype=np.float64), np.array(held, dtype=np.float64)

    kind = law.commands if "commands" in law.arguments else None
    made = _read_fields(document, law, "commands", kind, controller.commands, steps)
    return CommandSteps(
        tuple(made), tuple(at for at, _ in made.values()), tuple(held for _, held in made.values())
    )
