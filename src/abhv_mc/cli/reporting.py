"""Commands ``report``, ``show``, ``compare`` and ``runs``."""

import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    FLIGHTS,
    Baseline,
    Json,
    Junit,
    Measured,
    Requirements,
    controllers_option,
    folder_argument,
    output,
    output_file,
    output_folder,
    parse_names,
    parse_noise,
)
from abhv_mc.cli.printing import print_section, print_section_table, say, show_result, text_stream
from abhv_mc.cli.running import exit_by_verdicts, print_state
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.address import read_address
from abhv_mc.io.messages import InputError, grouped_digits
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from collections.abc import Sequence

    from abhv_mc.report.numbers.runs import CampaignRun

_REPORTS = Path("reports")
_TEXT_WIDTH = 100  # maximum line width of printed sentences, in columns


def report(
    folder: Annotated[Path, folder_argument("Results folder of a campaign (path or address).")],
    out: Annotated[
        Path | None,
        output(
            output_folder,
            "DIR",
            "Folder for the report.",
            "DIR, or reports/NAME if DIR is an address",
        ),
    ] = None,
    baseline: Baseline = None,
    svg: Annotated[
        bool, typer.Option("--svg", hidden=True, help="Also write the figures as SVG.")
    ] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Write report.pdf (A4); requires Chromium.")
    ] = False,
    brief: Annotated[
        bool,
        typer.Option(
            "--brief", help=("Write the two-page summary brief.pdf instead of report.pdf.")
        ),
    ] = False,
    letter: Annotated[
        bool, typer.Option("--letter", hidden=True, help="Use US letter paper for the PDF.")
    ] = False,
    requirements: Requirements = None,
    junit: Junit = None,
) -> None:
    """Create the report page, figures and report.json from the stored results of a campaign.

    No flight is run. The exit code is 0, whatever the verdicts. With --requirements, the stored
    flights are judged against the requirements in FILE, and the exit code is 1 if a controller
    under test fails any of them; the controllers under test are those of FILE, or else of DIR.
    """
    import json

    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store
    from abhv_mc.report.numbers.summary import parse_summary
    from abhv_mc.report.pages.build import build_report
    from abhv_mc.report.pages.pdf import find_browser, print_pdf
    from abhv_mc.statistics.verdicts import SET_LATER, label_status

    if requirements is not None and out is None:
        raise InputError(
            "--requirements",
            "no folder for the new report is given",
            "-o OUT, because the report in DIR is kept",
        )
    browser = find_browser() if pdf or letter or brief else None

    store = open_store(folder)
    with store.reading() as source:
        if out is None and store.local is None:
            out = output_folder(
                Path("reports") / read_manifest(CampaignFolder(source).manifest).name
            )
        page = build_report(
            source, baseline, svg, stage=Waiting, out=out, requirements=requirements, junit=junit
        )
        say(page)
        if browser is not None:
            with Waiting("report: PDF"):
                printed = print_pdf(page, browser, letter, brief)
            say(printed)
    if requirements is not None:
        numbers = json.loads(page.with_suffix(".json").read_text("utf-8"))
        say(parse_summary(numbers["summary"]).at(shlex.quote(str(folder))), folds=False)
        exit_by_verdicts(
            (name, label_status(verdict["status"], SET_LATER in verdict["note"]))
            for entry in numbers["verdicts"]["requirements"]
            for name, verdict in entry["controllers"].items()
            if name in entry["asked"]["controllers"]
        )


def show(
    topic: Annotated[
        str, typer.Argument(metavar="TOPIC", help="Topic of the report, such as margins.")
    ],
    folder: Annotated[Path, folder_argument()],
    json: Json = None,
) -> None:
    """Print the summary or the tables of a report topic, or its numbers with --json.

    The topics are summary, verdicts, comparison, metrics, flights, failure_cases, failures,
    drivers, envelopes, margins, simulator, convergence, provenance, and topics of installed
    packages.
    """
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.report.numbers.summary import summarize
    from abhv_mc.topics.formatting import json_data
    from abhv_mc.topics.registry import find_topic
    from abhv_mc.topics.topic import Models

    selected = None if topic == "summary" else find_topic(topic)
    models = Models(read_flown(folder))
    model = models[selected] if selected else summarize(models)
    models.results.refuse_changes()

    def print_text() -> None:
        if selected is None:
            say(model.at(shlex.quote(str(folder))), folds=False)
            return
        section = models.section(selected)
        if section is None:
            say(f"This campaign has no results on {topic}.")
        tables = section.tables() if section else ()
        for table in tables:
            print_section_table(table)
        # A section without tables consists of text.
        for item in section.items if section and not tables else ():
            say(getattr(item, "text", item))

    show_result(json_data(model), json, print_text)


