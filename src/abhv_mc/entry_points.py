"""Entry points of installed packages in the groups ``abhv_mc.*``.

=========================== ============================================ ===========================
group                       object                                       name
=========================== ============================================ ===========================
``abhv_mc.commands``        a function for typer, or a ``typer.Typer``   command: ``list.metrics``
``abhv_mc.functions``       a function of ``import abhv_mc``             function
``abhv_mc.campaign_blocks`` check of a block, ``(Experiment) -> None``   block
``abhv_mc.executors``       an ``abhv_mc.interfaces.Connect``            scheme of ``--scheduler``
``abhv_mc.law_backends``    a ``user_code.native_loop.LawBackend``       ``law`` of controller files
``abhv_mc.simulators``      a ``Simulator``, or a ``Registered``         ``simulator: {package:}``
``abhv_mc.stores``          an ``interfaces.Store`` made of an address   scheme of the address
``abhv_mc.topics``          an ``abhv_mc.topics.Topic``                  any
=========================== ============================================ ===========================
"""

import contextlib
import functools
from collections.abc import Iterator
from importlib.metadata import EntryPoint, distributions
from typing import Any

COMMANDS, FUNCTIONS, TOPICS = "abhv_mc.commands", "abhv_mc.functions", "abhv_mc.topics"
BLOCKS, LAW_BACKENDS = "abhv_mc.campaign_blocks", "abhv_mc.law_backends"
VEHICLE = "abhv_mc_vehicle"  # package of the built-in simulator
EXECUTORS, STORES, SIMULATORS = "abhv_mc.executors", "abhv_mc.stores", "abhv_mc.simulators"
_SHOW_ONLY = (COMMANDS, FUNCTIONS, TOPICS)


@functools.cache
def _read() -> dict[str, dict[str, EntryPoint]]:
    """Return entry points by group and name.

    The function ``importlib.metadata.entry_points`` would take four times as long, because it
    parses the entry points of all distributions.
    """
    groups: dict[str, dict[str, EntryPoint]] = {}
    for distribution in distributions():
        if "[abhv_mc." in (distribution.read_text("entry_points.txt") or ""):
            for entry in distribution.entry_points:
                if entry.group.startswith("abhv_mc."):
                    groups.setdefault(entry.group, {}).setdefault(entry.name, entry)
    return groups


def find_entry_points(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, without importing them."""
    return _read().get(group, {})


def load_entry_point(group: str, name: str) -> Any:
    """Return the object of an entry point, or None if no installed package registers it."""
    entry = find_entry_points(group).get(name)
    return None if entry is None else entry.load()


def find_packages() -> list[str]:
    """Return the installed packages that may change results.

    A package may change results if it registers anything other than commands, functions and topics.
    """
    return sorted(
        {
            entry.module.partition(".")[0]
            for group, names in _read().items()
            if group not in _SHOW_ONLY
            for entry in names.values()
        }
    )


@contextlib.contextmanager
def needs_vehicle(name: str) -> Iterator[None]:
    """State, if the package abhv_mc_vehicle is not installed, that ``name`` needs it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != VEHICLE:
            raise
        raise ModuleNotFoundError(
            f"{name} needs the package {VEHICLE}, which is not installed", name=error.name
        ) from None
