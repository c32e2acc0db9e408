"""Flight plans as .npz without pickle: the numbers of nested named tuples and dataclasses as named arrays.

Compiled code follows a plan's index arrays without a look at their bounds. So no file holds them: they are rebuilt from
the campaign's inputs, and what is read are floating-point numbers, of the shapes that belong to them.
"""

import dataclasses
import io
import typing
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.control.columns import LQR_GAINS, LQR_SETTINGS, REFERENCE, TLC_GAINS, TLC_SETTINGS
from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.design.trim_tables import rebuild_trim_tables
from abhv_mc.control.law_file import UserController
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.layout import CampaignFolder, write_bytes
from abhv_mc.io.input_error import InputError
from abhv_mc.plant.air_profile import PROFILE
from abhv_mc.plant.effectiveness import make_effectiveness
from abhv_mc.plant.state import N_STATES
from abhv_mc.user_code.c_source import with_library
from abhv_mc.user_code.law_source import read_law_source
from abhv_mc.user_code.source import UserSource, read_source
from abhv_mc.user_code.trust import check_trusted
from abhv_mc.user_code.vehicle_functions import check_vehicle_trusted, find_code, load_vehicle
from abhv_mc.vehicle.model import Vehicle

T = TypeVar("T")
_WISH = "a copy of the plan as it was, or the campaign flown anew: another folder (-o DIR), or --fresh"
_COLUMNS = {"tlc": (len(TLC_GAINS), len(TLC_SETTINGS)), "lqr": (len(LQR_GAINS), len(LQR_SETTINGS))}
_REBUILT = "effectiveness."  # follows from the vehicle


def flatten(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Arrays and scalars of a nested record by dotted name."""
    if not _is_record(type(value)):
        return {prefix: np.asarray(value)}
    flat: dict[str, np.ndarray] = {}
    for name in _fields(type(value)):
        flat |= flatten(getattr(value, name), f"{prefix}.{name}" if prefix else name)
    return flat


def rebuild(kind: type[T], flat: Mapping[str, np.ndarray], prefix: str = "") -> T:
    """The record of type ``kind`` from what :func:`flatten` gave, with contiguous arrays.

    Raises KeyError for a missing part and ValueError for one that is no such number or array.
    """
    if _is_record(kind):
        hints = typing.get_type_hints(kind)
        parts = {name: rebuild(hints[name], flat, f"{prefix}.{name}" if prefix else name) for name in _fields(kind)}
        return kind(**parts)
    value = flat[prefix]
    if kind in (bool, int, float, str):
        return kind(value.item())  # type: ignore[call-arg]
    if typing.get_origin(kind) is tuple:  # of floats
        return tuple(value.tolist())  # type: ignore[return-value]
    expected = np.dtype(typing.get_args(typing.get_args(kind)[1])[0])
    return np.require(value, None if expected.kind == "U" else expected, ["C", "A"])  # type: ignore[return-value]


def write_plan(path: Path, plan: FlightPlan) -> None:
    """Store a plan's numbers and words."""
    content = io.BytesIO()
    np.savez_compressed(content, **stored_parts(plan))  # type: ignore[arg-type]
    write_bytes(path, content.getvalue(), durable=True)


def stored_parts(plan: FlightPlan) -> dict[str, np.ndarray]:
    """What of a plan is stored: no array of whole numbers, and nothing that follows from the rest."""
    numbers = {name: value for name, value in flatten(plan).items() if value.ndim == 0 or value.dtype.kind in "fU"}
    return {name: value for name, value in numbers.items() if not name.startswith(_REBUILT)}


def read_plan(path: Path, vehicle: Vehicle) -> FlightPlan:
    """A stored plan, equal to the bit. ``vehicle`` is of the campaign that wrote it.

    Raises InputError where it is missing, damaged, or of another vehicle.
    """
    try:
        return _rebuild_plan(read_stored_parts(path), vehicle)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(path, f"a damaged plan ({error})", _WISH) from None


def read_stored_parts(path: Path) -> dict[str, np.ndarray]:
    """What :func:`stored_parts` gave. Raises InputError."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    except FileNotFoundError:
        raise InputError(path, "no such file", _WISH) from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(path, f"a damaged plan ({error})", _WISH) from None


def _rebuild_plan(stored: dict[str, np.ndarray], vehicle: Vehicle) -> FlightPlan:
    flat = {name: value for name, value in stored.items() if value.ndim == 0 or value.dtype.kind in "fU"}
    for name, value in flatten(vehicle, "vehicle").items():
        if value.dtype.kind == "f":
            _check_shape(name, flat[name], value.shape)
        else:
            flat[name] = value
    numbers = (flat[f"trim_tables.{name}"] for name in ("grid", "inverse_step", "data"))
    flat |= flatten(rebuild_trim_tables(*numbers), "trim_tables")
    flat |= flatten(make_effectiveness(rebuild(Vehicle, flat, "vehicle")), "effectiveness")
    plan = rebuild(FlightPlan, flat)
    own = plan.gain_names.size, plan.settings.size  # a law of the user's says how many
    gains, settings = _COLUMNS.get(plan.law, own)
    rows = plan.timing.ticks + 1
    shapes = {
        "initial_state": (N_STATES,),
        "reference": (rows, len(REFERENCE)),
        "gains": (rows, gains),
        "settings": (settings,),
        "profile": (len(plan.profile), len(PROFILE)),
    }
    for name, shape in shapes.items():
        _check_shape(name, getattr(plan, name), shape)
    return plan


def _check_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: shape {array.shape} instead of {shape}")


def read_trusted_plan(
    folder: CampaignFolder, campaign: CheckedCampaign, controller: str, trusted: bool = False
) -> FlightPlan:
    """The stored plan of one of a folder's controllers with the code that it needs, from the folder's copies.

    Raises InputError where the code is missing, or is not in the user's list of what he has flown.
    """
    check_vehicle_trusted(campaign.model.vehicle, trusted)
    plan = read_plan(folder.plan(controller), load_vehicle(campaign.model.vehicle))
    if plan.source_hash:
        place = folder.inputs / "controllers" / controller
        plan = dataclasses.replace(plan, source=_take(_read_laws(place), place, plan.source_hash, trusted))
    if plan.channels_hash:
        place = folder.inputs / "channels"
        sources = map(read_source, sorted(place.rglob("*.py")))
        plan = dataclasses.replace(plan, channels_source=_take(sources, place, plan.channels_hash, trusted))
    return dataclasses.replace(plan, vehicle_code=find_code(plan.vehicle)).lean_for(campaign.names)


def _read_laws(place: Path) -> Iterator[UserSource]:
    """The code of every controller file in a folder."""
    for path in sorted(place.rglob("*.y*ml")):
        controller = read_controller(path)
        if isinstance(controller, UserController):
            yield read_law_source(controller)


def _take(sources: Iterable[UserSource], place: Path, digest: str, trusted: bool) -> UserSource:
    for source in sources:
        if source.hash == digest:
            check_trusted(source, trusted)
            return with_library(source)
    raise InputError(place, "no copy of the code that was flown", _WISH)


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.metadata.get("stored", True))
    return tuple(kind._fields)
