"""``abhv-mc plan``: what a campaign can show, before it flies."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from abhv_mc.cli.options import CampaignFile, Json, Runs
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import beside, new_table, print_table, say, show

if TYPE_CHECKING:
    from abhv_mc.report.numbers.planned import PassChance, Planned


def command(
    campaign: CampaignFile,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write the figure plan.png there.")] = None,
    runs: Runs = None,
    json: Json = None,
) -> None:
    """Say how many flights each requirement needs, and how likely it is to PASS at the planned number."""
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.cli.announce import announce_warnings
    from abhv_mc.report.numbers.planned import plan_campaign

    checked = read_campaign(campaign, runs)
    if not checked.model.requirements:
        raise checked.document.error((), "a campaign without requirements", "requirements that can PASS or FAIL")
    planned = plan_campaign(checked)
    show(planned, json, lambda: _print(planned))
    announce_warnings(planned.problems)
    if out is not None:
        from abhv_mc.report.figures.planned import plot_planned
        from abhv_mc.topics.figure_style import write_png

        write_png(plot_planned(planned), out / "plan.png")
        say(f"figure    {out / 'plan.png'}", file=beside(json))


def _print(planned: "Planned") -> None:
    from abhv_mc.topics.words import percent

    share = 0.2
    place = min(range(len(planned.rates_over_allowed)), key=lambda k: abs(planned.rates_over_allowed[k] - share))

    def both(chance: "PassChance") -> str:
        return f"{percent(chance.at_some_flight[place], 2)} ({percent(chance.at_runs[place], 2)})"

    chances = [f"by {entry.runs}: PASS *" for entry in planned.together]
    heads = ("0 failures", "1", "2", "3", *chances)
    table = new_table(("requirement",), heads, f"{planned.name}: flights needed for PASS")
    for entry in planned.requirements:
        table.add_row(
            f"{entry.words} in {percent(entry.probability)}",
            *map(str, entry.flights_for_failures.values()),
            *map(both, entry.pass_chance),
        )
    print_table(table)
    say("*  chance where a fifth of the allowed failures is true: at some flight (and at that number itself)")
    if len(planned.requirements) > 1:
        low, high = (percent(end[place], 2) for end in vars(planned.together[0].at_some_flight).values())
        say(f"All of them PASS at some flight up to {planned.runs} with a chance between {low} and {high} then.")
    if planned.most_points > 1:
        say(f"Each controller flies {planned.runs} flights at each of at most {planned.most_points} values of the "
            f"unknowns: {planned.runs * planned.most_points} flights; {planned.search_flights} of all controllers "
            "before that search the worst values. All of the chances are those of one value.")  # fmt: skip
    if planned.family_risk:
        say(f"The chance of any false PASS among all {planned.verdicts} verdicts is at most "
            f"{percent(planned.family_risk, 2)}.")  # fmt: skip
    if not planned.independent_flights:
        say("Its flights are not independent draws: it gets estimates and no verdict. These numbers are for random.")
