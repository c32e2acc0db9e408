"""A vehicle ready to fly: its file packed, each build-up term tied to the parameter that disperses it."""

from pathlib import Path

from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.vehicle.file import read_vehicle
from abhv_mc.vehicle.model import Vehicle


def load_vehicle(path: str | Path) -> Vehicle:
    """Read and pack a vehicle file. Raises :class:`abhv_mc.documents.InputError`."""
    return read_vehicle(path, PARAMETER_INDEX)
