"""Command ``tune``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json, output_file, takes_options
from abhv_mc.cli.printing import announce_compiling, print_section, say, show_result, text_stream
from abhv_mc_tune.request import TuneRequest

if TYPE_CHECKING:
    from abhv_mc_tune.tuning import TuneFound


@takes_options(TuneRequest)
def tune(request: TuneRequest, json: Json = None) -> None:
    """Tune the free parameters of a controller, and validate the result on new flights.

    The new file is written if the interval of the paired differences shows an improvement and all
    limits are met. Otherwise, the best candidate is written to NEW.rejected.yaml, and the exit code
    is 1. A page next to the file shows the result. After Ctrl-C, completed flights are kept.
    """
    page = Path(request.output).with_suffix(".html")
    output_file(page)
    announce_compiling()
    from abhv_mc_tune.api import tune
    from abhv_mc_tune.page import make_tune_answer
    from abhv_mc_tune.tuning import rejected_file

    def print_result(result: "TuneFound") -> None:
        show_result(result.as_json(), json, lambda: print_section(make_tune_answer(result).section))

    result = tune(**vars(request) | {"tell": print_result})
    stream = text_stream(json)
    say(f"report    {page}", file=stream)
    if not result.shown:
        out = Path(request.output)
        rejected = rejected_file(out)
        say(
            f"no candidate that meets the limits is shown to be better; {out} was not written",
            file=sys.stderr,
        )
        if rejected.exists():
            say(f"rejected: the best candidate is in {rejected}", file=sys.stderr)
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {request.output}", file=stream)
