"""A vehicle ready to fly: its file packed, each build-up term tied to the parameter that disperses it."""

from pathlib import Path

from abhv_mc.io.documents import InputError
from abhv_mc.io.input_files import made_once
from abhv_mc.plant.effectiveness import count_rows
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.state import MAX_AXES, MAX_TABLE_ROWS
from abhv_mc.vehicle.file import read_vehicle
from abhv_mc.vehicle.model import Vehicle


def load_vehicle(path: str | Path) -> Vehicle:
    """Read and pack a vehicle file. Raises :class:`abhv_mc.io.documents.InputError`."""
    return made_once("vehicle", path, lambda: _load(path))


def _load(path: str | Path) -> Vehicle:
    vehicle = read_vehicle(path, PARAMETER_INDEX)
    rows, axes = count_rows(vehicle), vehicle.tables.axis_variable.size
    if rows > MAX_TABLE_ROWS:
        found = (
            f"tables that fill {rows} rows (those on equal axes share rows in eights; slopes with deflections count)"
        )
        raise InputError(path, None, None, found, f"at most {MAX_TABLE_ROWS}")
    if axes > MAX_AXES:
        raise InputError(path, None, None, f"tables on {axes} different grids", f"at most {MAX_AXES}")
    return vehicle
