"""Commands ``margins`` and ``linearize``: stability margins and linear models."""

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import (
    Json,
    TrustCode,
    controller_option,
    output,
    output_file,
    output_folder,
    parse_names,
    parse_option,
)
from abhv_mc.cli.printing import (
    announce_warnings,
    new_table,
    print_table,
    say,
    show_result,
)
from abhv_mc.io.messages import InputError, check_names
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input
from abhv_mc_vehicle.cli.options import (
    ControllerFiles,
    MissionOrCampaign,
    Vehicle,
    announce_compiling,
    find_controllers,
)

if TYPE_CHECKING:
    from abhv_mc_vehicle.one_flight.linear_models import Place
    from abhv_mc_vehicle.stability.analysis import Stability, Time

Bank = Annotated[
    str, typer.Option(help="Bank angle of the trimmed steady turn, in deg or with a unit.")
]
_LISTED = 6  # number of dispersions printed with each smallest margin
_COLUMNS = (
    ("gain_margin_low_db", "gain down\ndB", 2),
    ("gain_margin_high_db", "gain up\ndB", 2),
    ("phase_margin_deg", "phase\ndeg", 1),
    ("delay_margin_ms", "delay\nms", 1),
    ("sensitivity_peak", "sensitivity\npeak", 2),
    ("crossover_rad_s", "crossover\nrad/s", 2),
)


def margins(
    mission: MissionOrCampaign,
    vehicle: Vehicle = None,
    controllers: ControllerFiles = None,
    instants: Annotated[
        str,
        typer.Option(
            "--at",
            metavar="POINTS",
            help="Operating points: trim, or times of the nominal flight such as 0s,30s,48s.",
        ),
    ] = "trim",
    bank: Bank = "0",
    hold: Annotated[
        str | None,
        typer.Option(
            metavar="STATES",
            help="Quantities (altitude, speed, heading; separated by commas) that are held "
            "constant if the controller does not control them.",
        ),
    ] = None,
    json: Json = None,
    out: Annotated[
        Path | None, output(output_folder, "DIR", "Folder for Bode and Nichols figures.")
    ] = None,
    worst: Annotated[
        bool,
        typer.Option(
            "--worst",
            help="Search the dispersions of a campaign for the smallest margins at trim.",
        ),
    ] = False,
    trust_code: TrustCode = False,
) -> None:
    """Print the gain, phase and delay margins of each loop, and the disk margin of all loops.

    Each loop is broken at its actuator while all other loops are closed; the disk margin is for
    simultaneous perturbations of all loops. Margins at a time of the flight are computed with a
    frozen reference and are only indicative. With --worst, a search looks for the smallest margins
    within the dispersions; margins smaller than those found may exist.
    """
    if worst:
        if vehicle is not None or instants != "trim" or bank != "0" or hold or out is not None:
            raise InputError(
                "--worst",
                "the option cannot be combined with --vehicle, --at, --bank, --hold or --output",
                "a campaign without these options",
            )
        _show_worst(mission, controllers, json, trust_code)
        return
    from abhv_mc_vehicle.one_flight.linear_models import analyse_place
    from abhv_mc_vehicle.stability.analysis import make_rows

    times = _read_times(instants)
    vehicle_file, mission_file, files = _find_flown(vehicle, mission, controllers, trust_code)
    rows: list[dict[str, Any]] = []
    tables: list[tuple[str, list[dict[str, Any]], Stability]] = []
    figures: list[Path] = []
    notes: list[str] = []
    for (name, file), time in product(files.items(), times):
        linear, stability, hold_notes = analyse_place(
            _take(mission_file, vehicle_file, file, time, bank, times),
            parse_names(hold, "--hold") or (),
        )
        notes += hold_notes
        table_rows = make_rows(name, None if time == "trim" else time, stability)
        description = "at the trim point" if time == "trim" else f"at {time:g} s, reference frozen"
        title = f"{name}, {vehicle_file.stem}, {mission_file.stem}, {description}"
        tables.append((title, table_rows, stability))
        rows += table_rows
        if out is not None:
            from abhv_mc_vehicle.cli.loops import write_loop_figures

            figures += write_loop_figures(
                out, f"{name}_{time if time == 'trim' else f'{time:g}s'}", linear
            )

    def print_text() -> None:
        for table in tables:
            _print_rows(*table)
        announce_warnings(notes)
        say(*figures, sep="\n", end="\n" * bool(figures))

    result = {"vehicle": vehicle_file.stem, "mission": mission_file.stem, "rows": rows}
    show_result(result | ({"notes": notes} if notes else {}), json, print_text)


