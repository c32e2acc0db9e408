"""Plans kept on disk beside the compiled code, so that the next start need not solve for them again.

A plan is found by what it is made from: the source of every layer that has a part in it, the libraries' versions and
all numbers of its vehicle, mission and controller. Names and times of files do not count, so no plan is ever stale.
"""

import contextlib
import hashlib
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import scipy

from abhv_mc.code_cache import cache_folder
from abhv_mc.control.controller_file import Controller
from abhv_mc.control.mission import Mission, Recorded
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.vehicle.model import Vehicle

KEPT = 12  # plans of 2 to 3 MB each
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


def find_plan_file(vehicle: Vehicle, mission: Mission, controller: Controller) -> Path | None:
    """Where the plan of these is kept, whether it is there or not; None for a mission that refers to another file."""
    if isinstance(mission.manoeuvre, Recorded):
        return None
    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__}".encode())  # the folder's name covers the source
    digest.update(mission.model_dump_json().encode())
    digest.update(controller.model_dump_json().encode())
    for name, value in _flatten(vehicle, "vehicle"):
        digest.update(f"{name} {np.shape(value)} {np.asarray(value).dtype}".encode())
        digest.update(np.ascontiguousarray(value).data)
    return cache_folder() / "plans" / f"{digest.hexdigest()[:32]}.npz"


def recall_plan(file: Path) -> FlightPlan | None:
    """The plan kept in a file, None where there is none that can be read."""
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as values:
            plan = FlightPlan(**{name: _rebuild(of, values, name) for name, of in get_type_hints(FlightPlan).items()})
        os.utime(file)
    except _UNREADABLE:
        return None
    return plan


def keep_plan(file: Path, plan: FlightPlan) -> None:
    """Keep a plan, and only the latest few; a disk that takes no more is no fault."""
    values = dict(pair for name in get_type_hints(FlightPlan) for pair in _flatten(getattr(plan, name), name))
    with contextlib.suppress(OSError):
        with atomic_write(file) as aside, aside.open("wb") as stream:
            np.savez(stream, **values)
        latest_first = sorted(file.parent.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for old in latest_first[KEPT:]:
            old.unlink(missing_ok=True)


def _flatten(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Arrays and numbers of nested named tuples, with their dotted names."""
    if hasattr(value, "_fields"):
        for field in value._fields:
            yield from _flatten(getattr(value, field), f"{name}.{field}")
    else:
        yield name, value


def _rebuild(of: Any, values: Any, name: str) -> Any:
    """A value of a type, a named tuple's included, from what :func:`_flatten` made of it."""
    if hasattr(of, "_fields"):
        return of(**{field: _rebuild(inner, values, f"{name}.{field}") for field, inner in get_type_hints(of).items()})
    return of(values[name].item()) if of in (int, float, str) else values[name]
