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
)
from abhv_mc.cli.outputs import campaign_folder, output, output_folder
from abhv_mc.cli.printing import (
    announce_compiling,
    announce_warnings,
    say,
    show_result,
    text_stream,
)
from abhv_mc.cli.request_options import takes_options
from abhv_mc.cli.starting import imports
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import Refusal
from abhv_mc.io.phrases import grouped_digits
from abhv_mc.requests import Request
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.execution.runner import RunResult
    from abhv_mc.folder.manifest import ControllerCount, Manifest

_WIDTH = 80  # maximum line width, in columns


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
        lambda: _print_result(result, folder_name),
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


def _print_result(result: "RunResult", folder_name: str) -> None:
    manifest = result.manifest
    print_summary(result.folder, manifest, folder_name)
    say(f"folder    {folder_name}")
    is_common = not manifest.complete and len(manifest.controllers) > 1
    by_all = " simulated with every controller" if is_common else ""
    done, planned = map(grouped_digits, (manifest.runs_done, manifest.runs_planned))
    say(f"flights   {done} of {planned}{by_all}, {manifest.state}")
    for name, count in manifest.controllers.items():
        say(f"  {name:<12} {describe_outcomes(count)}")
    print_requirements(manifest)
    say(f"digest    {manifest.digest}")


def print_summary(folder: Path, manifest: "Manifest", folder_name: str) -> None:
    """Print the summary of the report if it includes all stored flights.

    ``folder_name`` is the path or address given by the user.
    """
    from abhv_mc.report.numbers.summary import read_summary

    if (summary := read_summary(folder, manifest)) is not None:
        say(summary.at(shlex.quote(folder_name)), folds=False)


def describe_outcomes(count: "ControllerCount") -> str:
    """Return the numbers of flights of one controller by outcome, as text."""
    outcomes = count.outcomes.items()
    return (
        ", ".join(f"{grouped_digits(number)} {outcome}" for outcome, number in outcomes) or "none"
    )


def print_requirements(manifest: "Manifest") -> None:
    """Print the verdicts by requirement and controller, followed by advice on the verdicts.

    Lines have at most 80 columns.
    """
    entries = (*manifest.requirements, *manifest.requirements_shown)
    if not entries:
        return
    binding_controllers = {entry.controller for entry in manifest.requirements}
    flights = {entry.flights for entry in entries}
    cells: dict[str, dict[str, str]] = {}  # table cells by requirement and controller
    advice: list[str] = []
    for entry in entries:
        row = cells.setdefault(f"{entry.asked} in {100 * entry.probability:g} %", {})
        count = "" if len(flights) == 1 else f" of {grouped_digits(entry.flights)}"
        row[entry.controller] = f"{entry.label} {grouped_digits(entry.failures)}{count}"
        not_run = f"{entry.failures_not_computed} of {entry.failures}"
        advice += (
            [f"{entry.verdict}: failures that failed to run: {not_run}"]
            if entry.failures_not_computed
            else [f"{entry.verdict}: {sentence}" for sentence in entry.words.split("; ")[1:]]
        )
    common_count = next(iter(flights)) if len(flights) == 1 else None
    say(
        "\nVerdict and number of failures"
        + (f" in {grouped_digits(common_count)} flights" if common_count else ""),
        end="",
    )
    say(" (* must meet its requirements)")
    names = list(dict.fromkeys(entry.controller for entry in entries))
    headings = {name: name + " *" * (name in binding_controllers) for name in names}
    width = max(
        map(len, (*headings.values(), *(cell for row in cells.values() for cell in row.values())))
    )
    per_line = max(1, (_WIDTH - 2) // (width + 2))
    for i in range(0, len(names), per_line):
        group = names[i : i + per_line]
        say("  " + "  ".join(f"{headings[name]:<{width}}" for name in group).rstrip())
        for requirement, row in cells.items():
            say(requirement)
            say("  " + "  ".join(f"{row.get(name, ''):<{width}}" for name in group).rstrip())
    for sentence, number in Counter(advice).items():
        verdicts = (
            "verdict is" if len(entries) == 1 else f"verdicts {'is' if number == 1 else 'are'}"
        )
        text = f"{number} of {len(entries)} {verdicts} {sentence}"
        say(fill(text, _WIDTH, subsequent_indent="  ", break_on_hyphens=False))
    say()


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
            help=(
                "One table of flights, or a table of inputs and a table of results (CSV, JSON "
                "Lines, Parquet or Excel)."
            ),
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
    out: Annotated[
        Path | None,
        output(campaign_folder, "DIR", "Results folder to create.", default="reports/NAME"),
    ] = None,
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
    out: Annotated[
        Path | None,
        output(campaign_folder, "DIR", "Results folder to create.", default="reports/NAME"),
    ] = None,
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
