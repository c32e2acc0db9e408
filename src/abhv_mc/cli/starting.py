"""``new``, ``import``, ``validate``: what precedes the flights of a campaign."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.options import CampaignFile, Json, NewVehicle, Runs
from abhv_mc.cli.outputs import output, output_file, output_folder
from abhv_mc.cli.printing import (
    announce_compiling,
    announce_warnings,
    answer,
    beside,
    new_table,
    print_table,
    say,
)
from abhv_mc.io.input_error import InputError
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.execution.estimate import Estimate
    from abhv_mc.report.numbers.pass_chances import PassChance, Planned


def new(
    folder: Annotated[
        Path,
        typer.Argument(callback=output_folder, metavar="DIR", help="A new or an empty folder."),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from", metavar="NAME", help="Name of a shipped campaign, such as wide or failures."
        ),
    ] = "s_manoeuvre",
    law: Annotated[
        bool, typer.Option("--law", help="Add a commented control law of your own.")
    ] = False,
    language: Annotated[
        str | None,
        typer.Argument(
            metavar="[LANGUAGE]", help="Of the law: python or c.", show_default="python"
        ),
    ] = None,
    vehicle: NewVehicle = None,
    tune: Annotated[
        bool, typer.Option("--tune", help="Add a block of free numbers for 'abhv-mc tune'.")
    ] = False,
    simulator: Annotated[
        str | None,
        typer.Option(
            "--simulator",
            metavar="KIND",
            help="A simulator of your own instead: python or command.",
        ),
    ] = None,
) -> None:
    """Write a commented campaign with its vehicle, mission and control files to start from."""
    from abhv_mc.simulators.new_campaign import write_new_campaign

    if simulator is not None:
        if law or tune or vehicle is not None:
            raise InputError(
                "--simulator",
                "it beside --law, --vehicle or --tune",
                "one of both: those are of this program's vehicles",
            )
        _begin_simulator(folder, simulator)
        return
    if language is not None and not law:
        raise InputError(language, "a language without --law", "--law before it")
    chosen = (language or "python") if law else None
    campaign, *others = write_new_campaign(folder, source, chosen, vehicle=vehicle, tune=tune)
    say(f"{campaign} and {len(others)} files that it needs. Next:")
    if law:
        file = "my_law.c" if chosen == "c" else "my_law.py"
        say(
            f"  cd {folder} && abhv-mc fly level --controllers control/my_law.yaml   # after each edit of {file}"
        )
    if tune:
        command = f"abhv-mc tune {campaign.name} --controller tlc -o control/tlc_tuned.yaml"
        say(f"  cd {folder} && {command}")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")


def _begin_simulator(folder: Path, kind: str) -> None:
    from abhv_mc.simulators.new_campaign import write_new_simulator

    campaign, *others = write_new_simulator(folder, kind)
    names = [file.name for file in others if file.suffix != ".json"]
    say(f"{campaign} and {', '.join(names)}. Next:")
    if kind == "command" and "rocket" not in names:
        say(f"  cd {folder} && make   # no C compiler was found here: it needs one, by the name cc")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")


imports = typer.Typer(
    name="import",
    help="Import flights computed by another simulator, or other people's models.",
    no_args_is_help=True,
)


def validate(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE...", help="Campaign, vehicle, mission, controller; or a shipped name."
        ),
    ],
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Run a few flights of each campaign; say what all cost and what they can show.",
        ),
    ] = False,
    runs: Runs = None,
    samples: Annotated[
        Path | None,
        typer.Option(
            "--samples",
            callback=output_file,
            metavar="FILE.csv",
            help="Write the inputs of the campaign's flights, to run them elsewhere.",
        ),
    ] = None,
    out: Annotated[
        Path | None, output(output_folder, "DIR", "With --dry-run: write plan.png there.")
    ] = None,
    json: Json = None,
) -> None:
    """Check files, and the files that they name, without running flights.

    With --dry-run a campaign is also planned: time and disk, how many flights each requirement takes, and how likely
    it is to PASS at the planned number. --samples writes a row a flight: its number from 0, and each input with its
    unit in the head; pass it to 'import flights' together with the results.
    """
    from abhv_mc.io.documents import InputError, InputErrors
    from abhv_mc.simulators.check_inputs import check_inputs

    announce_compiling()
    errors: list[InputError] = []
    paths = [find_input(file, "campaign", "vehicle", "mission", "control") for file in files]
    if (samples or out) and len(paths) != 1:
        raise InputError(
            "--samples" if samples else "--output", f"{len(paths)} files", "one campaign"
        )
    for file in paths:
        try:
            checked = check_inputs(file)
        except InputErrors as several:
            errors.extend(several.errors)
            continue
        for found in checked:
            say(f"{found.path}: a valid {found.kind} file", file=beside(json))
            announce_warnings(f"{found.path}: {warning}" for warning in found.warnings)
    if errors:
        raise InputErrors(errors)
    if samples is not None:
        say(_write_samples(paths[0], runs, samples), file=beside(json))
    if dry_run:
        _plan(paths, runs, out, json)
    elif json is not None:
        answer({}, json, lambda: None)


def samples(
    campaign: CampaignFile,
    out: Annotated[Path, output(output_file, "FILE.csv", "Where to.")],
    runs: Runs = None,
) -> None:
    """Write the inputs of a campaign's flights, to run them elsewhere, as 'validate --samples' does."""
    say(_write_samples(campaign, runs, out))


