"""``abhv-mc status``: what a campaign's folder holds."""

from abhv_mc.cli.options import Folder, Json
from abhv_mc.cli.printing import say, show
from abhv_mc.io.address import read_address


def command(
    folder: Folder,
    json: Json = None,
) -> None:
    """Say how far a campaign is, who flies it, and what was found so far."""
    from abhv_mc.cli.run import describe_outcomes, print_requirements
    from abhv_mc.folder.remote import fetched_manifests
    from abhv_mc.folder.status import read_status

    with fetched_manifests(folder, "manifest.json") as (here, describe):
        status = read_status(here, describe and describe(""))
    status["folder"] = str(read_address(folder) or folder)

    def in_words() -> None:
        say(f"{status['name']}: {status['state']}, {status['runs_done']} of {status['runs_planned']} flights")
        if status["holder"]:
            say(f"  flown now by {status['holder']}")
        for name, facts in status["controllers"].items():
            say(f"  {name:<12} {facts['flights_done']} flown: {describe_outcomes(facts)}")
        print_requirements(status)
        say(f"  digest       {status['digest']}")
        say(f"  time flown   {status['wall_time_s']:.1f} s")
        say(f"  on disk      {status['bytes'] / 1e6:.1f} MB")

    show(status, json, in_words)
