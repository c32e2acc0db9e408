"""Commands ``import`` and ``validate`` for preparing a campaign."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.options import Json, Runs, output, output_file, output_folder
from abhv_mc.cli.printing import (
    announce_compiling,
    announce_warnings,
    new_table,
    print_table,
    say,
    show_result,
    text_stream,
)
from abhv_mc.io.messages import grouped_digits
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.execution.estimate import Estimate
    from abhv_mc.report.numbers.pass_chances import PassChance, Planned
    from abhv_mc.topics.topic import Records


imports = typer.Typer(
    name="import",
    help="Import flights computed by another simulator, or vehicle models in standard formats.",
    no_args_is_help=True,
)


def validate(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE...",
            help="Campaign, vehicle, mission or controller files, or names of shipped ones.",
        ),
    ],
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Run a few flights of each campaign, and print the time, disk space and number of "
            "flights that the campaign needs.",
        ),
    ] = False,
    runs: Runs = None,
    samples: Annotated[
        Path | None,
        typer.Option(
            "--samples",
            callback=output_file,
            metavar="FILE.csv",
            help="Write a table of the inputs of all flights, for use in another simulator.",
        ),
    ] = None,
    out: Annotated[
        Path | None, output(output_folder, "DIR", "Folder for the figure plan.png of --dry-run.")
    ] = None,
    json: Json = None,
) -> None:
    """Check input files and the files that they refer to, without running the campaign.

    With --dry-run, the cost of a campaign is estimated: time, disk space, the number of flights
    that each requirement needs, and the chance of PASS with the planned number. With --samples, a
    table is written with one row per flight that contains the flight number (from 0) and all
    inputs; the header gives the units. Pass this table to 'import flights' together with the
    results.
    """
    from abhv_mc.check_inputs import check_inputs
    from abhv_mc.io.messages import InputError, InputErrors

    announce_compiling()
    errors: list[InputError] = []
    paths = [find_input(file, "campaign", "vehicle", "mission", "control") for file in files]
    if (samples or out) and len(paths) != 1:
        raise InputError(
            "--samples" if samples else "--output", f"found {len(paths)} files", "only one campaign"
        )
    for file in paths:
        try:
            file_checks = check_inputs(file)
        except InputErrors as several:
            errors.extend(several.errors)
            continue
        for file_check in file_checks:
            say(f"{file_check.path}: a valid {file_check.kind} file", file=text_stream(json))
            announce_warnings(
                warning
                if warning.startswith(f"{file_check.path}:")
                else f"{file_check.path}: {warning}"
                for warning in file_check.warnings
            )
    if errors:
        raise InputErrors(errors)
    if samples is not None:
        from abhv_mc.campaign.file.check import read_campaign
        from abhv_mc.folder.flights import write_inputs

        flights = grouped_digits(write_inputs(read_campaign(paths[0], runs), samples))
        say(f"{samples}: inputs of {flights} flights", file=text_stream(json))
    if dry_run:
        _plan(paths, runs, out, json)
    elif json is not None:
        show_result({}, json, lambda: None)


def _plan(paths: list[Path], runs: int | None, out: Path | None, json: Path | None) -> None:
    """Print each campaign's cost and its chances of PASS."""
    from dataclasses import asdict

    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.campaign.file.unknowns import unknowns_hint
    from abhv_mc.execution.estimate import estimate_campaign
    from abhv_mc.report.numbers.pass_chances import plan_campaign

    estimates = {}
    for file in paths:
        if find_kind(file) == "campaign":
            checked = read_campaign(file, runs)
            announce_compiling()
            cost = estimate_campaign(checked)
            announce_warnings(cost.warnings)
            plan = plan_campaign(checked) if checked.model.requirements else None
            estimates[str(file)] = cost, plan, unknowns_hint(checked.names)

    def print_text() -> None:
        for file, (cost, plan, hint) in estimates.items():
            say(file)
            say(_records(cost, plan, hint), folds=False)
            if plan:
                _print_plan(plan)

    entries = {file: {**asdict(cost), "plan": plan} for file, (cost, plan, _) in estimates.items()}
    show_result(entries, json, print_text)
    printed = {warning for cost, *_ in estimates.values() for warning in cost.warnings}
    plans = [plan for _, plan, _ in estimates.values() if plan]
    announce_warnings(
        problem for plan in plans for problem in plan.problems if problem not in printed
    )
    if out is not None and plans:
        from abhv_mc.report.figures.searches import plot_planned
        from abhv_mc.topics.figure_style import write_png

        write_png(plot_planned(plans[0]), out / "plan.png")
        say(f"figure    {out / 'plan.png'}", file=text_stream(json))


def _records(cost: "Estimate", plan: "Planned | None", hint: str) -> "Records":
    """Return a campaign's cost, and the conditions of its verdicts, as records."""
    from abhv_mc.topics.formatting import percent
    from abhv_mc.topics.topic import make_records

    search = (
        f"{grouped_digits(cost.searched)} flights per {cost.kind} for the worst unknowns (fewer if "
        f"--runs is below 256), {cost.search_s:.0f} s"
    )
    histories = f"histories ({cost.kept}) {cost.histories_bytes / 1e6:.1f}"
    texts = [
        ("Flights", f"{grouped_digits(cost.flights)} per {cost.kind} ({cost.controllers})"),
        ("Search", search if cost.searched else ""),
        (
            "Time",
            f"{cost.flying_s:.0f} s, workers: {cost.workers} ({1e3 * cost.flight_s:.2f} ms per "
            f"flight and core, blocks of {cost.batch})",
        ),
        (
            "Disk",
            f"{cost.disk_bytes / 1e6:.1f} MB at most: flights table {cost.rows_bytes / 1e6:.1f}, "
            f"{histories}, envelopes during the run {cost.envelope_bytes / 1e6:.1f}",
        ),
        ("Unknowns", hint),
    ]
    if plan:
        points = f"at most {plan.most_points}, each with {grouped_digits(plan.runs)} flights; "
        points += f"the chances are those of one point; search: {plan.search_flights} flights"
        texts += [
            ("Points of the unknowns", points if plan.most_points > 1 else ""),
            ("Any false PASS", f"at most {percent(plan.family_risk, 2)}" * bool(plan.family_risk)),
            ("Sampling", "" if plan.independent_flights else "no verdicts; chances for 'random'"),
        ]
    return make_records(texts)


def _print_plan(planned: "Planned") -> None:
    from abhv_mc.topics.formatting import percent

    index = abs(planned.rates_over_allowed - 0.2).argmin()

    def both(chance: "PassChance") -> str:
        return f"{percent(chance.at_some_flight[index], 1)} ({percent(chance.at_runs[index], 1)})"

    chances = [f"PASS by {grouped_digits(entry.runs)} *" for entry in planned.together]
    title = f"{planned.name}: flights needed for PASS with 0 to 3 failures, and chance of PASS"
    table = new_table(("requirement",), ("0", "1", "2", "3", *chances), title)
    for entry in planned.requirements:
        table.add_row(
            f"{entry.words} in {percent(entry.probability)}",
            *map(grouped_digits, entry.flights_for_failures.values()),
            *map(both, entry.pass_chance),
        )
    print_table(table)
    say(
        "*  chance of PASS within this number of flights (in parentheses: at exactly this number) "
        "if the true failure probability is a fifth of the allowed probability"
    )
    if len(planned.requirements) > 1:
        low, high = (
            percent(end[index], 2) for end in vars(planned.together[0].at_some_flight).values()
        )
        say(f"All PASS by {grouped_digits(planned.runs)} *  {low} to {high}")
