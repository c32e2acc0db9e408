"""``abhv-mc merge``: the shards of a campaign, or campaigns of one question, as one."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Json, NoReport, TrustCode
from abhv_mc.cli.outputs import campaign_folder, output


def command(
    parts: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of all shards, or of campaigns.")],
    out: Annotated[Path | None, output(campaign_folder, "DIR", "New folder.", default="reports/NAME")] = None,
    no_report: NoReport = False,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Join the shards of a campaign (run --shard i/n), or campaigns of one question with different seeds.

    Shards give the campaign flown in one piece: the same digest, envelopes and histories. Of several seeds the flights
    are numbered on and judged together; bands and histories are flown once more.
    """
    from abhv_mc.cli.run import finish
    from abhv_mc.execution.merge import merge_campaign
    from abhv_mc.folder.layout import CampaignFolder
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.remote import fetched

    with ExitStack() as stack:
        here = [stack.enter_context(fetched(part)) for part in parts]
        manifest = read_manifest(CampaignFolder(here[0]).manifest)
        merged = merge_campaign(here, out or Path("reports") / manifest.name, trust_code=trust_code)
    finish(merged, no_report, json)
