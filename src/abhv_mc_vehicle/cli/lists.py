"""Lists of shipped vehicles, missions and controllers, and of parameters, channels and metrics."""

from typing import Annotated

import typer

from abhv_mc.cli.options import Json
from abhv_mc.cli.printing import show_result
from abhv_mc.cli.querying import list_shipped, show_records
from abhv_mc.shipped import find_input


def vehicles(json: Json = None) -> None:
    """List the shipped vehicles."""
    list_shipped("vehicle", json)


def missions(json: Json = None) -> None:
    """List the shipped missions."""
    list_shipped("mission", json)


def controllers(json: Json = None) -> None:
    """List the shipped controllers."""
    list_shipped("control", json)


def parameters(
    vehicle: Annotated[
        str | None,
        typer.Argument(
            metavar="VEHICLE",
            help="Vehicle (file or name) whose settings and custom states are also listed.",
            show_default=False,
        ),
    ] = None,
    json: Json = None,
) -> None:
    """List the parameters that a campaign may disperse; the unit '-' means dimensionless."""
    from abhv_mc_vehicle.flight.vehicle_parameters import read_vehicle_parameters
    from abhv_mc_vehicle.plant.parameters import OURS

    definitions = read_vehicle_parameters(find_input(vehicle, "vehicle"))[0] if vehicle else OURS
    keys = ("name", "unit", "nominal", "doc")
    records = [definitions[name] for name in definitions.dispersible]
    show_records([{key: getattr(record, key) for key in keys} for record in records], json)


def channels(json: Json = None) -> None:
    """List the channels recorded in histories, envelopes and replays."""
    from abhv_mc_vehicle.flight.channels import CHANNELS

    show_records(
        [{"name": channel.name, "unit": channel.unit, "doc": channel.doc} for channel in CHANNELS],
        json,
    )


def metrics(
    campaign: Annotated[
        str | None,
        typer.Argument(
            metavar="[CAMPAIGN]",
            help="Campaign file, or name of a shipped campaign, whose metrics are also listed.",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """List the metrics of a flight, with unit, worse values (high or low), group and meaning.

    Stability margins, which are computed only if a campaign requests them, are listed last. The
    definition states the source or expression, statistic, limit and window that would declare the
    same metric in a campaign file.
    """
    from abhv_mc.flights.metrics import MARGINS
    from abhv_mc_vehicle.flight.metrics import BUILT_IN

    records = list(BUILT_IN.values())
    if campaign is not None:
        from abhv_mc.campaign.file.check import read_campaign

        read = read_campaign(find_input(campaign, "campaign"))
        margins = MARGINS if read.simulator.mission else ()
        records = [*read.measured, *margins]
    if json is not None:
        show_result([record.as_entry() for record in records], json, lambda: None)
        return
    columns = ("name", "unit", "bad", "group", "counted", "doc")
    show_records([{key: getattr(record, key) for key in columns} for record in records], None)
