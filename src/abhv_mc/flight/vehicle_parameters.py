"""What flights of a vehicle may be given: the program's parameters, then settings and states of its own functions."""

import functools
from pathlib import Path

from abhv_mc.plant.parameters import OURS, PARAMETERS, Parameter, Parameters
from abhv_mc.vehicle.file import read_vehicle_file
from abhv_mc.vehicle.vehicle_code import VehicleCode, name_states


@functools.lru_cache(maxsize=16)
def vehicle_parameters(code: VehicleCode | None) -> Parameters:
    """Return the parameters in the order of the columns of full rows; ``code`` is the vehicle's, if it has any."""
    if code is None:
        return OURS
    words = {
        **{
            one: f"setting of the vehicle's {one.name.partition('.')[0]} function"
            for one in code.settings
        },
        **dict.fromkeys(code.starts, "added to this custom state at the start"),
    }
    return Parameters(
        (*PARAMETERS, *(Parameter(*one, doc, of_user=True) for one, doc in words.items()))
    )


def read_vehicle_parameters(
    vehicle: str | Path,
) -> tuple[Parameters, tuple[tuple[str, str], ...]]:
    """Return the parameters of a vehicle file, and names and units of its custom states. Raise InputError."""
    code = read_vehicle_file(vehicle).code
    return vehicle_parameters(code), name_states(code)
