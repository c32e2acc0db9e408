"""``abhv-mc status``: what a campaign's folder holds."""

from dataclasses import replace

from abhv_mc.cli.options import Folder, Json
from abhv_mc.cli.printing import say, show
from abhv_mc.io.address import read_address


def command(
    folder: Folder,
    json: Json = None,
) -> None:
    """Say how far a campaign is, who flies it, and what was found so far."""
    from abhv_mc.cli.run import describe_outcomes, print_judgement, print_requirements
    from abhv_mc.folder.remote import fetched_manifests
    from abhv_mc.folder.status import read_status

    def in_words() -> None:
        manifest = status.manifest
        print_judgement(here, manifest, status.folder)
        say(f"{manifest.name}: {manifest.state}, {manifest.runs_done} of {manifest.runs_planned} flights")
        if status.holder:
            say(f"  flown now by {status.holder}")
        for name, each in manifest.controllers.items():
            say(f"  {name:<12} {each.flights_done} flown: {describe_outcomes(each)}")
        print_requirements(manifest)
        say(f"  digest       {manifest.digest}")
        say(f"  time flown   {manifest.wall_time_s:.1f} s")
        say(f"  on disk      {status.bytes / 1e6:.1f} MB")

    with fetched_manifests(folder, "*.json") as (here, describe):
        status = replace(read_status(here, describe and describe("")), folder=str(read_address(folder) or folder))
        show(status.as_entries(), json, in_words)
