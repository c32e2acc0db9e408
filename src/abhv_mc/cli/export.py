"""``abhv-mc export``: a campaign's tables as CSV, and a controller's gains for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Folder
from abhv_mc.cli.outputs import output_file, output_folder
from abhv_mc.cli.printing import say
from abhv_mc.io.input_error import InputError
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

GAINS = "gains"


def command(
    folder: Folder,
    mission: Annotated[
        str | None, typer.Argument(metavar="[MISSION]", help="After gains: mission file, or a shipped one's name.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PATH", help="Where to: a folder; of gains, a .mat, .csv or .h file."),
    ] = None,
    controller: Annotated[
        str, typer.Option("--controller", "--controllers", metavar="C", help="Of gains: file or shipped name.")
    ] = "tlc",
    vehicle: Annotated[
        str, typer.Option(metavar="V", help="Of gains: vehicle file, or shipped name.")
    ] = DEFAULT_VEHICLE,
) -> None:
    """Write every table as a CSV file; numbers read back to the same bits.

    ``export gains MISSION --controller lqr -o gains.mat`` writes a controller's gains over time instead.
    """
    if str(folder) == GAINS and mission is not None:
        from abhv_mc.one_flight.given import make_flight_plan
        from abhv_mc.simulators.export_gains import check_gain_format, write_gains

        if out is None:
            raise InputError("--output", "no file", "a file that ends in .mat, .csv or .h")
        check_gain_format(out)
        files = find_input(mission, "mission"), find_input(vehicle, "vehicle"), find_input(controller, "control")
        write_gains(output_file(out) or out, make_flight_plan(*files))
        say(out)
        return
    from abhv_mc.folder.export import export_csv
    from abhv_mc.folder.remote import fetched, local_path

    if mission is not None:
        raise InputError(mission, "a second argument", f"nothing after the folder, or '{GAINS}' before it")
    out = output_folder(out)
    if out is None and local_path(folder) is None:
        raise InputError("--output", "nothing, for a campaign at an address", "-o DIR: where to")
    with fetched(folder) as source:
        for path in export_csv(source, out or folder / "csv"):
            say(path)
