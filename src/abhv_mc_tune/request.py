"""Request of a tuning: its fields are the options of the command and the arguments of the Python function."""

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
    """Request of better numbers for a controller."""

    campaign: CampaignPath
    output: Annotated[Paths, Option("Controller file to write; its page lies beside.", "new file")]
    _: KW_ONLY
    controller: Controller = None
    block: Annotated[Paths | None, Option("File with the block 'tune'.", "file", "CAMPAIGN")] = None
    seed: Seed = None
    workers: Workers = None
    scheduler: Scheduler = None
    tell: Annotated[
        Callable[[Any], None] | None,
        Option("Function of the result, called just before the controller file is written.", ""),
    ] = None
