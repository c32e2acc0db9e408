"""``verify``: a results folder against itself. Packages add checks against published data."""

import typer

from abhv_mc.cli.options import Folder
from abhv_mc.cli.printing import say
from abhv_mc.folder.layout import CampaignFolder

verify = typer.Typer(
    name="verify",
    help="Check flights against published data, and a results folder against itself.",
    no_args_is_help=True,
)


@verify.command("campaign")
def campaign(folder: Folder) -> None:
    """Check every file of a campaign's folder by its hash, and every number of its report; exit 1 at a difference.

    Numbers are computed anew from the flights. Nothing is flown again: replay does that with one flight.
    """
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store
    from abhv_mc.report.pages.build import search_command
    from abhv_mc.report.pages.verify import skipped_topics, verify_campaign

    with open_store(folder).reading() as source:
        for difference in verify_campaign(source):
            say(difference)
            raise typer.Exit(1)
        manifest = read_manifest(CampaignFolder(source).manifest)
        skipped = skipped_topics(source)
        has_report = (source / "report.json").is_file()
    if manifest.search:
        say(
            f"{folder}: every file is as the search wrote it; this makes its page again from its flights:"
        )
        say(search_command(folder, manifest))
        return
    if not has_report:
        say(
            f"{folder}: every file is as it was written; no report to check: abhv-mc report {folder}"
        )
        return
    say(
        f"{folder}: every file is as it was written, and every number of the report follows from the flights"
    )
    if skipped:
        say(f"not checked, as they are not installed here: the topics {', '.join(skipped)}")