def compare(
    first: Annotated[
        list[Path], folder_argument(f"Results folder of campaign A, or {FLIGHTS}", "FIRST")
    ],
    second: Annotated[
        Path,
        folder_argument("Results folder of campaign B; for test flights, or its file.", "SECOND"),
    ],
    controllers: Annotated[
        str | None,
        controllers_option(
            "Compare controller A of campaign A with controller B of campaign B, or test flights "
            "with controller A."
        ),
    ] = None,
    fail_if_worse: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=5%",
            help="Exit with code 1 unless B is shown to be no more than this percentage worse than "
            "A in the metric; repeatable.",
        ),
    ] = None,
    fail_if_loses: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Exit with code 1 if N or more flights terminate early with B but not with A.",
        ),
    ] = None,
    measured: Measured = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Folder for a report page.")] = None,
    requirements: Requirements = None,
    json: Json = None,
) -> None:
    """Compare two campaigns, or test flights with a campaign.

    Campaigns with the same samples are compared flight by flight. If the samples differ, verdicts,
    failure rates and quantiles are compared. Without --controllers, each controller of A is
    compared with the controller of the same name in B.

    --fail-if-worse METRIC=5% accepts B only if it is shown to be at most 5 % worse on more than
    half of the flights. B also fails if its 95 % or 99.73 % quantile is shown to be worse by more
    than 5 %, its worst flight is twice as bad, more flights terminate early, or a requirement is
    missed more often.

    For test flights, the command simulates 199 sets of flights, in which flights of one vehicle
    share the vehicle's parameters and measured parameters have their measured values. It prints the
    rank of each metric among the simulated flights, the p-value of each flight, corrected for the
    number of flights, the channel and time at which a history first leaves the simultaneous 95 %
    band, and a joint p-value of several flights.
    """
    from abhv_mc.report.numbers.compare import Compared, parse_margins
    from abhv_mc.report.pages.compare_page import compare_folders
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.place_page import make_place_answer
    from abhv_mc.search.place import place_flights

    is_flights = len(first) > 1 or first[0].is_file()
    if (fail_if_worse or fail_if_loses or requirements) if is_flights else measured:
        raise InputError(
            "compare",
            "options for two campaigns and for test flights are mixed",
            "--measured only for test flights; --fail-if-worse, --fail-if-loses and --requirements "
            "only for two campaigns",
        )
    if is_flights:
        campaign = find_input(second, "campaign")
        placement = place_flights(campaign, first, controllers, parse_noise(measured))
        page = make_place_answer(placement, campaign)
        numbers = vars(placement).copy()
        del numbers["bands"], numbers["times"]
        show_result(numbers, json, lambda: print_section(page.section))
        if out is not None:
            say(f"report    {write_answer(page, out / 'report.html')}", file=text_stream(json))
        return
    margins = parse_margins(fail_if_worse or [])
    comparison = compare_folders(
        first[0],
        second,
        parse_names(controllers) or (),
        margins,
        out,
        requirements,
        bool(fail_if_loses),
    )
    result = comparison.found
    show_result(result, json, lambda: print_section(comparison.section))
    if comparison.page is not None:
        say(f"report    {comparison.page}", file=text_stream(json))
    paired = result.paired if isinstance(result, Compared) else ()
    gates = [gate for pair in paired for gate in pair.not_worse.values()]
    newly_lost = [pair.newly_lost for pair in paired] if fail_if_loses else []
    for pair in paired if fail_if_loses else ():
        names = " -> ".join(pair.controllers)
        say(f"newly terminated early, {names}: {pair.newly_lost}", file=text_stream(json))
    if not all(gate.shown for gate in gates) or max(newly_lost, default=0) >= (fail_if_loses or 1):
        raise typer.Exit(ExitCode.FAILED)


def runs(
    folder: Annotated[
        Path, folder_argument("Folder that contains results folders, or one results folder.")
    ] = _REPORTS,
    out: Annotated[
        Path | None,
        output(output_file, "FILE.html", "File for the page.", "index.html in the folder"),
    ] = None,
    json: Json = None,
) -> None:
    """List the campaigns in a folder and their results, and write a page that compares them.

    For one results folder, show its progress, running processes and current verdicts. The command
    reads only the files manifest.json and report.json.
    """
    from abhv_mc.folder.stores import open_store, read_status
    from abhv_mc.report.numbers.runs import find_runs
    from abhv_mc.report.pages.runs_page import write_runs_page

    address = read_address(folder)
    if address is None and not folder.is_dir() and folder != _REPORTS:
        raise InputError(folder, "no such folder", "a folder that contains results folders")
    store = open_store(folder)
    with store.reading("*.json") as local:
        if CampaignFolder(local).manifest.is_file():
            status = replace(read_status(local, store), folder=str(address or folder))
            manifest, repeatable = status.manifest, status.manifest.repeatable
            facts = [
                ("running", status.holder),
                ("repeatable", repeatable and f"{repeatable}: {repeatable.sentence}"),
                ("run time", f"{manifest.wall_time_s:.1f} s"),
                ("disk", f"{status.bytes / 1e6:.1f} MB"),
            ]
            facts = [fact for fact in facts if fact[1]]
            show_result(
                status.as_entries(),
                json,
                lambda: print_state(local, manifest, status.folder, facts),
            )
            return
        campaigns = find_runs(local, store)
        show_result(campaigns.runs, json, lambda: _print_runs(campaigns.runs, folder))
        file = out or (folder / "index.html" if address is None else None)
        if file is not None and campaigns.runs:
            say(f"page      {write_runs_page(campaigns, local, file)}", file=text_stream(json))


def _print_runs(runs: "Sequence[CampaignRun]", folder: Path) -> None:
    from abhv_mc.folder.manifest import COMPLETE
    from abhv_mc.report.pages.runs_page import verdict_counts

    width = min(shutil.get_terminal_size().columns, _TEXT_WIDTH)
    for run in runs:
        say(run.folder)
        count = f"{grouped_digits(run.flights)} flights" if run.state == COMPLETE else run.state
        origin = f"version {run.version} {run.commit[:9]}".strip()
        facts = (run.started[:10], count, verdict_counts(run), origin, f"digest {run.digest[:12]}")
        texts = [
            ", ".join(filter(None, facts)),
            run.question,
            run.answer or "There is no current report.",
        ]
        for text in [f"Not readable: {run.problem}"] if run.problem else filter(None, texts):
            say(fill(text, width, initial_indent="  ", subsequent_indent="  "), folds=False)
    if not runs:
        say(f"no campaigns in {folder}")
