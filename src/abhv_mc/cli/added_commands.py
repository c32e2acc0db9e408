"""Commands that packages register as entry points of the group ``abhv_mc.commands``.

An entry point has the name of its command, such as ``explore``. The name of a subcommand follows
the name of the group and a dot, as in ``list.vehicles``. The entry point refers to a function with
annotations for typer, or to a ``typer.Typer``. A package is imported when one of its commands is
run or listed. If the import fails, a warning is printed and the commands of the package are
omitted.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from functools import cached_property
from importlib.metadata import EntryPoint
from typing import Any

from abhv_mc.cli.printing import announce_warnings
from abhv_mc.entry_points import COMMANDS, find_entry_points


class Commands(MutableMapping[str, Any]):
    """Commands of one group, including commands that packages add."""

    def __init__(
        self,
        own: Mapping[str, Any],
        family: str,
        order: Iterable[str],
        make: Callable[[str, Any], Any],
    ) -> None:
        self._commands, self._family, self._make = dict(own), family, make
        self._order = {name: k for k, name in enumerate(order)}
        self._unusable: set[str] = set()  # packages that cannot be imported

    @cached_property
    def _added(self) -> dict[str, EntryPoint]:
        entries = {
            name.removeprefix(self._family): entry
            for name, entry in find_entry_points(COMMANDS).items()
            if name.startswith(self._family)
        }
        return {name: entry for name, entry in entries.items() if "." not in name}

    def __getitem__(self, name: str) -> Any:
        if name not in self._commands:
            self._commands[name] = self._make(name, self._load(name, self._added[name]))
        return self._commands[name]

    def _load(self, name: str, entry: EntryPoint) -> Any:
        package = entry.module.partition(".")[0]
        try:
            return entry.load()
        except Exception as error:
            if package not in self._unusable:
                self._unusable.add(package)
                reason = f"{type(error).__name__}: {error}"
                announce_warnings([f"the commands of {package} are not available ({reason})"])
            raise KeyError(name) from None

    def __setitem__(self, name: str, command: Any) -> None:
        self._commands[name] = command

    def __delitem__(self, name: str) -> None:
        del self._commands[name]

    def __iter__(self) -> Iterator[str]:
        names = dict.fromkeys((*self._commands, *self._added))
        return iter(sorted(names, key=lambda name: self._order.get(name, len(self._order))))

    def __len__(self) -> int:
        return len({*self._commands, *self._added})
