"""Command ``verify campaign``, which checks a results folder."""

import typer

from abhv_mc.cli.options import Folder
from abhv_mc.cli.printing import say
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.phrases import quoted

verify = typer.Typer(
    name="verify",
    help="Check the files and numbers of a results folder.",
    no_args_is_help=True,
)


@verify.command("campaign")
def campaign(folder: Folder) -> None:
    """Check the hashes of all files of a campaign and all numbers of its report.

    The numbers are recomputed from the stored flights, which are not run again (use 'replay' to
    re-run a flight). The exit code is 1 if any difference is found.
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
        say(f"{folder}: all files are intact. To create the page of the search again, run:")
        say(search_command(folder, manifest))
        return
    if not has_report:
        say(f"{folder}: all files are intact. To create a report, run: abhv-mc report {folder}")
        return
    say(f"{folder}: all files are intact, and all numbers of the report follow from the flights")
    if skipped:
        say(f"topics not checked because their packages are not installed: {quoted(skipped)}")
