"""``abhv-mc replay``: fly one flight of a campaign again."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.outputs import new_file
from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A campaign's folder.")],
    flight: Annotated[int, typer.Option(min=0, help="Number of the flight.")],
    controller: Annotated[str, typer.Option(help="Name of the controller.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", callback=new_file, metavar="FILE.parquet", help="Write its history at full rate."
        ),
    ] = None,
    trust_code: Annotated[
        bool, typer.Option("--trust-code", help="Run Python code in the folder that you have not flown yourself.")
    ] = False,
) -> None:
    """Fly one flight again at full rate and compare its metrics with the stored ones, bit for bit.

    Exit code 1 where any differs.
    """
    from abhv_mc.analysis.replay import replay_flight
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.execution.engine import make_engine
    from abhv_mc.flight.channels import CHANNEL_INDEX
    from abhv_mc.folder.histories import write_histories
    from abhv_mc.io.input_error import InputError
    from abhv_mc.user_code.temporary import run_aside

    if out is not None and out.suffix != ".parquet":  # the only kind it writes, whatever the name promises
        raise InputError("--output", None, None, f"'{out.name}'", "a name that ends in .parquet")
    announce_compiling()
    fly = make_engine().fly
    replay = run_aside(lambda: replay_flight(folder, controller, flight, fly, trust_code=trust_code))
    end = f"{replay.outcome.code} after {replay.block.end_time[0]:g} s"
    say(f"flight {flight} of {controller}: {end}. {replay.sentence}")
    for name, value in replay.samples.items():
        say(f"  {name:<40} {value:.10g}")
    for name, value in replay.metrics.items():
        say(f"  {name:<40} {value:.6g}")
    if out is not None:
        block = replay.block
        write_histories(out, controller, [flight], block.times, block.history, list(CHANNEL_INDEX))
        say(f"history   {out}")
    if replay.differences:
        say("metrics differ from the stored ones:", *replay.differences, sep="\n  ")
        raise typer.Exit(ExitCode.FAILED)
    say("metrics equal the stored ones bit for bit")
