"""``margins``, ``linearize``: stability margins and linear models."""

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import (
    ControllerFiles,
    Json,
    MissionOrCampaign,
    TrustCode,
    Vehicle,
    controller_option,
    find_controllers,
    parse_names,
    parse_option,
)
from abhv_mc.cli.outputs import output, output_file, output_folder
from abhv_mc.cli.printing import (
    announce_compiling,
    announce_warnings,
    answer,
    new_table,
    print_table,
    say,
)
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

if TYPE_CHECKING:
    from abhv_mc.one_flight.linear_models import Place
    from abhv_mc.stability.analysis import Stability, Time

_NAMED = 6  # dispersions of a worst margin
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
    at: Annotated[
        str,
        typer.Option(
            metavar="POINTS", help="trim, or times of the nominal flight such as 0s,30s,48s."
        ),
    ] = "trim",
    bank: Annotated[
        str, typer.Option(help="Bank of the steady turn to trim for, deg or with a unit.")
    ] = "0",
    hold: Annotated[
        str | None,
        typer.Option(
            metavar="STATES",
            help="Hold altitude, speed or heading, separated by commas: for a controller that leaves them open.",
        ),
    ] = None,
    json: Json = None,
    out: Annotated[
        Path | None, output(output_folder, "DIR", "Write Bode and Nichols figures here.")
    ] = None,
    worst: Annotated[
        bool,
        typer.Option(
            "--worst", help="Search the box of a campaign's dispersions for the least margins."
        ),
    ] = False,
    trust_code: TrustCode = False,
) -> None:
    """Print gain, phase and delay margins of each loop (broken at its actuator, the others closed) and of all at once.

    At a time of the flight the reference is frozen: such margins are indicative. With --worst, the least margins at the
    trim that a search over a campaign's dispersions finds: what is found, never what is proved.
    """
    if worst:
        if vehicle is not None or at != "trim" or bank != "0" or hold or out is not None:
            raise InputError(
                "--worst", "with --vehicle, --at, --bank, --hold or --output", "a campaign alone"
            )
        _show_worst(mission, controllers, json, trust_code)
        return
    from abhv_mc.one_flight.linear_models import analyse_place
    from abhv_mc.stability.analysis import make_rows

    times = _read_times(at)
    craft, flight, files = _find_flown(vehicle, mission, controllers, trust_code)
    rows: list[dict[str, Any]] = []
    shown: list[tuple[str, list[dict[str, Any]], Stability]] = []
    figures: list[Path] = []
    notes: list[str] = []
    for (name, file), time in product(files.items(), times):
        place = _take(flight, craft, file, time, bank, times)
        linear, stability, found = analyse_place(place, parse_names(hold, "--hold") or ())
        notes += found
        here = make_rows(name, None if time == "trim" else time, stability)
        words = "at the trim" if time == "trim" else f"at {time:g} s, reference frozen"
        shown.append((f"{name}, {craft.stem}, {flight.stem}, {words}", here, stability))
        rows += here
        if out is not None:
            from abhv_mc.report.figures.loops import write_loop_figures

            figures += write_loop_figures(
                out, f"{name}_{time if time == 'trim' else f'{time:g}s'}", linear
            )

    def in_words() -> None:
        for part in shown:
            _print_rows(*part)
        announce_warnings(notes)
        say(*figures, sep="\n", end="\n" * bool(figures))

    described = {"vehicle": craft.stem, "mission": flight.stem, "rows": rows}
    answer(described | ({"notes": notes} if notes else {}), json, in_words)


def _show_worst(file: Path, controllers: str | None, json: Path | None, trust_code: bool) -> None:
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.flight.metrics import BUILT_IN
    from abhv_mc.search.worst import MARGIN_EVALUATIONS, find_worst_margins
    from abhv_mc.topics.words import shown_value, spoken_name

    _, _, files = _find_flown(None, file, controllers, trust_code)
    campaign = read_campaign(file)
    found, known = find_worst_margins(campaign, tuple(files)), campaign.parameters

    def in_words() -> None:
        table = new_table(("controller", "margin"), ("nominal", "least found"), None)
        table.add_column("at")
        for one in found:
            metric = BUILT_IN[one.metric]
            at = [
                f"{spoken_name(name)} {shown_value(name, one.parameters[name], known)}"
                for name in one.moved
            ]
            more = [f"and {len(at) - _NAMED} more"] if len(at) > _NAMED else []
            where = ", ".join(at[:_NAMED] + more) or "the nominal vehicle"
            values = (
                f"{value:.3g} {metric.unit}".removesuffix(" -")
                for value in (one.nominal, one.found)
            )
            table.add_row(
                one.controller,
                metric.label,
                *values,
                f"{one.fault}: {where}" if one.fault else where,
            )
        print_table(table)
        points = f"{MARGIN_EVALUATIONS} points a margin"
        say(f"Found by the linear analysis at the trim, {points}: the true least is no greater.")

    answer({"rows": found}, json, in_words)


MOST_TIMES = 10_000


def _read_times(at: str) -> "list[Time]":
    """Times (s, or the trim) of the option, first:last:step among them. Raises InputError."""
    from abhv_mc.io.units import TIME

    times: list[Time] = []
    for each in at.split(","):
        if each.strip() == "trim":
            times.append("trim")
            continue
        parts = [parse_option("--at", part, TIME, "s") for part in each.split(":")]
        first, last, step = (*parts, 0.0)[:3] if len(parts) > 1 else (parts[0], parts[0], 1.0)
        if len(parts) > 3 or step <= 0.0 or last < first or last - first > MOST_TIMES * step:
            raise InputError(
                "--at", f"'{each}'", f"at most {MOST_TIMES} rising times such as 0s:60s:1s"
            )
        times += [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]
    return times


