"""Commands ``run``, ``import flights`` and ``merge``."""

import shlex
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import IO, TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    Fresh,
    Json,
    Junit,
    NoReport,
    Requirements,
    TrustCode,
    campaign_folder,
    output,
    output_folder,
    takes_options,
)
from abhv_mc.cli.printing import (
    announce_compiling,
    announce_warnings,
    new_table,
    print_table,
    say,
    show_result,
    text_stream,
)
from abhv_mc.cli.starting import imports
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.address import read_address
from abhv_mc.io.messages import Refusal, grouped_digits
from abhv_mc.requests import Request
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.execution.runner import RunResult
    from abhv_mc.folder.manifest import Manifest

_WIDTH = 80  # maximum line width, in columns
_NewFolder = Annotated[
    Path | None, output(campaign_folder, "DIR", "Results folder to create.", "reports/NAME")
]
_MOST_COLUMNS = 6  # maximum number of controllers listed as columns instead of rows


@takes_options(Request)
def run(
    request: Request,
    no_report: NoReport = False,
    json: Json = None,
    junit: Junit = None,
    staging: Annotated[
        Path | None,
        typer.Option(
            callback=output_folder,
            metavar="DIR",
            hidden=True,
            help="Folder for the local copy of the results if the output is an address.",
            show_default="a temporary folder",
        ),
    ] = None,
) -> None:
    """Run or resume a campaign, and create its report.

    After Ctrl-C, completed flights are kept; run the same command to resume. The exit code is 1 if
    a controller under test fails a requirement (see 'under_test' in the campaign file), and 3 if
    flights are missing or failed to run.
    """
    announce_compiling()
    from abhv_mc.execution.runner import run_campaign
    from abhv_mc.folder.stores import open_store

    baseline = None if request.baseline is None else Path(request.baseline)
    if baseline is not None:
        from abhv_mc.campaign.file.check import read_campaign
        from abhv_mc.report.numbers.compare import check_baseline

        if no_report or request.shard is not None:
            raise Refusal(
                "--baseline requires a report", "the option without --no-report and --shard"
            )
        campaign = read_campaign(request.campaign, request.runs, request.seed, request.controllers)
        check_baseline(campaign, baseline)
    out = None if request.output is None else Path(request.output)
    with open_store(out).writing(staging) if out else nullcontext() as folder:
        result = run_campaign(replace(request, output=folder))
        finish(result, no_report or request.shard is not None, json, out, junit, baseline)


def finish(
    result: "RunResult",
    no_report: bool,
    json: Path | None = None,
    address: Path | None = None,
    junit: Path | None = None,
    baseline: Path | None = None,
    can_rerun: bool = True,
) -> None:
    """Create the report, print the result, and exit with the corresponding code.

    ``address`` is the path or address given by the user; ``can_rerun`` is true if the same
    command repeats flights that failed to run.
    """
    from abhv_mc.folder.merge import suggest_merge

    folder_name = str(read_address(address or "") or result.folder)
    stream = text_stream(json)
    entries = result.manifest.requirements
    outcomes = [counts.outcomes for counts in result.manifest.controllers.values()]
    page = ""
    if (
        result.complete
        and not no_report
        and any(set(counts) - {"failed_to_run"} for counts in outcomes)
    ):
        from abhv_mc.report.pages.build import build_report, is_up_to_date

        is_current = is_up_to_date(result.folder, baseline)
        page = (
            "report.html, up to date"
            if is_current
            else build_report(result.folder, baseline, stage=Waiting).name
        )
    show_result(
        result.manifest.as_entries() | {"folder": folder_name},
        json,
        lambda: print_state(result.folder, result.manifest, folder_name),
    )
    if junit is not None:
        from abhv_mc.report.pages.matrix import make_junit, verdict_cases

        junit.write_text(make_junit(result.manifest.name, verdict_cases(entries)), "utf-8")
    announce_warnings(result.manifest.warnings)
    if not result.complete:
        say("incomplete: run the same command to resume", file=sys.stderr)
        raise typer.Exit(ExitCode.INCOMPLETE)
    if page:
        say(f"report    {folder_name}/{page}", file=stream)
    if failed_to_run := sum(counts.get("failed_to_run", 0) for counts in outcomes):
        remedy = "; run the same command to try again" if can_rerun else ""
        say(f"flights that failed to run: {failed_to_run}{remedy}", file=sys.stderr)
        raise typer.Exit(ExitCode.INCOMPLETE)
    if result.manifest.not_made:  # Each failure has already been printed.
        raise typer.Exit(ExitCode.INCOMPLETE)
    sentence, command = suggest_merge(result.folder, result.manifest)
    if sentence:
        say(f"{sentence} To judge all flights together, run: {command}", file=stream)
    exit_by_verdicts(((entry.controller, entry.label) for entry in entries), stream)


