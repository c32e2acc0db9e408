"""``abhv-mc linearize``: the linear model of a flight under control, in a file."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import MissionOrCampaign, TrustCode, Vehicle
from abhv_mc.cli.outputs import output, output_file
from abhv_mc.cli.printing import say


def command(
    mission: MissionOrCampaign,
    out: Annotated[Path, output(output_file, "FILE", "Ends in .npz, .mat or .json.")],
    vehicle: Vehicle = None,
    controller: Annotated[
        str, typer.Option("--controller", "--controllers", metavar="C", help="Controller file or shipped name.")
    ] = "tlc",
    at: Annotated[
        str, typer.Option(metavar="POINT", help="trim, a time of the nominal flight such as 30s, or 0s:60s:1s.")
    ] = "trim",
    bank: Annotated[str, typer.Option(help="Bank of the steady turn to trim for, deg or with a unit.")] = "0",
    trust_code: TrustCode = False,
) -> None:
    """Write plant, law, open and closed loop about the trim or a time of the nominal flight.

    Path coordinates, second-order actuators, exact zero-order hold; names and units are in the file. Over several times
    (first:last:step) each matrix is an array [time, row, column], with time_s.
    """
    from abhv_mc.cli.margins import read_points, read_setups, take_point
    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.model_file import check_format, make_model, stack_models, write_model

    check_format(out)
    (times, angle) = read_points(at, bank, one=True)
    ((name, setup),) = read_setups(vehicle, mission, controller, one=True, trust_code=trust_code).items()
    models = []
    for time in times:
        plan, points, _ = take_point(setup, name, time, angle)
        models.append(make_model(plan, points, linearize(plan, points)))
    along = [time for time in times if time != "trim"]
    write_model(out, stack_models(models, along) if len(models) > 1 else models[0])
    say(out)
