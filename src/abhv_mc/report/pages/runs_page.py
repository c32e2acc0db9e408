"""Page that lists the campaigns below a folder and lets users filter and compare them."""

import os
import shlex
from pathlib import Path

from markupsafe import Markup

from abhv_mc.folder.layout import write_text
from abhv_mc.report.numbers.runs import CampaignRun, CampaignRuns
from abhv_mc.report.pages.flights_view import template_text
from abhv_mc.report.pages.page import make_environment, script_hashes, script_json
from abhv_mc.topics.formatting import fixed


def verdict_counts(run: CampaignRun) -> str:
    """Return verdict counts and controllers, such as '3 PASS, 2 FAIL of tlc'."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in run.verdicts.items())
    return f"{counts} of {', '.join(run.controllers)}" if counts else ""


def write_runs_page(campaigns: CampaignRuns, root: Path, file: Path) -> Path:
    """Write the page to ``file``; links and commands are relative to the file's folder."""
    base = Path(os.path.relpath(root.absolute(), file.absolute().parent))
    rows = []
    for run in campaigns.runs:
        folder = (base / run.folder).as_posix()
        flights = fixed(run.flights, 0)
        if run.flights != run.flights_planned:
            flights += f" of {fixed(run.flights_planned, 0)}, {run.state}"
        rows.append(
            {
                "run": run,
                "folder": folder,
                "typed": shlex.quote(folder),
                "page": f"{folder}/report.html" if run.has_page else "",
                "verdicts": verdict_counts(run),
                "flights": flights,
            }
        )
    pages = {key: (base / page).as_posix() for key, page in campaigns.comparisons.items()}
    script = template_text("runs.js")
    page = (
        make_environment()
        .get_template("runs.html.j2")
        .render(
            rows=rows,
            title=f"Campaigns in {root.absolute().name}",
            style=Markup(template_text("style.css")),  # noqa: S704  files of this package
            script=Markup(script),  # noqa: S704
            script_hashes=script_hashes(script),
            data=script_json(pages),
        )
    )
    write_text(file, page)
    return file
