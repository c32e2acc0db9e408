"""Commands ``replay`` and ``explain`` for single flights, and ``verify`` for results folders."""

from math import isnan
from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.errors import ExitCode
from abhv_mc.cli.options import (
    Controller,
    Folder,
    Json,
    TrustCode,
    metric_option,
    output,
    output_file,
)
from abhv_mc.cli.printing import announce_compiling, print_section_table, say, show_result
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError, quoted


def replay(
    folder: Folder,
    flight: Annotated[int, typer.Option(min=0, help="Number of the flight to re-run.")],
    controller: Controller = None,
    out: Annotated[
        Path | None,
        output(output_file, "FILE.parquet", "File for the time history at the full sampling rate."),
    ] = None,
    plot: Annotated[
        bool,
        typer.Option(
            "--plot", help="Plot the flight beside the nominal flight, also in the report of DIR."
        ),
    ] = False,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Re-run one flight and compare its metrics with the stored metrics, bit for bit.

    The exit code is 1 if any metric differs.
    """
    from abhv_mc.analysis.replay import EQUAL_BITS, replay_flight
    from abhv_mc.flights.repeatability import ROUNDING, Repeatability
    from abhv_mc.folder.histories import write_histories
    from abhv_mc.folder.inputs import read_folder_campaign

    if out is not None and out.suffix != ".parquet":
        problem = f"'{out.name}' is not a Parquet file"
        raise InputError("--output", problem, "a name that ends in .parquet, or --plot")
    controller = read_folder_campaign(CampaignFolder(folder)).choose_controller(controller)
    announce_compiling()
    replay = run_in_thread(lambda: replay_flight(folder, controller, flight, trust_code=trust_code))
    block = replay.block
    kept = CampaignFolder(folder).replayed / f"{controller}-{flight}.parquet"
    paths = [path for path in (out, kept if plot else None) if path is not None]
    if paths and not block.history.size:
        problem = "the flight has no time history"
        raise InputError("--output or --plot", problem, "the command without this option")
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_histories(
            path,
            controller,
            [flight],
            block.times,
            block.history,
            channels=[channel.name for channel in replay.channels],
            recorded=replay.channels,
        )
    if plot:
        from abhv_mc.folder.flown_campaign import read_flown
        from abhv_mc.topics.figure_style import write_png
        from abhv_mc.topics.flights.figures import draw_replayed
        from abhv_mc.topics.topic import names_of

        _, figure = draw_replayed(kept, names_of(read_flown(folder)))
        write_png(figure, kept.with_suffix(".png"))

    def print_text() -> None:
        end = replay.outcome + (
            "" if isnan(block.end_time[0]) else f" after {block.end_time[0]:g} s"
        )
        say(f"flight {flight} of controller '{controller}': {end}. {replay.sentence}")
        for name, value in replay.samples.items():
            say(f"  {name:<40} {value:.10g}")
        for name, value in replay.metrics.items():
            say(f"  {name:<40} {value:.6g}")
        if out is not None:
            say(f"history   {out}")
        if plot:
            say(f"figure    {kept.with_suffix('.png')}")
            say(f"panel     'abhv-mc report {folder}' adds the figure to the report")
        if replay.differences:
            say("metrics differ from the stored metrics:", *replay.differences, sep="\n  ")
        elif replay.repeatability is Repeatability.ROUNDING:
            say(f"metrics equal the stored metrics within a relative error of {ROUNDING:g}")
        else:
            say(f"metrics {EQUAL_BITS}")
        if replay.differences and replay.repeatability is not None:
            say(replay.repeatability.sentence)

    numbers = {"flight": flight, "controller": controller, "outcome": replay.outcome}
    numbers |= {
        "end_time_s": block.end_time[0],
        "samples": replay.samples,
        "metrics": replay.metrics,
    }
    show_result(numbers | {"differences": list(replay.differences)}, json, print_text)
    if replay.differences and replay.repeatability is not Repeatability.DECLARED:
        raise typer.Exit(ExitCode.FAILED)


def explain(
    folder: Folder,
    flight: Annotated[
        int | None, typer.Option(min=0, help="Number of the failed flight to explain.")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Explain all failed flights (at most 50 per controller).")
    ] = False,
    controller: Controller = None,
    requirement: Annotated[
        str | None,
        metric_option(
            "Metric of the requirement whose violation is explained.",
            show_default="the requirement that the flight missed",
        ),
    ] = None,
    out: Annotated[
        Path | None, output(output_file, "FILE.png", "File for the figure.", default="in DIR")
    ] = None,
    json: Json = None,
    trust_code: TrustCode = False,
) -> None:
    """Find the smallest set of dispersions that suffices to make a flight fail.

    All other dispersions are set to their nominal values. A flight failed if it terminated early
    or missed a requirement. With --all, the failed flights of every controller are grouped by their
    smallest sets, and 'abhv-mc report' shows the groups.
    """
    if every == (flight is not None) or (every and (requirement or out)):
        raise InputError(
            "--flight",
            "--all cannot be combined with --flight, --requirement or --output"
            if every
            else "no flight number is given",
            "either --flight NUMBER, or --all without these options",
        )
    announce_compiling()
    if flight is None:
        _map_all(folder, controller, json, trust_code)
        return
    from abhv_mc.analysis.explain import explain_flight
    from abhv_mc.folder.inputs import read_folder_campaign
    from abhv_mc.report.pages.single_flights import (
        explanation_numbers,
        explanation_records,
        make_explained_figure,
    )

    name = read_folder_campaign(CampaignFolder(folder)).choose_controller(controller)
    explanation = run_in_thread(
        lambda: explain_flight(folder, name, flight, requirement=requirement, trust_code=trust_code)
    )
    path = out or CampaignFolder(folder).explained / f"{name}-{flight}.png"
    numbers, has_history = explanation_numbers(explanation), explanation.block.history.size
    if has_history:
        from abhv_mc.topics.figure_style import write_png

        write_png(make_explained_figure(explanation), path)
        numbers["figure"] = str(path)

    def print_text() -> None:
        say(explanation_records(explanation), folds=False)
        if has_history:
            say(f"figure    {path}")

    show_result(numbers, json, print_text)


def _map_all(folder: Path, controller: str | None, json: Path | None, trust_code: bool) -> None:
    from abhv_mc.analysis.failure_map import map_failures, write_map
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.topics.failures import map_table
    from abhv_mc.topics.flights.model import rank_failed
    from abhv_mc.topics.topic import names_of

    results = read_flown(folder)
    names = results.controllers
    if controller is not None:
        names = (results.campaign.choose_controller(controller),)
    failed = {name: rank_failed(results, name) for name in names}
    if not any(failed.values()):
        say("No flight terminated early or missed a requirement.")
        return
    failure_map = map_failures(folder, failed, trust_code=trust_code)
    results.refuse_changes()
    path = write_map(folder, failure_map)
    table = map_table(failure_map.controllers, names_of(results))

    def print_text() -> None:
        print_section_table(table)
        say(f"map       {path} ('abhv-mc report {folder}' adds this map to the report)")

    show_result(failure_map.controllers, json, print_text)


verify = typer.Typer(
    name="verify",
    help="Check the files and numbers of a results folder.",
    no_args_is_help=True,
)


@verify.command("campaign")
def campaign(folder: Folder) -> None:
    """Check the hashes of all files of a campaign and all numbers of its report.

    The numbers are recomputed from the stored flights, which are not run again (use 'replay' to
    re-run a flight). The exit code is 1 if any difference is found.
    """
    from abhv_mc.folder.manifest import read_manifest
    from abhv_mc.folder.stores import open_store
    from abhv_mc.report.pages.build import search_command
    from abhv_mc.report.pages.verify import skipped_topics, verify_campaign

    with open_store(folder).reading() as source:
        for difference in verify_campaign(source):
            say(difference)
            raise typer.Exit(1)
        manifest = read_manifest(CampaignFolder(source).manifest)
        skipped = skipped_topics(source)
        has_report = (source / "report.json").is_file()
    if manifest.search:
        say(f"{folder}: all files are intact. To create the page of the search again, run:")
        say(search_command(folder, manifest))
        return
    if not has_report:
        say(f"{folder}: all files are intact. To create a report, run: abhv-mc report {folder}")
        return
    say(f"{folder}: all files are intact, and all numbers of the report follow from the flights")
    if skipped:
        say(f"topics not checked because their packages are not installed: {quoted(skipped)}")