def print_state(
    folder: Path, manifest: "Manifest", name: str, facts: Iterable[tuple[str, object]] = ()
) -> None:
    """Print the report's summary if it is current, and a campaign's progress, verdicts and facts.

    ``name`` is the path or address of the folder given by the user.
    """
    from abhv_mc.report.numbers.summary import read_summary

    if (summary := read_summary(folder, manifest)) is not None:
        say(summary.at(shlex.quote(name)), folds=False)
    is_common = not manifest.complete and len(manifest.controllers) > 1
    by_all = " simulated with every controller" if is_common else ""
    done, planned = map(grouped_digits, (manifest.runs_done, manifest.runs_planned))
    say(f"folder    {name}\nflights   {manifest.state}, {done} of {planned}{by_all}")
    for controller, count in manifest.controllers.items():
        outcomes = (f"{grouped_digits(n)} {outcome}" for outcome, n in count.outcomes.items())
        say(f"  {controller:<12} {', '.join(outcomes) or 'none'}")
    _print_requirements(manifest)
    for label, fact in (("digest", manifest.digest), *facts):
        say(f"{label:<9} {fact}")


def _print_requirements(manifest: "Manifest") -> None:
    """Print the verdicts by requirement and controller, and the reasons for verdicts."""
    entries = (*manifest.requirements, *manifest.requirements_shown)
    if not entries:
        return
    binding = {entry.controller for entry in manifest.requirements}
    marks = {e.controller: f"{e.controller}{' *' * (e.controller in binding)}" for e in entries}
    cells: dict[str, dict[str, str]] = {}  # table cells by requirement and controller
    reasons: Counter[str] = Counter()
    for entry in entries:
        counts = f"{grouped_digits(entry.failures)} of {grouped_digits(entry.flights)}"
        asked = f"{entry.asked} in {100 * entry.probability:g} %"
        row = cells.setdefault(asked, dict.fromkeys(marks.values(), ""))
        row[marks[entry.controller]] = f"{entry.label} {counts}"
        reasons.update(f"{entry.verdict}: {text}" for text in entry.words.split("; ")[1:])
    if len(marks) > _MOST_COLUMNS:
        cells = {
            mark: {asked: row[mark] for asked, row in cells.items()} for mark in marks.values()
        }
    heads = "", *next(iter(cells.values()))
    table = new_table(heads, (), "\nVerdict and number of failures (* must meet its requirements)")
    for head, row in cells.items():
        table.add_row(head, *row.values())
    print_table(table)
    for reason, number in reasons.items():
        text = f"{number} of {len(entries)} verdicts {reason}"
        say(fill(text, _WIDTH, subsequent_indent="  ", break_on_hyphens=False))


def exit_by_verdicts(labels: Iterable[tuple[str, str]], stream: IO[str] | None = None) -> None:
    """Print the binding verdicts (controller, label) with the exit code, and exit if one failed."""
    counts: dict[str, Counter[str]] = {}
    for controller, label in labels:
        counts.setdefault(controller, Counter())[label] += 1
    is_failed = any(label.startswith("FAIL") for own in counts.values() for label in own)
    code = ExitCode.FAILED if is_failed else ExitCode.DONE
    texts = [
        f"{controller}: {', '.join(f'{count} {label}' for label, count in own.items())}"
        for controller, own in counts.items()
    ]
    if texts:
        text = "; ".join([*texts, f"exit code {code}"])
        text = fill(text, _WIDTH, initial_indent="verdicts  ", subsequent_indent=" " * 10)
        say(text, file=stream)
    if code:
        raise typer.Exit(code)


@imports.command()
def flights(
    tables: Annotated[
        list[Path],
        typer.Argument(
            metavar="TABLE...",
            help="One table of flights, or a table of inputs and a table of results (CSV, JSON "
            "Lines, Parquet or Excel).",
        ),
    ],
    campaign: Annotated[
        Path,
        typer.Option(
            "--campaign",
            metavar="FILE",
            help="Campaign file that declares 'inputs' and 'metrics' but no simulator.",
        ),
    ],
    out: _NewFolder = None,
    no_report: NoReport = False,
    fresh: Fresh = False,
    json: Json = None,
    junit: Junit = None,
) -> None:
    """Import flights computed by another simulator and create their report.

    TABLE has one row per flight, one column for each dispersed input and metric, and optional
    columns system, outcome and flight. Headers may give units, as in 'altitude_min [ft]'. Inputs
    (see 'validate --samples') and results may be in two tables, which are paired by flight number;
    flights without results count as flights that failed to run. Verdicts require 'independent:
    true' in FILE, and inputs that pass statistical tests for independent draws. After an
    interruption, run the same command to resume. The exit codes are those of 'run'.
    """
    from abhv_mc.execution.table_import import import_tables

    result = import_tables(tables, find_input(campaign, "campaign"), out, fresh)
    finish(result, no_report, json, out or result.folder, junit, can_rerun=False)


def merge(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR...",
            help=("Results folders of all shards of a campaign, or of the campaigns to pool."),
        ),
    ],
    out: _NewFolder = None,
    no_report: NoReport = False,
    json: Json = None,
    trust_code: TrustCode = False,
    requirements: Requirements = None,
) -> None:
    """Merge the shards of a campaign, or campaigns that differ only in their seed.

    Shards are run with 'run --shard I/N'. Merged shards have the same digest, envelopes and
    histories as a campaign run in one piece. Flights of several seeds are renumbered and judged
    together; the flights that envelopes and histories need are run again.
    """
    from abhv_mc.execution.merge import merge_campaign
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store

    with ExitStack() as stack:
        folders = [stack.enter_context(open_store(path).reading()) for path in paths]
        manifest = read_manifest(CampaignFolder(folders[0]).manifest)
        merged = merge_campaign(
            folders,
            out or Path("reports") / manifest.name,
            trust_code=trust_code,
            requirements=requirements,
        )
    finish(merged, no_report, json)
