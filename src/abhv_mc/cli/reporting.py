"""``report``, ``show``, ``runs``, ``compare``, ``whatif``: what campaigns say."""

from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    Baseline,
    Controller,
    Json,
    Junit,
    Requirements,
    controllers_option,
    folder_argument,
    parse_names,
)
from abhv_mc.cli.outputs import output, output_file, output_folder
from abhv_mc.cli.printing import (
    answer,
    beside,
    new_table,
    print_section,
    print_section_table,
    print_table,
    say,
)
from abhv_mc.cli.running import describe_outcomes, print_judgement, print_requirements
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from abhv_mc.folder.status import Status
    from abhv_mc.report.numbers.runs import CampaignRun
    from abhv_mc.report.numbers.whatif import Whatif

_REPORTS = Path("reports")


def report(
    folder: Annotated[Path, folder_argument("Folder of a campaign, or its address.")],
    out: Annotated[
        Path | None, output(output_folder, "DIR", "Where to.", "DIR; reports/NAME for an address")
    ] = None,
    baseline: Baseline = None,
    svg: Annotated[bool, typer.Option("--svg", help="Write each figure as SVG, too.")] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print report.pdf (A4), where a Chromium is found.")
    ] = False,
    brief: Annotated[
        bool, typer.Option("--brief", help="Print brief.pdf, two pages of it, in its place.")
    ] = False,
    letter: Annotated[bool, typer.Option("--letter", help="Print it on US letter.")] = False,
    requirements: Requirements = None,
    junit: Junit = None,
) -> None:
    """Make the page, the figures and report.json from a campaign's Parquet alone.

    With --requirements the stored flights are judged by others and nothing is run; the exit code is 1 if one fails.
    """
    import json

    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store
    from abhv_mc.report.pages.build import build_report
    from abhv_mc.report.pages.pdf import find_browser, print_pdf

    if requirements is not None and out is None:
        raise InputError("--requirements", "no -o OUT", "-o OUT: DIR keeps the report of its own")
    browser = find_browser() if pdf or letter or brief else None

    store = open_store(folder)
    with store.reading() as source:
        if out is None and store.local is None:
            out = output_folder(
                Path("reports") / read_manifest(CampaignFolder(source).manifest).name
            )
        page = build_report(
            source,
            baseline,
            svg,
            stage=Waiting,
            out=out,
            requirements=requirements,
            junit=junit,
        )
        say(page)
        if browser is not None:
            with Waiting("report: PDF"):
                printed = print_pdf(page, browser, letter, brief)
            say(printed)
    if requirements is not None:
        judgement = json.loads(page.with_suffix(".json").read_text("utf-8"))["judgement"]
        say(judgement["answer"], *judgement["because"], judgement["sure"], sep="\n")
        if judgement["met"] == "no":
            raise typer.Exit(ExitCode.FAILED)


def show(
    topic: Annotated[
        str, typer.Argument(metavar="TOPIC", help="A topic of the report, such as margins.")
    ],
    folder: Annotated[Path, folder_argument("Folder of a campaign.")],
    json: Json = None,
) -> None:
    """Print what the report says of a topic: its sentences and tables, or its numbers with --json.

    Topics: verdicts, comparison, metrics, flights, failure_cases, failures, drivers, envelopes, margins, simulator,
    convergence, provenance, and those of installed packages.
    """
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.topics.json_data import json_data
    from abhv_mc.topics.registry import find_topic
    from abhv_mc.topics.topic import Models

    asked = find_topic(topic)
    models = Models(read_flown(folder))
    model = models[asked]
    models.results.refuse_changes()

    def in_words() -> None:
        for sentence in models.sentences(asked):
            say(sentence)
        section = models.section(asked)
        if section is None:
            say(f"nothing on {topic} in this campaign")
        tables = section.tables() if section else ()
        for table in tables:
            print_section_table(table)
        for item in (
            section.items if section and not tables else ()
        ):  # its words then stand in no table
            words = getattr(item, "sentences", (getattr(item, "text", ""),))
            say("\n".join(words))

    answer(json_data(model), json, in_words)


