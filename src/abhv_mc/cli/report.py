"""``abhv-mc report``: make the report of a flown campaign again."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Baseline, folder_argument
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, folder_argument("Folder of a campaign, or its address.")],
    out: Annotated[Path | None, output(output_folder, "DIR", "Where to.", "DIR; reports/NAME for an address")] = None,
    baseline: Baseline = None,
    svg: Annotated[bool, typer.Option("--svg", help="Write each figure as SVG, too.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Print report.pdf (A4), where a Chromium is found.")] = False,
    letter: Annotated[bool, typer.Option("--letter", help="Print it on US letter.")] = False,
) -> None:
    """Make the page, the figures and report.json from a campaign's Parquet alone."""
    import shutil
    from functools import partial

    from abhv_mc.execution.progress import Waiting
    from abhv_mc.folder.layout import CampaignFolder, write_whole
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.remote import fetched, local_path
    from abhv_mc.report.pages.build import build_report
    from abhv_mc.report.pages.pdf import find_browser, print_pdf

    browser = find_browser() if pdf or letter else None

    with fetched(folder) as source:
        page = build_report(source, baseline, svg, stage=Waiting)
        if out is None and local_path(folder) is None:
            out = output_folder(Path("reports") / read_manifest(CampaignFolder(source).manifest).name)
        if out is not None:
            figures = (f"figures/{path.name}" for path in (source / "figures").iterdir())
            for name in (page.name, "report.json", *figures):
                write_whole(out / name, partial(shutil.copyfile, source / name))
            page = out / page.name
        say(page)
        if browser is not None:
            with Waiting("report: PDF"):
                printed = print_pdf(page, browser, letter)
            say(printed)
