"""Registration of the built-in simulator in the group ``abhv_mc.simulators``."""

from typing import Any

from abhv_mc.campaign.file.systems import Registered
from abhv_mc.compiling import tell
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.metrics import BUILT_IN, METRIC_INDEX
from abhv_mc_vehicle.kernel.compiler_target import choose_interface, find_level
from abhv_mc_vehicle.kernel.jit import set_compile_listener
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from abhv_mc_vehicle.vehicle_simulator.campaign_file import (
    VehicleCampaign,
    draw_members,
    name_effectors,
    read_contents,
)
from abhv_mc_vehicle.vehicle_simulator.simulator import VehicleSimulator
from abhv_mc_vehicle.vehicle_simulator.variants import add_variants

Schema = dict[str, Any]
_OWN_METRIC = "^[a-z][a-z0-9_]*$"
_OWN_CHANNEL = "^[a-z][a-z0-9_.]*$"
# Pattern of the parameters that other files define, such as settings of custom functions.
_OWN_PARAMETER = "^(failure|aerodynamics|propulsion|dynamics|law|initial)[.]"


def _enumerate_names(parts: Schema) -> None:
    """Add enumerations of metrics, parameters and channels to a schema.

    Campaigns with custom metrics also accept other metric names.
    """
    campaign = parts["VehicleCampaign"]
    metrics = {"enum": [*METRIC_INDEX, *MARGIN_NAMES]}
    own = {"pattern": _OWN_METRIC}
    for subschema in parts.values():
        for key in {"metric", "by"} & set(subschema.get("properties", ())):
            subschema["properties"][key] |= {"anyOf": [metrics, own]}
    campaign["if"] = {"not": {"anyOf": [{"required": ["metrics"]}, {"required": ["keep_out"]}]}}
    campaign["then"] = {
        "properties": {"requirements": {"items": {"properties": {"metric": metrics}}}}
    }

    shipped = [parameter.name for parameter in PARAMETERS if "." in parameter.name]
    names: Schema = {"anyOf": [{"enum": shipped}, {"pattern": _OWN_PARAMETER}]}
    for key in ("dispersions", "unknowns", "derived"):
        campaign["properties"][key]["propertyNames"] = names
    parts["Correlation"]["properties"]["between"]["prefixItems"] = [{"type": "string", **names}] * 2
    for keep in ("VehicleHistories", "VehicleEnvelopes"):
        channel_name = {
            "type": "string",
            "anyOf": [{"enum": ["all", *CHANNEL_INDEX]}, {"pattern": _OWN_CHANNEL}],
        }
        parts[keep]["properties"]["channels"]["anyOf"] = [
            channel_name,
            {"type": "array", "items": channel_name},
        ]


set_compile_listener(tell)
VEHICLE = Registered(
    VehicleSimulator,
    VehicleCampaign,
    read_contents,
    prepare=lambda document: add_variants(draw_members(name_effectors(document))),
    files={
        "vehicle": "abhv_mc_vehicle.vehicle.document:VehicleDocument",
        "mission": "abhv_mc_vehicle.control.mission:Mission",
        "controller": "abhv_mc_vehicle.control.controller_file:ControllerFile",
    },
    enumerate_names=_enumerate_names,
    metrics=tuple(BUILT_IN),
    version=lambda: f"kernels {find_level(choose_interface())[1]}",
)