def compare(
    folder_a: Annotated[Path, folder_argument("Folder of a campaign.", "DIR_A")],
    folder_b: Annotated[Path, folder_argument("Folder of another campaign.", "DIR_B")],
    controllers: Annotated[
        str | None, controllers_option("Compare A of DIR_A with B of DIR_B.")
    ] = None,
    fail_if_worse: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=5%", help="Exit 1 where B is worse than that; repeatable."),
    ] = None,
    fail_if_loses: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Exit 1 where B loses N or more flights that A does not."
        ),
    ] = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write a page there.")] = None,
    requirements: Requirements = None,
    json: Json = None,
) -> None:
    """Compare two campaigns: flight by flight on the same samples, else by verdicts, shares and quantiles.

    Without --controllers, each controller that both flew is compared with itself. --fail-if-worse stops B unless it is
    shown to be at most so much worse on more than half of the flights; and where its 95 % or 99.73 % quantile is shown
    to be worse by more, its worst flight is twice as bad, it loses more flights, or misses a requirement more often.
    """
    from abhv_mc.report.numbers.compare import Compared, parse_margins
    from abhv_mc.report.pages.compare_page import compare_folders

    margins = parse_margins(fail_if_worse or [])
    comparison = compare_folders(
        folder_a,
        folder_b,
        parse_names(controllers) or (),
        margins,
        out,
        requirements,
        bool(fail_if_loses),
    )
    found = comparison.found
    answer(found, json, lambda: print_section(comparison.section))
    if comparison.page is not None:
        say(f"report    {comparison.page}", file=beside(json))
    paired = found.paired if isinstance(found, Compared) else ()
    gates = [gate for pair in paired for gate in pair.not_worse.values()]
    newly_lost = [pair.newly_lost for pair in paired] if fail_if_loses else []
    for pair, lost in zip(paired, newly_lost, strict=False):
        say(f"{pair.b} loses {lost} flights that {pair.a} does not", file=beside(json))
    if not all(gate.shown for gate in gates) or max(newly_lost, default=0) >= (fail_if_loses or 1):
        raise typer.Exit(ExitCode.FAILED)


def place(
    flights: Annotated[
        list[Path],
        typer.Argument(
            metavar="FLIGHT.csv",
            help="Histories with a column time (s) and channels, or rows of metrics.",
        ),
    ],
    folder: Annotated[Path, folder_argument("Folder of a campaign with sampling: random.")],
    controller: Controller = None,
    measured: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CHANNEL=SIGMA",
            help="Standard deviation of a channel's measurement noise, in its unit; repeatable.",
        ),
    ] = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write a page there.")] = None,
    json: Json = None,
) -> None:
    """Compare test flights with a campaign: does the dispersed model cover them?

    Prints the rank of each metric among the simulated flights, the joint p-value of all metrics, and where a history
    leaves the simultaneous 95 % band first; of several flights also whether they differ together.
    """
    from abhv_mc.analysis.place import place_flights
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.place_page import make_place_answer

    found = place_flights(folder, flights, controller, _parse_noise(measured or []))
    shown = make_place_answer(found, folder)
    answer(
        {key: value for key, value in vars(found).items() if key != "bands"},
        json,
        lambda: print_section(shown.section),
    )
    if out is not None:
        say(f"report    {write_answer(shown, out / 'report.html')}", file=beside(json))


def _parse_noise(words: list[str]) -> dict[str, float]:
    """Return standard deviations by channel. Raises InputError."""
    noise: dict[str, float] = {}
    for word in words:
        channel, _, number = word.partition("=")
        try:
            noise[channel] = float(number)
        except ValueError:
            noise[channel] = -1.0
        if not 0.0 < noise[channel] < inf:
            raise InputError("--measured", f"'{word}'", "CHANNEL=SIGMA with a positive number")
    return noise


def whatif(
    folder: Annotated[Path, folder_argument("Folder of a campaign with sampling: random.")],
    settings: Annotated[
        list[str],
        typer.Option(
            "--set", metavar="K=V", help="For example aero.drag.half_width=12%; may be repeated."
        ),
    ],
    requirements: Requirements = None,
    json: Json = None,
) -> None:
    """Estimate results under other dispersions by re-weighting existing flights.

    Refused where the flights do not cover what is asked, or where too few of them count.
    """
    from abhv_mc.analysis.reweight import parse_settings
    from abhv_mc.report.numbers.whatif import make_whatif

    found = make_whatif(folder, parse_settings(settings), requirements)
    answer(found, json, lambda: _print_whatif(found))


