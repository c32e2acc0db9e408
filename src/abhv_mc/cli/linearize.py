"""``abhv-mc linearize``: the linear model of a flight under control, in a file."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import MissionOrCampaign, TrustCode, Vehicle
from abhv_mc.cli.outputs import output, output_file
from abhv_mc.cli.printing import say
from abhv_mc.io.input_error import InputError


def command(
    mission: MissionOrCampaign,
    out: Annotated[
        Path | None, output(output_file, "FILE", "Required; ends in .npz, .mat or .json.", default=False)
    ] = None,
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
    from abhv_mc.cli.margins import find_flown, read_times
    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.model_file import check_format, make_model, stack_models, write_model

    if out is not None:
        check_format(out)
    times = read_times(at)
    if len(times) > 1 and "trim" in times:
        raise InputError("--at", f"'{at}'", "one point, or times such as 0s:60s:1s")
    files = find_flown(vehicle, mission, controller, trust_code)
    if len(files.controllers) > 1:
        raise InputError("--controller", ", ".join(files.controllers), "one controller")
    if out is None:
        raise InputError("--output", "no file", "one that ends in .npz, .mat or .json (-o FILE)")
    (file,) = files.controllers.values()
    models = []
    for time in times:
        plan, points, _ = files.take(file, time, bank, times)
        models.append(make_model(plan, points, linearize(plan, points)))
    along = [time for time in times if time != "trim"]
    write_model(out, stack_models(models, along) if len(models) > 1 else models[0])
    say(out)
