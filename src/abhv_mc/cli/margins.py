"""``abhv-mc margins``: stability margins of each loop, at the trim or along the nominal flight."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import ControllerFiles, Json, MissionOrCampaign, TrustCode, Vehicle, find_controllers
from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import new_table, print_table, say, show
from abhv_mc.io.input_error import InputError, one_of

if TYPE_CHECKING:
    from abhv_mc.linearizing import Place, Setup
    from abhv_mc.stability.analysis import Stability, Time

_FREQUENCIES = 1000
_MOST_TIMES = 10_000
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
    trust_code: TrustCode = False,
) -> None:
    """Print gain, phase and delay margins of each loop (broken at its actuator, the others closed) and of all at once.

    At a time of the flight the reference is frozen: such margins are indicative.
    """
    from abhv_mc.stability.analysis import analyse
    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.rows import make_rows

    times, angle = read_points(at, bank)
    setups = read_setups(vehicle, mission, controllers, trust_code=trust_code)
    rows: list[dict[str, Any]] = []
    shown: list[tuple[str, list[dict[str, Any]], Stability]] = []
    figures: list[Path] = []
    for name, setup in setups.items():
        for time in times:
            place = take_point(setup, name, time, angle)
            linear = linearize(place.plan, place.points)
            stability = analyse(linear, _FREQUENCIES)
            here = make_rows(name, None if time == "trim" else time, stability)
            words = "at the trim" if time == "trim" else f"at {time:g} s, reference frozen"
            shown.append((f"{name}, {setup.files[0].stem}, {setup.files[1].stem}, {words}", here, stability))
            rows += here
            if out is not None:
                from abhv_mc.report.figures.loops import write_loop_figures

                stem = f"{name}_{time if time == 'trim' else f'{time:g}s'}"
                figures += write_loop_figures(out, stem, linear)
    files = next(iter(setups.values())).files

    def in_words() -> None:
        for part in shown:
            _print_rows(*part)
        for path in figures:
            say(path)

    show({"vehicle": files[0].stem, "mission": files[1].stem, "rows": rows}, json, in_words)


def read_points(at: str, bank: str, one: bool = False) -> "tuple[list[Time], float]":
    """Times (s, or the trim) and the bank (rad) of the options. Raises InputError."""
    from abhv_mc.cli.options import parse_option
    from abhv_mc.io.units import ANGLE, TIME
    from abhv_mc.linearizing import check_bank

    times: list[Time] = []
    for each in at.split(","):
        if each.count(":") == 2:
            times += _read_range([parse_option("--at", part, TIME, "s") for part in each.split(":")])
        else:
            times.append("trim" if each.strip() == "trim" else parse_option("--at", each, TIME, "s"))
    if one and len(times) > 1 and "trim" in times:
        raise InputError("--at", f"'{at}'", "one point, or times such as 0s:60s:1s")
    for time in times:
        if time != "trim" and time < 0.0:
            raise InputError("--at", f"{time:g} s", "trim, or a time from 0 s")
    angle = check_bank(parse_option("--bank", bank, ANGLE, "deg"), "trim" not in times, "--bank")
    return times, angle


def _read_range(ends: "list[float]") -> "list[Time]":
    """Times (s) from the first to the last, both among them, the third apart. Raises InputError."""
    first, last, step = ends
    if step <= 0.0 or last < first or last - first > _MOST_TIMES * step:
        found = f"{first:g} s to {last:g} s every {step:g} s"
        raise InputError("--at", found, f"rising times, at most {_MOST_TIMES}, such as 0s:60s:1s")
    return [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]


def read_setups(
    vehicle: Path | None, mission: Path, controllers: str | None, one: bool = False, trust_code: bool = False
) -> "dict[str, Setup]":
    """What is to be linearized, by the controllers' names; ``mission`` may be a campaign file. Raises InputError."""
    from abhv_mc.cli.announce import announce_compiling
    from abhv_mc.control.controller_file import read_controller
    from abhv_mc.linearizing import read_setup
    from abhv_mc.simulators.campaign_code import check_user_law

    paths, files = _find_files(vehicle, mission, controllers, trust_code)
    if one and len(files) > 1:
        raise InputError("--controller", ", ".join(files), "one controller")
    for file in files.values():
        check_user_law(read_controller(file), trust_code)
    setups = {name: read_setup((*paths, file)) for name, file in files.items()}
    announce_compiling()
    return setups


def _find_files(
    vehicle: Path | None, mission: Path, controllers: str | None, trust_code: bool
) -> tuple[tuple[Path, Path], dict[str, Path]]:
    """Files of the vehicle and the mission, and those of the controllers by name."""
    from abhv_mc.campaign.file.kinds import find_kind
    from abhv_mc.cli.options import parse_names
    from abhv_mc.shipped import find_input

    if find_kind(mission) == "campaign":
        from abhv_mc.campaign.file.check import read_campaign
        from abhv_mc.simulators.campaign_code import check_user_code

        campaign = read_campaign(mission)
        check_user_code(campaign, trust_code)
        model = campaign.model
        known = {name: Path(file) for name, file in model.controllers.items()}
        names = parse_names(controllers) or tuple(known)
        for name in names:
            if name not in known:
                raise InputError("--controllers", f"'{name}'", one_of(known, name))
        return (vehicle or Path(model.vehicle), Path(model.mission)), {name: known[name] for name in names}
    return (vehicle or find_input("ghame_x", "vehicle"), mission), find_controllers(controllers)


def take_point(setup: "Setup", name: str, time: "Time", bank: float) -> "Place":
    """The point of the nominal flight; a warning where it is doubtful. Raises InputError without one."""
    from abhv_mc.cli.announce import announce_warnings
    from abhv_mc.flight.fly import nominal_parameters
    from abhv_mc.linearizing import find_point

    place = find_point(setup, name, time, bank, nominal_parameters(), "--at")
    announce_warnings(place.warnings)
    return place


def _print_rows(title: str, rows: list[dict[str, Any]], stability: "Stability") -> None:
    from abhv_mc.stability.analysis import NO_SLOPES

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
        table.add_row(row["loop"], *values)
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