def _show_worst(file: Path, controllers: str | None, json: Path | None, trust_code: bool) -> None:
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.search.worst import MARGIN_EVALUATIONS, find_worst_margins
    from abhv_mc.topics.formatting import shown_value, spoken_name
    from abhv_mc_vehicle.flight.metrics import BUILT_IN

    _, _, files = _find_flown(None, file, controllers, trust_code)
    campaign = read_campaign(file)
    results = find_worst_margins(campaign, tuple(files))
    parameters = campaign.parameters

    def print_text() -> None:
        table = new_table(("controller", "margin"), ("nominal", "smallest found"), None)
        table.add_column("at")
        for result in results:
            metric = BUILT_IN[result.metric]
            settings = [
                f"{spoken_name(name)} {shown_value(name, result.parameters[name], parameters)}"
                for name in result.moved
            ]
            further = [f"and {len(settings) - _LISTED} more"] if len(settings) > _LISTED else []
            location = ", ".join(settings[:_LISTED] + further) or "the nominal vehicle"
            values = (
                f"{value:.3g} {metric.unit}".removesuffix(" -")
                for value in (result.nominal, result.found)
            )
            table.add_row(
                result.controller,
                metric.label,
                *values,
                f"{result.fault}: {location}" if result.fault else location,
            )
        print_table(table)
        say(
            "Each margin is the smallest that linear analysis at the trim point found at "
            f"{MARGIN_EVALUATIONS} points of the dispersions; the true minimum may be smaller."
        )

    show_result({"rows": results}, json, print_text)


MOST_TIMES = 10_000  # maximum number of times in the option --at


def _read_times(text: str) -> "list[Time]":
    """Return the operating points of the option --at: times in s, or "trim".

    Times may have the form first:last:step. Raise InputError if the option is invalid.
    """
    from abhv_mc.io.units import TIME

    times: list[Time] = []
    for item in text.split(","):
        if item.strip() == "trim":
            times.append("trim")
            continue
        numbers = [parse_option("--at", number, TIME, "s") for number in item.split(":")]
        first, last, step = (
            (*numbers, 0.0)[:3] if len(numbers) > 1 else (numbers[0], numbers[0], 1.0)
        )
        if len(numbers) > 3 or step <= 0.0 or last < first or last - first > MOST_TIMES * step:
            raise InputError(
                "--at",
                f"invalid times '{item}'",
                f"at most {MOST_TIMES} ascending times such as 0s:60s:1s",
            )
        times += [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]
    return times


def _take(
    mission: Path, vehicle: Path, controller: Path, time: "Time", bank: str, times: "list[Time]"
) -> "Place":
    """Return an operating point of the nominal flight, and print warnings about it.

    The option --bank applies only to the trim point. At a time of the nominal flight, the flight
    itself determines the bank angle.
    """
    from abhv_mc.io.units import ANGLE
    from abhv_mc_vehicle.one_flight.linear_models import take_point

    angle = parse_option("--bank", bank, ANGLE, "deg")
    turn = angle if time == "trim" or "trim" not in times else 0.0
    operating_point = take_point(mission, vehicle, controller, time, turn)
    announce_warnings(operating_point.warnings)
    return operating_point


def _find_flown(
    vehicle: Path | None, mission: Path, controllers: str | None, trust_code: bool
) -> tuple[Path, Path, dict[str, Path]]:
    """Return the vehicle, mission and controller files; ``mission`` may be a campaign file.

    Raise InputError if a custom control law is not trusted.
    """
    from abhv_mc.campaign.file.experiment import check_user_code
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc_vehicle.control.controller_file import read_controller
    from abhv_mc_vehicle.vehicle_simulator.stored_plans import check_user_law

    if find_kind(mission) == "campaign":
        from abhv_mc.campaign.file.check import read_campaign

        campaign = read_campaign(mission)
        campaign.simulator.check("linearization")
        check_user_code(campaign, trust_code)
        model = campaign.model
        controller_files = {name: Path(file) for name, file in model.controllers.items()}
        names = parse_names(controllers) or controller_files
        check_names("--controllers", names, controller_files, "controller")
        files = {name: controller_files[name] for name in names}
        vehicle = vehicle or Path(model.vehicle)
        mission = Path(model.mission)
    else:
        files = find_controllers(controllers)
    for file in files.values():
        check_user_law(read_controller(file), trust_code)
    announce_compiling()
    return vehicle or find_input(DEFAULT_VEHICLE, "vehicle"), mission, files


