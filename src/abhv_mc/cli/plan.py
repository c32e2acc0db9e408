"""``abhv-mc plan``: what a campaign can show, before it flies."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.options import CampaignFile, Json, Runs
from abhv_mc.cli.outputs import output_folder
from abhv_mc.cli.printing import say, show


def command(
    campaign: CampaignFile,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", callback=output_folder, metavar="DIR", help="Write the figure plan.png there."),
    ] = None,
    runs: Runs = None,
    json: Json = None,
) -> None:
    """Say how many flights each requirement needs, and how likely it is to PASS at the planned number."""
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.cli.announce import announce_warnings
    from abhv_mc.report.pages.planned import plan_numbers, write_plan_figure

    checked = read_campaign(campaign, runs)
    if not checked.model.requirements:
        raise checked.document.error((), "a campaign without requirements", "requirements that can PASS or FAIL")
    numbers = plan_numbers(checked)
    show(numbers, json, lambda: _print(numbers))
    announce_warnings(numbers["problems"])
    if out is not None:
        write_plan_figure(numbers, out / "plan.png")
        say(f"figure    {out / 'plan.png'}", file=sys.stderr if json == Path("-") else None)


def _print(numbers: dict[str, Any]) -> None:
    from abhv_mc.cli.printing import new_table, print_table
    from abhv_mc.report.numbers.words import percent, significant

    share = 0.2
    each = "chance of PASS *", "of a false one **"
    heads = ("0 failures", "1", "2", "3", f"all {numbers['runs']} flights: PASS with at most", *each,
             "stopping when proven: flights *", *each)  # fmt: skip
    table = new_table(("requirement",), heads, f"{numbers['name']}: flights needed for PASS")
    place = min(range(len(numbers["rates_over_allowed"])), key=lambda k: abs(numbers["rates_over_allowed"][k] - share))
    for entry in numbers["requirements"]:
        most, stops = entry["most_failures_at_runs"], entry["stop_when_proven"]
        table.add_row(
            f"{entry['words']} in {percent(entry['probability'])}",
            *map(str, entry["flights_for_failures"].values()),
            "never" if most < 0 else f"{most} failures",
            percent(entry["pass_chance"][place], 2),
            percent(entry["false_pass"]),
            significant(stops["expected_flights"][place], 3),
            percent(stops["pass_chance"][place], 2),
            percent(stops["false_pass"]),
        )
    print_table(table)
    say("*  where a fifth of the allowed failures is true    ** where just more than allowed is true: exact")
    if len(numbers["requirements"]) > 1:
        both = numbers["together"]["stop_when_proven" if numbers["stops_when_proven"] else "fixed"]
        low, high = (percent(both[end][place], 2) for end in ("low", "high"))
        say(f"All of them PASS with a chance between {low} and {high} at a fifth of the allowed failures each.")
    if numbers["expected_false_passes"] < 1.0 or numbers["family_risk"]:
        say(f"The chance of any false PASS is at most {percent(numbers['any_false_pass'], 2)}.")
    else:
        say(f"Were each just missed, up to {significant(numbers['expected_false_passes'], 2)} of the "
            f"{numbers['verdicts']} verdicts would PASS on average.")  # fmt: skip
    if not numbers["independent_flights"]:
        say("Its flights are not independent draws: it gets estimates and no verdict. These numbers are for random.")
