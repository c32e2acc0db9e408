"""What a valid vehicle file probably does not mean."""

from abhv_mc.vehicle.derivatives import doubtful_derivatives
from abhv_mc.vehicle.model import Vehicle


def find_vehicle_warnings(vehicle: Vehicle) -> list[str]:
    """A sentence (without its full stop) for each thing that a user should know before flying the vehicle."""
    warnings = []
    constants = vehicle.constants
    if constants.equivalence_ratio_max > 0.0 and constants.burns_fuel == 0.0:
        warnings.append("the vehicle file has no mass.empty, so the engine burns no fuel and the mass stays as it is")
    return [*warnings, *doubtful_derivatives(vehicle)]