def _take(
    mission: Path, vehicle: Path, controller: Path, time: "Time", bank: str, times: "list[Time]"
) -> "Place":
    """The point of the nominal flight; a warning where it is doubtful. A bank belongs to the trim alone."""
    from abhv_mc.io.units import ANGLE
    from abhv_mc.one_flight.linear_models import take_point

    angle = parse_option("--bank", bank, ANGLE, "deg")
    turn = angle if time == "trim" or "trim" not in times else 0.0
    place = take_point(mission, vehicle, controller, time, turn)
    announce_warnings(place.warnings)
    return place


def _find_flown(
    vehicle: Path | None, mission: Path, controllers: str | None, trust_code: bool
) -> tuple[Path, Path, dict[str, Path]]:
    """Vehicle, mission and controllers, user laws among them trusted; ``mission`` may be a campaign's file."""
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.control.controller_file import read_controller
    from abhv_mc.simulators.campaign_code import check_user_code, check_user_law

    if find_kind(mission) == "campaign":
        from abhv_mc.campaign.file.check import read_campaign

        campaign = read_campaign(mission)
        campaign.simulator.check("linearization")
        check_user_code(campaign, trust_code)
        model = campaign.model
        known = {name: Path(file) for name, file in model.controllers.items()}
        for name in parse_names(controllers) or ():
            if name not in known:
                raise InputError("--controllers", f"'{name}'", one_of(known, name))
        files = {name: known[name] for name in parse_names(controllers) or known}
        vehicle, mission = vehicle or Path(model.vehicle), Path(model.mission)
    else:
        files = find_controllers(controllers)
    for file in files.values():
        check_user_law(read_controller(file), trust_code)
    announce_compiling()
    return vehicle or find_input(DEFAULT_VEHICLE, "vehicle"), mission, files


def _print_rows(title: str, rows: list[dict[str, Any]], stability: "Stability") -> None:
    from abhv_mc.stability.analysis import NO_SLOPES
    from abhv_mc.topics.margins.model import loop_name

    if not stability.poles[0].size:
        say(f"{title}: no margins: {NO_SLOPES}")
        return
    poles = [pole for pole in stability.poles[0] if pole.imag >= 0.0]
    if not rows[0]["stable"]:
        growing = ", ".join(
            f"{p.real:+.3f}{f' +- {p.imag:.2f}j' if p.imag else ''}" for p in poles if p.real >= 0.0
        )
        say(f"{title}: unstable, no margins; poles {growing} per second")
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
        f"all loops at once: disk margin {everything['disk_margin']:.4f} (gain {gain} up and down or phase "
        f"{everything['disk_phase_deg']:.1f} deg in each at the same time), the same delay in all {delay}"
    )
    damped = min(
        (p for p in poles if p.imag > 0.0), key=lambda p: abs(p.real) / abs(p), default=None
    )
    if damped is not None:
        say(f"least damped pole {damped.real:.3f} +- {damped.imag:.2f}j per second")


def linearize(
    mission: MissionOrCampaign,
    out: Annotated[
        Path | None,
        output(output_file, "FILE", "Required; ends in .npz, .mat or .json.", default=False),
    ] = None,
    vehicle: Vehicle = None,
    controller: Annotated[str, controller_option("Controller file or shipped name.")] = "tlc",
    at: Annotated[
        str,
        typer.Option(
            metavar="POINT", help="trim, a time of the nominal flight such as 30s, or 0s:60s:1s."
        ),
    ] = "trim",
    bank: Annotated[
        str, typer.Option(help="Bank of the steady turn to trim for, deg or with a unit.")
    ] = "0",
    gains: Annotated[
        Path | None,
        typer.Option(
            "--gains",
            callback=output_file,
            metavar="FILE",
            help="Write the controller's gains over time; ends in .mat, .csv or .h.",
        ),
    ] = None,
    trust_code: TrustCode = False,
) -> None:
    """Write plant, law, open and closed loop about the trim or a time of the nominal flight; or a controller's gains.

    Path coordinates, second-order actuators, exact zero-order hold; names and units are in the file. Over several times
    (first:last:step) each matrix is an array [time, row, column], with time_s.
    """
    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.model_file import check_format, make_model, stack_models, write_model

    if out is not None:
        check_format(out)
    times = _read_times(at)
    if len(times) > 1 and "trim" in times:
        raise InputError("--at", f"'{at}'", "one point, or times such as 0s:60s:1s")
    craft, flight, files = _find_flown(vehicle, mission, controller, trust_code)
    if len(files) > 1:
        raise InputError("--controller", ", ".join(files), "one controller")
    (file,) = files.values()
    if gains is not None:
        from abhv_mc.one_flight.given import make_flight_plan
        from abhv_mc.simulators.export_gains import check_gain_format, write_gains

        check_gain_format(gains)
        write_gains(gains, make_flight_plan(flight, craft, file))
        say(gains)
        if out is None:
            return
    if out is None:
        raise InputError(
            "--output", "no file", "one that ends in .npz, .mat or .json (-o FILE), or --gains FILE"
        )
    models = []
    for time in times:
        plan, points, _ = _take(flight, craft, file, time, bank, times)
        models.append(make_model(plan, points, linearize(plan, points)))
    write_model(
        out,
        stack_models(models, [t for t in times if t != "trim"]) if len(models) > 1 else models[0],
    )
    say(out)
