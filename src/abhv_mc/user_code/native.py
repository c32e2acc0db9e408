"""Laws in C and FMUs alike: what one is made of, its design, and how the kernel calls it."""

import json
from collections import namedtuple
from dataclasses import dataclass
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.number_table import NumberTable, read_number_table
from abhv_mc.user_code.c_law import CFlights, inspect_library, open_c_law
from abhv_mc.user_code.fmu_law import FmuFlights, find_states, open_fmu
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import unpack


@dataclass(frozen=True)
class NativeLaw:
    """A law in C or an FMU: its files and what its controller file says of them."""

    source: UserSource

    @property
    def recipe(self) -> dict[str, Any]:
        return json.loads(self.source.text)

    @property
    def design(self) -> str | None:
        """The name of the file of its design: Python, or CSV over time."""
        return self.recipe["design"]

    def design_source(self) -> UserSource:
        """The Python file of its design with all that the law declares."""
        name, files = str(self.design), dict(self.source.files)
        root = self.source.file.removesuffix(self.source.files[0][0])
        text = files.pop(name).decode()
        return UserSource(text, f"{root}{name}", ((name, text.encode()), *files.items()))

    def make_settings(self, numbers: Floats) -> Any:
        """The settings as a named tuple: lists as tuples."""
        values, flat = [], numbers.tolist()
        for _, length in self.recipe["settings"]:
            values.append(tuple(flat[:length]) if length else flat[0])
            flat = flat[max(length, 1) :]
        return namedtuple("Settings", [name for name, _ in self.recipe["settings"]])(*values)

    def read_gains(self, times: Floats) -> tuple[tuple[str, ...], Floats]:
        """Names and columns [tick, gain] of a design in CSV, linear between its times and held outside."""
        path = unpack(self.source) / str(self.design)
        table: NumberTable = read_number_table(path)
        names = tuple(name for name in table.names if name != "time_s")
        if "time_s" not in table.names or not names:
            raise table.error(0, table.names[0], "a design without times or gains", "the column time_s, and others")
        table.check_rising("time_s", "s")
        at = table.values[:, table.names.index("time_s")]
        columns = [np.interp(times, at, table.values[:, table.names.index(name)]) for name in names]
        return names, np.ascontiguousarray(np.array(columns).T)


def find_memory(source: UserSource, settings: Floats, first: Floats) -> dict[str, float] | None:
    """The numbers of a law's memory as it starts, by name; None where it does not give them. Called in the child."""
    if not _is_c(source):
        return find_states(source)
    memory = inspect_library(source, settings, first).memory
    return None if memory is None else {f"memory_{i}": value for i, value in enumerate(memory)}


def open_native(
    source: UserSource,
    gains: tuple[str, ...],
    width: int,
    places: int,
    memory: int | None,
    seen: int,
    effectors: tuple[str, ...],
) -> CFlights | FmuFlights:
    """A law for the flights of one call; see :func:`abhv_mc.user_code.c_law.open_c_law`."""
    if _is_c(source):
        return open_c_law(source, len(gains), width, places, memory, seen, effectors)
    return open_fmu(source, gains, width, places, memory is not None, effectors)


def _is_c(source: UserSource) -> bool:
    return NativeLaw(source).recipe["law"] == "c"
