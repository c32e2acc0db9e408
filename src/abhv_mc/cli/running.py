"""``run``, ``import flights``, ``merge``: campaigns that are run, imported or joined."""

import shlex
import sys
from collections import Counter
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated

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
    answer,
    beside,
    say,
)
from abhv_mc.cli.request_options import takes_options
from abhv_mc.cli.starting import imports
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import Refusal
from abhv_mc.requests import Request
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.execution.runner import RunResult
    from abhv_mc.folder.manifest import ControllerCount, Manifest

_WIDTH = 80  # columns


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
            help="Where the copy of an address lies.",
            show_default="temporary",
        ),
    ] = None,
) -> None:
    """Fly a campaign, resuming what its folder already holds, and make the report.

    Ctrl-C keeps what was flown; the same command goes on. Exit code 1 where a requirement has failed, 3 where flights
    are missing or could not be computed.
    """
    announce_compiling()
    from abhv_mc.execution.runner import run_campaign
    from abhv_mc.folder.stores import open_store

    baseline = None if request.baseline is None else Path(request.baseline)
    if baseline is not None:
        from abhv_mc.campaign.file.check import read_campaign
        from abhv_mc.report.numbers.compare import check_baseline

        if no_report or request.shard is not None:
            raise Refusal("--baseline without a report", "--baseline, or --no-report or --shard")
        asked = read_campaign(request.campaign, request.runs, request.seed, request.controllers)
        check_baseline(asked, baseline)
    out = None if request.output is None else Path(request.output)
    with open_store(out).writing(staging) if out else nullcontext() as folder:
        result = run_campaign(replace(request, output=folder))
        finish(result, no_report or request.shard is not None, json, out, junit, baseline)


def finish(
    result: "RunResult",
    no_report: bool,
    json: Path | None = None,
    place: Path | None = None,
    junit: Path | None = None,
    baseline: Path | None = None,
    flies: bool = True,
) -> None:
    """Make the report, say what came of it, and end with the exit code that it deserves.

    ``place`` is what the user calls the folder: perhaps an address; ``flies``: whether the command flies again.
    """
    from abhv_mc.folder.pooled_campaigns import suggest_merge

    named = str(read_address(place or "") or result.folder)
    told = beside(json)
    entries = result.manifest.requirements
    outcomes = [ended.outcomes for ended in result.manifest.controllers.values()]
    page = ""
    if (
        result.complete
        and not no_report
        and any(set(ended) - {"failed_to_run"} for ended in outcomes)
    ):
        from abhv_mc.report.pages.build import build_report, is_up_to_date

        made = is_up_to_date(result.folder, baseline)
        page = (
            "report.html, up to date"
            if made
            else build_report(result.folder, baseline, stage=Waiting).name
        )
    answer(
        result.manifest.as_entries() | {"folder": named}, json, lambda: _print_result(result, named)
    )
    if junit is not None:
        from abhv_mc.report.pages.matrix import make_junit, verdict_cases

        junit.write_text(make_junit(result.manifest.name, verdict_cases(entries)), "utf-8")
    announce_warnings(result.manifest.warnings)
    if not result.complete:
        say("incomplete: the same command goes on where this one ended", file=sys.stderr)
        raise typer.Exit(ExitCode.INCOMPLETE)
    if page:
        say(f"report    {named}/{page}", file=told)
    if lost := sum(ended.get("failed_to_run", 0) for ended in outcomes):
        count = "1 flight" if lost == 1 else f"{lost} flights"
        again = ": the same command tries again" if flies else ""
        say(f"{count} could not be computed{again}", file=sys.stderr)
        raise typer.Exit(ExitCode.INCOMPLETE)
    if result.manifest.not_made:  # each entry was printed when it failed
        raise typer.Exit(ExitCode.INCOMPLETE)
    siblings, merge = suggest_merge(result.folder, result.manifest)
    if siblings:
        say(f"{siblings} All judged together: {merge}", file=told)
    if entries:
        say(f"verdicts  {describe_verdicts(result.manifest)}", file=told)
    if any(entry.verdict == "FAIL" for entry in entries):
        raise typer.Exit(ExitCode.FAILED)


def _print_result(result: "RunResult", named: str) -> None:
    manifest = result.manifest
    print_judgement(result.folder, manifest, named)
    say(f"folder    {named}")
    all_of_them = "" if manifest.complete or len(manifest.controllers) == 1 else " by all of them"
    say(f"flights   {manifest.runs_done} of {manifest.runs_planned}{all_of_them}, {manifest.state}")
    for name, ended in manifest.controllers.items():
        say(f"  {name:<12} {describe_outcomes(ended)}")
    print_requirements(manifest)
    say(f"digest    {manifest.digest}")


def print_judgement(folder: Path, manifest: "Manifest", named: str) -> None:
    """Say the judgement of a folder's report, where it has one of its flights; ``named``: what the user calls it."""
    from abhv_mc.report.numbers.judgement_record import judgement_lead, read_judgement

    if (found := read_judgement(folder, manifest)) is not None:
        say(*judgement_lead(found, shlex.quote(named)).sentences, sep="\n")


def describe_outcomes(ended: "ControllerCount") -> str:
    """How many of a controller's flights ended in each way."""
    return ", ".join(f"{number} {outcome}" for outcome, number in ended.outcomes.items()) or "none"


