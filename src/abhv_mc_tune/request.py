"""Options of a tuning run, on the command line and in Python."""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

from abhv_mc.requests import (
    CampaignPath,
    CheckedRequest,
    Controller,
    Option,
    Paths,
    Scheduler,
    Seed,
    Workers,
)


@dataclass(frozen=True)
class TuneRequest(CheckedRequest):
    """Options of a tuning run."""

    campaign: CampaignPath
    output: Annotated[
        Paths, Option("Controller file to write; a page is written next to the file.", "new file")
    ]
    _: KW_ONLY
    controller: Controller = None
    block: Annotated[
        Paths | None, Option("File that contains the block 'tune'.", "file", "CAMPAIGN")
    ] = None
    seed: Seed = None
    workers: Workers = None
    scheduler: Scheduler = None
    tell: Annotated[
        Callable[[Any], None] | None,
        Option("Function called with the result before the controller file is written.", ""),
    ] = None