def _print_whatif(found: "Whatif") -> None:
    from abhv_mc.topics.formatting import bounds, estimate, percent, significant
    from abhv_mc.topics.names import controller_label

    for name, after in found.after.items():
        say(f"{name}: {_entry(found.before[name])}  ->  {_entry(after)}")
    if found.stopped_when_proven:
        say("The campaign stopped when proven; the intervals do not allow for that.")
    for name, part in found.controllers.items():
        worth = significant(part.effective_flights)
        title = f"{controller_label(name)}: {part.flights} flights, worth {worth} under the changed dispersions"
        table = new_table(("",), ("quantile", "as flown", "changed"), title)
        for metric in found.asked:
            for level, pair in part.metrics.get(metric, {}).items():
                label = found.words[metric]["label"] if level == "q50" else ""
                cells = [
                    f"{estimate(cell)} ({bounds(cell) or 'no bounds'})"
                    for cell in (pair.before, pair.after)
                ]
                table.add_row(label, f"{level[1:]} %", *cells)
        for entry in part.requirements:
            shares = entry.failure_share.before, entry.failure_share.after
            cells = [
                f"{percent(cell.value)} ({percent(cell.low)} to {percent(cell.high)})"
                for cell in shares
            ]
            table.add_row(f"Failed: {entry.words}", "", *cells)
        print_table(table)


def _entry(entry: "Mapping[str, object]") -> str:
    return ", ".join(f"{key} {value}" for key, value in entry.items())


def runs(
    folder: Annotated[
        Path, folder_argument("Folder that holds campaigns' folders; or one campaign's.")
    ] = _REPORTS,
    out: Annotated[
        Path | None, output(output_file, "FILE.html", "The page.", "index.html in the folder")
    ] = None,
    json: Json = None,
) -> None:
    """List the campaigns below a folder with their answers, and write a page that sorts, filters and compares them.

    Of one campaign's folder, say how far it is, who runs it, and what was found so far. Nothing but manifests and
    report.json is read.
    """
    from abhv_mc.folder.status import read_status
    from abhv_mc.folder.stores import open_store
    from abhv_mc.report.numbers.runs import find_runs
    from abhv_mc.report.pages.runs_page import write_runs_page

    address = read_address(folder)
    if address is None and not folder.is_dir() and folder != _REPORTS:
        raise InputError(folder, "no such folder", "one that holds campaigns' folders")
    store = open_store(folder)
    with store.reading("*.json") as here:
        if CampaignFolder(here).manifest.is_file():
            found = replace(read_status(here, store), folder=str(address or folder))
            answer(found.as_entries(), json, lambda: _print_status(found, here))
            return
        campaigns = find_runs(here, store)
        answer(campaigns.runs, json, lambda: _print_runs(campaigns.runs, folder))
        file = out or (folder / "index.html" if address is None else None)
        if file is not None and campaigns.runs:
            say(f"page      {write_runs_page(campaigns, here, file)}", file=beside(json))


def _print_runs(runs: "Sequence[CampaignRun]", folder: Path) -> None:
    from abhv_mc.folder.manifest import COMPLETE
    from abhv_mc.report.pages.runs_page import verdict_counts

    table = new_table(("Campaign", "Run", "Verdicts", "Question and answer"), ())
    for run in runs:
        if run.problem:
            table.add_row(run.folder, "", "", f"Not read: {run.problem}")
            continue
        origin = f"{run.version} {run.commit[:9]}".strip()
        count = f"{run.flights} flights" if run.state == COMPLETE else run.state
        facts = "\n".join(filter(None, (run.started[:10], count, origin, run.digest[:12])))
        words = "\n".join(filter(None, (run.question, run.answer))) or "No report of these flights."
        table.add_row(run.folder, facts, verdict_counts(run).replace(", ", "\n"), words)
    print_table(table) if runs else say(f"no campaigns in {folder}")


def _print_status(found: "Status", here: Path) -> None:
    manifest = found.manifest
    print_judgement(here, manifest, found.folder)
    say(
        f"{manifest.name}: {manifest.state}, {manifest.runs_done} of {manifest.runs_planned} flights"
    )
    if found.holder:
        say(f"  flown now by {found.holder}")
    for name, each in manifest.controllers.items():
        say(f"  {name:<12} {each.flights_done} flown: {describe_outcomes(each)}")
    print_requirements(manifest)
    if manifest.repeatable is not None:
        say(f"  repeatable   {manifest.repeatable}: {manifest.repeatable.sentence}")
    say(f"  digest       {manifest.digest}")
    say(f"  time flown   {manifest.wall_time_s:.1f} s")
    say(f"  on disk      {found.bytes / 1e6:.1f} MB")
