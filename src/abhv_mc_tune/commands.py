"""The command ``tune``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import Json
from abhv_mc.cli.outputs import output_file
from abhv_mc.cli.printing import announce_compiling, print_section, say, show_result, text_stream
from abhv_mc.cli.request_options import takes_options
from abhv_mc_tune.request import TuneRequest

if TYPE_CHECKING:
    from abhv_mc_tune.tuning import TuneFound


@takes_options(TuneRequest)
def tune(request: TuneRequest, json: Json = None) -> None:
    """Tune the free numbers of a controller on common flights, and validate them on fresh ones.

    The new file is written if the paired interval shows a gain within all limits. If not, the best candidate is kept as
    NEW.rejected.yaml, and the exit code is 1. A page beside it shows either. Ctrl-C keeps completed flights.
    """
    page = Path(request.output).with_suffix(".html")
    output_file(page)
    announce_compiling()
    from abhv_mc_tune.api import tune
    from abhv_mc_tune.page import make_tune_answer
    from abhv_mc_tune.tuning import rejected_file

    def tell(found: "TuneFound") -> None:
        show_result(found.as_json(), json, lambda: print_section(make_tune_answer(found).section))

    found = tune(**vars(request) | {"tell": tell})
    told = text_stream(json)
    say(f"report    {page}", file=told)
    if not found.shown:
        out = Path(request.output)
        rejected = rejected_file(out)
        kept = f"; the best candidate is kept in {rejected}" if rejected.exists() else ""
        say(
            f"not shown to be better within the limits: {out} is not written{kept}", file=sys.stderr
        )
        raise typer.Exit(ExitCode.FAILED)
    say(f"controller {request.output}", file=told)