def print_requirements(manifest: "Manifest") -> None:
    """Print requirements as rows and controllers as columns, within 80 columns, and the distinct advice once below."""
    entries = (*manifest.requirements, *manifest.requirements_shown)
    if not entries:
        return
    bound = {entry.controller for entry in manifest.requirements}
    flights = {entry.flights for entry in entries}
    cells: dict[str, dict[str, str]] = {}  # by requirement and controller
    advice: list[str] = []
    for entry in entries:
        row = cells.setdefault(f"{entry.asked} in {100 * entry.probability:g} %", {})
        count = "" if len(flights) == 1 else f" of {entry.flights}"
        row[entry.controller] = f"{entry.verdict} {entry.failures}{count}"
        missing = entry.failures_not_computed
        advice += (
            [f"{entry.verdict}: {missing} of {entry.failures} failures were not computed"]
            if missing
            else [f"{entry.verdict}: {words}" for words in entry.words.split("; ")[1:]]
        )
    one = next(iter(flights)) if len(flights) == 1 else None
    say("\nVerdict and number of failures" + (f" in {one} flights" if one else ""), end="")
    say(" (* the exit code follows)")
    names = list(dict.fromkeys(entry.controller for entry in entries))
    heads = {name: name + " *" * (name in bound) for name in names}
    width = max(
        map(len, (*heads.values(), *(cell for row in cells.values() for cell in row.values())))
    )
    at_once = max(1, (_WIDTH - 2) // (width + 2))
    for i in range(0, len(names), at_once):
        shown = names[i : i + at_once]
        say("  " + "  ".join(f"{heads[name]:<{width}}" for name in shown).rstrip())
        for requirement, row in cells.items():
            say(requirement)
            say("  " + "  ".join(f"{row.get(name, ''):<{width}}" for name in shown).rstrip())
    for words, number in Counter(advice).items():
        text = f"{number} of {len(entries)} {words}"
        say(fill(text, _WIDTH, subsequent_indent="  ", break_on_hyphens=False))
    say()


def describe_verdicts(manifest: "Manifest") -> str:
    """'tlc 2 PASS, 1 FAIL; lqr 3 NOT SHOWN. The exit code follows tlc (3 verdicts).'"""
    binding, shown = manifest.requirements, manifest.requirements_shown
    parts = []
    for name in manifest.controllers:
        counts = Counter(entry.verdict for entry in (*binding, *shown) if entry.controller == name)
        parts.append(f"{name} {', '.join(f'{count} {status}' for status, count in counts.items())}")
    bound = Counter(entry.controller for entry in binding)
    follows = ", ".join(f"{name} ({n} verdict{'s' * (n > 1)})" for name, n in bound.items())
    return f"{'; '.join(parts)}. The exit code follows {follows}."


@imports.command()
def flights(
    tables: Annotated[
        list[Path],
        typer.Argument(
            metavar="TABLE...",
            help="CSV, JSON lines, Parquet or Excel: flights, or their inputs and results.",
        ),
    ],
    campaign: Annotated[
        Path,
        typer.Option(
            "--campaign", metavar="FILE", help="Says 'inputs' and 'metrics', and no simulator."
        ),
    ],
    out: Annotated[
        Path | None, output(campaign_folder, "DIR", "Folder.", default="reports/NAME")
    ] = None,
    no_report: NoReport = False,
    fresh: Fresh = False,
    json: Json = None,
    junit: Junit = None,
) -> None:
    """Import flights computed by another simulator and create their report.

    TABLE has a row per flight and a column for each dispersed input and metric, and if wanted system, outcome and
    flight; heads may give units, as in 'altitude_min [ft]'. Inputs (see 'validate --samples') and results may be two
    tables, paired by flight; a flight without results failed to run. Verdicts need 'independent: true' in FILE, and
    rows that pass the tests of independent draws. After an interruption, run the same command to resume. Exit codes
    are those of 'run'.
    """
    from abhv_mc.execution.table_import import import_tables

    result = import_tables(tables, find_input(campaign, "campaign"), out, fresh)
    finish(result, no_report, json, out or result.folder, junit, flies=False)


def merge(
    parts: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders of all shards, or of campaigns.")
    ],
    out: Annotated[
        Path | None, output(campaign_folder, "DIR", "New folder.", default="reports/NAME")
    ] = None,
    no_report: NoReport = False,
    json: Json = None,
    trust_code: TrustCode = False,
    requirements: Requirements = None,
) -> None:
    """Join the shards of a campaign (run --shard i/n), or campaigns of one question with different seeds.

    Shards give the campaign flown in one piece: the same digest, envelopes and histories. Of several seeds the flights
    are numbered on and judged together; bands and histories are flown once more.
    """
    from abhv_mc.execution.merge import merge_campaign
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store

    with ExitStack() as stack:
        here = [stack.enter_context(open_store(part).reading()) for part in parts]
        manifest = read_manifest(CampaignFolder(here[0]).manifest)
        merged = merge_campaign(
            here,
            out or Path("reports") / manifest.name,
            trust_code=trust_code,
            requirements=requirements,
        )
    finish(merged, no_report, json)