def _print_rows(title: str, rows: list[dict[str, Any]], stability: "Stability") -> None:
    from abhv_mc.topics.margins import loop_name
    from abhv_mc_vehicle.stability.analysis import NO_SLOPES

    if not stability.poles[0].size:
        say(f"{title}: no margins ({NO_SLOPES})")
        return
    poles = [pole for pole in stability.poles[0] if pole.imag >= 0.0]
    if not rows[0]["stable"]:
        growing = ", ".join(
            f"{p.real:+.3f}{f' +- {p.imag:.2f}j' if p.imag else ''}" for p in poles if p.real >= 0.0
        )
        say(
            f"{title}: the closed loop is unstable and has no margins; unstable poles: "
            f"{growing} 1/s"
        )
        return
    table = new_table(
        ("loop",), (heading for _, heading, _ in _COLUMNS), title, padding=(0, 1, 0, 0)
    )
    for row in rows[:-1]:
        none = row.get("reason", "none")
        values = (
            f"{row[key]:.{digits}f}" if row[key] is not None else none
            for key, _, digits in _COLUMNS
        )
        table.add_row(loop_name(row["loop"]), *values)
    print_table(table)
    everything = rows[-1]
    gain = "any" if everything["disk_gain_db"] is None else f"{everything['disk_gain_db']:.2f} dB"
    delay = (
        "any"
        if everything["delay_margin_ms"] is None
        else f"{everything['delay_margin_ms']:.1f} ms"
    )
    say(
        f"all loops simultaneously: disk margin {everything['disk_margin']:.4f} (gain +-{gain} or "
        f"phase {everything['disk_phase_deg']:.1f} deg in each loop), delay margin {delay}"
    )
    damped = min(
        (p for p in poles if p.imag > 0.0), key=lambda p: abs(p.real) / abs(p), default=None
    )
    if damped is not None:
        say(f"least damped pole {damped.real:.3f} +- {damped.imag:.2f}j 1/s")


def linearize(
    mission: MissionOrCampaign,
    out: Annotated[
        Path | None,
        output(output_file, "FILE", "File for the model: .npz, .mat or .json.", default=False),
    ] = None,
    vehicle: Vehicle = None,
    controller: Annotated[str, controller_option("Controller to linearize: file or name.")] = "tlc",
    instants: Annotated[
        str,
        typer.Option(
            "--at",
            metavar="POINT",
            help="Operating point: trim, a time of the nominal flight such as 30s, or a range of "
            "times such as 0s:60s:1s.",
        ),
    ] = "trim",
    bank: Bank = "0",
    gains: Annotated[
        Path | None,
        typer.Option(
            "--gains",
            callback=output_file,
            metavar="FILE",
            help="Output file (.mat, .csv or .h) for the controller's gains as functions of time.",
        ),
    ] = None,
    trust_code: TrustCode = False,
) -> None:
    """Write linear models of the plant, controller, open loop and closed loop, or the gains.

    The models use path coordinates, second-order actuators and an exact zero-order hold. The file
    contains the names and units of states, inputs and outputs. For several times
    (first:last:step), each matrix is an array [time, row, column], and the file contains the array
    time_s.
    """
    from abhv_mc_vehicle.stability.linearize import linearize
    from abhv_mc_vehicle.stability.model_file import (
        check_format,
        make_model,
        stack_models,
        write_model,
    )

    if out is not None:
        check_format(out)
    times = _read_times(instants)
    if len(times) > 1 and "trim" in times:
        raise InputError(
            "--at",
            f"'{instants}' combines trim with other operating points",
            "one operating point, or times such as 0s:60s:1s",
        )
    vehicle_file, mission_file, files = _find_flown(vehicle, mission, controller, trust_code)
    if len(files) > 1:
        raise InputError("--controller", "found " + ", ".join(files), "only one controller")
    (file,) = files.values()
    if gains is not None:
        from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
        from abhv_mc_vehicle.vehicle_simulator.export_gains import check_gain_format, write_gains

        check_gain_format(gains)
        write_gains(gains, make_flight_plan(mission_file, vehicle_file, file))
        say(gains)
        if out is None:
            return
    if out is None:
        raise InputError(
            "--output", "no output file is given", "-o FILE (.npz, .mat or .json) or --gains FILE"
        )
    models = []
    for time in times:
        plan, points, _ = _take(mission_file, vehicle_file, file, time, bank, times)
        models.append(make_model(plan, points, linearize(plan, points)))
    write_model(
        out,
        stack_models(models, [t for t in times if t != "trim"]) if len(models) > 1 else models[0],
    )
    say(out)
