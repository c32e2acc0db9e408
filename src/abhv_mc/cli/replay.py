"""``abhv-mc replay``: fly one flight of a campaign again."""

from math import isnan
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Controller, Folder, Json, TrustCode
from abhv_mc.cli.outputs import output, output_file
from abhv_mc.cli.printing import say, show
from abhv_mc.io.input_error import InputError


def command(
    folder: Folder,
    flight: Annotated[int, typer.Option(min=0, help="Number of the flight.")],
    controller: Controller = None,
    out: Annotated[Path | None, output(output_file, "FILE.parquet", "Write its history at full rate.")] = None,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Fly one flight again at full rate and compare its metrics with the stored ones, bit for bit.

    Exit code 1 where any differs.
    """
    from abhv_mc.analysis.replay import replay_flight
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.folder.histories import write_histories
    from abhv_mc.folder.inputs import first_controller
    from abhv_mc.simulators.engine import make_engine
    from abhv_mc.user_code.child import run_in_thread

    if out is not None and out.suffix != ".parquet":  # the only kind it writes, whatever the name promises
        raise InputError("--output", f"'{out.name}'", "a name that ends in .parquet")
    controller = controller or first_controller(folder)
    announce_compiling()
    fly = make_engine().fly
    replay = run_in_thread(lambda: replay_flight(folder, controller, flight, fly, trust_code=trust_code))
    block = replay.block
    if out is not None and not block.history.size:
        raise InputError("--output", "flights that return no history", "no --output")
    if out is not None:
        names = [channel.name for channel in replay.channels]
        write_histories(out, controller, [flight], block.times, block.history, names, known=replay.channels)

    def in_words() -> None:
        end = replay.outcome + ("" if isnan(block.end_time[0]) else f" after {block.end_time[0]:g} s")
        say(f"flight {flight} of {controller}: {end}. {replay.sentence}")
        for name, value in replay.samples.items():
            say(f"  {name:<40} {value:.10g}")
        for name, value in replay.metrics.items():
            say(f"  {name:<40} {value:.6g}")
        if out is not None:
            say(f"history   {out}")
        if replay.differences:
            say("metrics differ from the stored ones:", *replay.differences, sep="\n  ")
        else:
            say("metrics equal the stored ones bit for bit")

    figures = {"flight": flight, "controller": controller, "outcome": replay.outcome}
    figures |= {"end_time_s": block.end_time[0], "samples": replay.samples, "metrics": replay.metrics}
    show(figures | {"differences": list(replay.differences)}, json, in_words)
    if replay.differences:
        raise typer.Exit(ExitCode.FAILED)