def _write_samples(campaign: Path, runs: int | None, out: Path) -> str:
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.folder.input_table import write_inputs

    flights = write_inputs(read_campaign(campaign, runs), out)
    return f"{out}: the inputs of {flights} flights"


def _plan(paths: list[Path], runs: int | None, out: Path | None, json: Path | None) -> None:
    """Print what each campaign costs and can show."""
    from dataclasses import asdict

    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.campaign.file.unknowns import unknowns_hint
    from abhv_mc.execution.estimate import estimate_campaign
    from abhv_mc.report.numbers.pass_chances import plan_campaign

    plans: dict[str, Planned | None] = {}
    hints: dict[str, str] = {}
    costs: dict[str, Estimate] = {}
    for file in paths:
        if find_kind(file) != "campaign":
            continue
        checked = read_campaign(file, runs)
        announce_compiling()
        cost = estimate_campaign(checked)
        announce_warnings(cost.warnings)
        costs[str(file)] = cost
        plans[str(file)] = plan_campaign(checked) if checked.model.requirements else None
        hints[str(file)] = unknowns_hint(checked.names)

    def in_words() -> None:
        for file, cost in costs.items():
            _print_cost(file, cost)
            if planned := plans[file]:
                _print_plan(planned)
            say(*filter(None, [hints[file]]), sep="\n", end="\n" * bool(hints[file]))

    entries = {file: {**asdict(cost), "plan": plans[file]} for file, cost in costs.items()}
    answer(entries, json, in_words)
    told = {words for cost in costs.values() for words in cost.warnings}
    problems = (words for planned in plans.values() if planned for words in planned.problems)
    announce_warnings(words for words in problems if words not in told)
    drawn = next((planned for planned in plans.values() if planned), None)
    if out is not None and drawn is not None:
        from abhv_mc.report.figures.searches import plot_planned
        from abhv_mc.topics.figure_style import write_png

        write_png(plot_planned(drawn), out / "plan.png")
        say(f"figure    {out / 'plan.png'}", file=beside(json))


def _print_cost(file: str, cost: "Estimate") -> None:
    say(
        f"{file}: {cost.flights} flights of {cost.controllers} {cost.kind}s, blocks of {cost.batch}"
    )
    if cost.searched:
        say(
            f"  search  {cost.searched} flights of each for the unknowns' worst values, {cost.search_s:.0f} s"
            " (fewer if --runs is below 256)"
        )
    each = f"{1e3 * cost.flight_s:.2f} ms a flight and core"
    say(f"  time    {cost.flying_s:.0f} s with {cost.workers} workers ({each})")
    kept, flying = (
        f"{cost.kept} histories {cost.histories_bytes / 1e6:.1f}",
        f"{cost.envelope_bytes / 1e6:.1f}",
    )
    say(f"  disk    {cost.disk_bytes / 1e6:.1f} MB at most", end="")
    say(f" (rows {cost.rows_bytes / 1e6:.1f}, {kept}, envelopes while flying {flying})")


def _print_plan(planned: "Planned") -> None:
    from abhv_mc.topics.formatting import percent

    share = 0.2
    place = min(
        range(len(planned.rates_over_allowed)),
        key=lambda k: abs(planned.rates_over_allowed[k] - share),
    )

    def both(chance: "PassChance") -> str:
        return f"{percent(chance.at_some_flight[place], 2)}\n({percent(chance.at_runs[place], 2)})"

    chances = [f"PASS by\n{entry.runs} *" for entry in planned.together]
    title = f"{planned.name}: flights needed for PASS with 0 to 3 failures, and its chance"
    table = new_table(("requirement",), ("0", "1", "2", "3", *chances), title)
    for entry in planned.requirements:
        table.add_row(
            f"{entry.words} in {percent(entry.probability)}",
            *map(str, entry.flights_for_failures.values()),
            *map(both, entry.pass_chance),
        )
    print_table(table)
    say(
        "*  chance where a fifth of the allowed failures is true: at some flight (and at that number itself)"
    )
    if len(planned.requirements) > 1:
        low, high = (
            percent(end[place], 2) for end in vars(planned.together[0].at_some_flight).values()
        )
        say(
            f"All of them PASS at some flight up to {planned.runs} with a chance between {low} and {high} then."
        )
    if planned.most_points > 1:
        say(f"Each controller flies {planned.runs} flights at each of at most {planned.most_points} values of the "
            f"unknowns: {planned.runs * planned.most_points} flights; {planned.search_flights} of all controllers "
            "before that search the worst values. All of the chances are those of one value.")  # fmt: skip
    if planned.family_risk:
        say(f"The chance of any false PASS among all {planned.verdicts} verdicts is at most "
            f"{percent(planned.family_risk, 2)}.")  # fmt: skip
    if not planned.independent_flights:
        say(
            "Its flights are not independent draws: it gets estimates and no verdict. These numbers are for random."
        )
