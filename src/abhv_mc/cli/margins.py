"""``abhv-mc margins``: stability margins of each loop, at the trim or along the nominal flight."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from abhv_mc.cli.options import ControllerFiles, Json, MissionOrCampaign, TrustCode, Vehicle, find_controllers
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import new_table, print_table, say, show
from abhv_mc.io.input_error import InputError, one_of

if TYPE_CHECKING:
    from abhv_mc.one_flight.linear_models import Place
    from abhv_mc.stability.analysis import Stability, Time

_MOST_TIMES = 10_000
_NAMED = 6  # dispersions of a worst margin
_COLUMNS = (
    ("gain_margin_low_db", "gain down\ndB", 2),
    ("gain_margin_high_db", "gain up\ndB", 2),
    ("phase_margin_deg", "phase\ndeg", 1),
    ("delay_margin_ms", "delay\nms", 1),
    ("sensitivity_peak", "sensitivity\npeak", 2),
    ("crossover_rad_s", "crossover\nrad/s", 2),
)


def command(
    mission: MissionOrCampaign,
    vehicle: Vehicle = None,
    controllers: ControllerFiles = None,
    at: Annotated[
        str, typer.Option(metavar="POINTS", help="trim, or times of the nominal flight such as 0s,30s,48s.")
    ] = "trim",
    bank: Annotated[str, typer.Option(help="Bank of the steady turn to trim for, deg or with a unit.")] = "0",
    json: Json = None,
    out: Annotated[Path | None, output(output_folder, "DIR", "Write Bode and Nichols figures here.")] = None,
    worst: Annotated[
        bool, typer.Option("--worst", help="Search the box of a campaign's dispersions for the least margins.")
    ] = False,
    trust_code: TrustCode = False,
) -> None:
    """Print gain, phase and delay margins of each loop (broken at its actuator, the others closed) and of all at once.

    At a time of the flight the reference is frozen: such margins are indicative. With --worst, the least margins at the
    trim that a search over a campaign's dispersions finds: what is found, never what is proved.
    """
    if worst:
        if vehicle is not None or at != "trim" or bank != "0" or out is not None:
            raise InputError("--worst", "with --vehicle, --at, --bank or --output", "a campaign alone")
        _show_worst(mission, controllers, json, trust_code)
        return
    from abhv_mc.one_flight.linear_models import analyse_place
    from abhv_mc.stability.rows import make_rows

    times = read_times(at)
    files = find_flown(vehicle, mission, controllers, trust_code)
    rows: list[dict[str, Any]] = []
    shown: list[tuple[str, list[dict[str, Any]], Stability]] = []
    figures: list[Path] = []
    for name, file in files.controllers.items():
        for time in times:
            linear, stability = analyse_place(files.take(file, time, bank, times))
            here = make_rows(name, None if time == "trim" else time, stability)
            words = "at the trim" if time == "trim" else f"at {time:g} s, reference frozen"
            shown.append((f"{name}, {files.vehicle.stem}, {files.mission.stem}, {words}", here, stability))
            rows += here
            if out is not None:
                from abhv_mc.report.figures.loops import write_loop_figures

                stem = f"{name}_{time if time == 'trim' else f'{time:g}s'}"
                figures += write_loop_figures(out, stem, linear)

    def in_words() -> None:
        for part in shown:
            _print_rows(*part)
        for path in figures:
            say(path)

    show({"vehicle": files.vehicle.stem, "mission": files.mission.stem, "rows": rows}, json, in_words)


def _show_worst(file: Path, controllers: str | None, json: Path | None, trust_code: bool) -> None:
    from abhv_mc.campaign.file.check import read_campaign
    from abhv_mc.flight.metrics import BUILT_IN
    from abhv_mc.search.worst_margins import EVALUATIONS, find_worst_margins
    from abhv_mc.topics.parameter_words import shown_value, spoken_name

    files = find_flown(None, file, controllers, trust_code)
    found = find_worst_margins(read_campaign(file), tuple(files.controllers))

    def in_words() -> None:
        table = new_table(("controller", "margin"), ("nominal", "least found"), None)
        table.add_column("at")
        for one in found:
            metric = BUILT_IN[one.metric]
            at = [f"{spoken_name(name)} {shown_value(name, one.parameters[name])}" for name in one.moved]
            more = [f"and {len(at) - _NAMED} more"] if len(at) > _NAMED else []
            where = ", ".join(at[:_NAMED] + more) or "the nominal vehicle"
            values = (f"{value:.3g} {metric.unit}".removesuffix(" -") for value in (one.nominal, one.found))
            table.add_row(one.controller, metric.label, *values, f"{one.fault}: {where}" if one.fault else where)
        print_table(table)
        say(f"Found by the linear analysis at the trim, {EVALUATIONS} points a margin: the true least is no greater.")

    show({"rows": found}, json, in_words)


def read_times(at: str) -> "list[Time]":
    """Times (s, or the trim) of the option. Raises InputError."""
    from abhv_mc.cli.options import parse_option
    from abhv_mc.io.units import TIME

    times: list[Time] = []
    for each in at.split(","):
        if each.count(":") == 2:
            times += _read_range([parse_option("--at", part, TIME, "s") for part in each.split(":")])
        else:
            times.append("trim" if each.strip() == "trim" else parse_option("--at", each, TIME, "s"))
    return times


def _read_range(ends: "list[float]") -> "list[Time]":
    """Times (s) from the first to the last, both among them, the third apart. Raises InputError."""
    first, last, step = ends
    if step <= 0.0 or last < first or last - first > _MOST_TIMES * step:
        found = f"{first:g} s to {last:g} s every {step:g} s"
        raise InputError("--at", found, f"rising times, at most {_MOST_TIMES}, such as 0s:60s:1s")
    return [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]


class FlownFiles(NamedTuple):
    """What is to be linearized: files."""

    vehicle: Path
    mission: Path
    controllers: dict[str, Path]

    def take(self, controller: Path, time: "Time", bank: str, times: "list[Time]") -> "Place":
        """The point of the nominal flight; a warning where it is doubtful. A bank belongs to the trim alone."""
        from abhv_mc.cli.announce import announce_warnings
        from abhv_mc.cli.options import parse_option
        from abhv_mc.io.units import ANGLE
        from abhv_mc.one_flight.linear_models import take_point

        angle = parse_option("--bank", bank, ANGLE, "deg")
        turn = angle if time == "trim" or "trim" not in times else 0.0
        place = take_point(self.mission, self.vehicle, controller, time, turn)
        announce_warnings(place.warnings)
        return place


def find_flown(vehicle: Path | None, mission: Path, controllers: str | None, trust_code: bool) -> FlownFiles:
    """Files by name, user laws among them trusted; ``mission`` may be a campaign file. Raises InputError."""
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.cli.options import parse_names
    from abhv_mc.control.controller_file import read_controller
    from abhv_mc.shipped import DEFAULT_VEHICLE, find_input
    from abhv_mc.simulators.campaign_code import check_user_code, check_user_law

    if find_kind(mission) == "campaign":
        from abhv_mc.campaign.file.check import read_campaign

        campaign = read_campaign(mission)
        if campaign.user_model is not None:
            found = "a user's simulator, which has no plant to linearize"
            raise campaign.document.error((), found, "a campaign of our own: with vehicle, mission and controllers")
        check_user_code(campaign, trust_code)
        model = campaign.model
        known = {name: Path(file) for name, file in model.controllers.items()}
        names = parse_names(controllers) or tuple(known)
        for name in names:
            if name not in known:
                raise InputError("--controllers", f"'{name}'", one_of(known, name))
        flown = vehicle or Path(model.vehicle), Path(model.mission), {name: known[name] for name in names}
    else:
        flown = vehicle or find_input(DEFAULT_VEHICLE, "vehicle"), mission, find_controllers(controllers)
    for file in flown[2].values():
        check_user_law(read_controller(file), trust_code)
    announce_compiling()
    return FlownFiles(*flown)


def _print_rows(title: str, rows: list[dict[str, Any]], stability: "Stability") -> None:
    from abhv_mc.stability.analysis import NO_SLOPES
    from abhv_mc.topics.margins.model import loop_name

    if not stability.poles[0].size:
        say(f"{title}: no margins: {NO_SLOPES}")
        return
    poles = [pole for pole in stability.poles[0] if pole.imag >= 0.0]
    if not rows[0]["stable"]:
        growing = ", ".join(f"{p.real:+.3f}{f' +- {p.imag:.2f}j' if p.imag else ''}" for p in poles if p.real >= 0.0)
        say(f"{title}: unstable, no margins; poles {growing} per second")
        return
    table = new_table(("loop",), (heading for _, heading, _ in _COLUMNS), title, padding=(0, 1, 0, 0))
    for row in rows[:-1]:
        none = row.get("reason", "none")
        values = (f"{row[key]:.{digits}f}" if row[key] is not None else none for key, _, digits in _COLUMNS)
        table.add_row(loop_name(row["loop"]), *values)
    print_table(table)
    everything = rows[-1]
    gain = "any" if everything["disk_gain_db"] is None else f"{everything['disk_gain_db']:.2f} dB"
    delay = "any" if everything["delay_margin_ms"] is None else f"{everything['delay_margin_ms']:.1f} ms"
    say(
        f"all loops at once: disk margin {everything['disk_margin']:.4f} (gain {gain} up and down or phase "
        f"{everything['disk_phase_deg']:.1f} deg in each at the same time), the same delay in all {delay}"
    )
    damped = min((p for p in poles if p.imag > 0.0), key=lambda p: abs(p.real) / abs(p), default=None)
    if damped is not None:
        say(f"least damped pole {damped.real:.3f} +- {damped.imag:.2f}j per second")
