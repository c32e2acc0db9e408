"""Operating points and loops of linear models."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from programs import invoke

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.flights.signals import Signal
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.cli import flying, linearizing, loops, nominal_report
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX, CHANNELS, REFERENCE_CHANNELS


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("trim,2s", ["trim", 2.0]),
        ("0s:1s:0.25s", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("1s:1.3s:0.1s,5", [1.0, 1.1, 1.2, 1.3, 5.0]),
        ("0:1:0.4", [0.0, 0.4, 0.8]),
        ("2:2:1", [2.0]),
    ],
)
def test_ranges_of_times_include_their_ends(text, times):
    for found, time in zip(linearizing._read_times(text), times, strict=True):
        assert found == time if time == "trim" else found == pytest.approx(time)


@pytest.mark.parametrize("text", ["2:1:1", "2:2:0", "0:1", "0:1:0", "0:1:1:1", "0:10001:1", "x"])
def test_ranges_without_times_or_with_too_many_are_refused(text):
    with pytest.raises(InputError, match="--at"):
        linearizing._read_times(text)


def test_an_unstable_loop_names_its_poles_and_a_stable_one_its_margins(capsys):
    columns = {key: k + 1.5 for k, (key, *_) in enumerate(linearizing._COLUMNS)}
    columns["delay_margin_ms"] = None
    disk = {"disk_gain_db": 4.4, "disk_phase_deg": 28.0, "disk_margin": 0.5}
    rows = [{"loop": "rudder", "stable": True, **columns}, {**disk, "delay_margin_ms": 40.0}]
    poles = np.array([-1.0, -3.0 + 4.0j, -3.0 - 4.0j, -0.5 + 0.1j, -0.5 - 0.1j, -0.2j])
    linearizing._print_rows("t", rows, SimpleNamespace(poles=[poles]))
    out = " ".join(capsys.readouterr().out.split())
    assert "rudder 1.50 2.50 3.5 none 5.50 6.50" in out
    assert "margin 0.5000 (gain +-4.40 dB or phase 28.0 deg" in out and "margin 40.0 ms" in out
    assert "pole -3.000 +- 4.00j" in out  # damping 0.6
    rows[1] |= {"disk_gain_db": None, "delay_margin_ms": None}
    linearizing._print_rows("t", rows, SimpleNamespace(poles=[poles[:1]]))
    out = capsys.readouterr().out
    assert out.count("any") == 2 and "pole" not in out
    rows[0]["stable"] = False
    poles = np.array([0.12 + 2.78j, 0.12 - 2.78j, 0.3, -1.0])
    linearizing._print_rows("t", rows, SimpleNamespace(poles=[poles]))
    assert capsys.readouterr().out.strip().endswith(": +0.120 +- 2.78j, +0.300 1/s")


def test_a_phase_is_continuous_and_neutral_points_are_marked_where_curves_pass():
    """Three integrators lag by 270 deg; their gain is 1 at 1 rad/s."""
    omega = np.geomspace(0.01, 100.0, 50)
    weak = 1e-4 / (1.0 + 1.0j * omega) ** 8  # -720 deg at -80 dB and less
    gains = np.column_stack([1.0 / (1.0j * omega) ** 3, 0.5 / (1.0j * omega), weak])
    assert loops._phase(gains[:, 0]) == pytest.approx(np.full(50, -270.0))
    upper, lower = loops.plot_bode(omega, gains, ("a_b", "b", "c")).axes
    assert upper.lines[0].get_ydata() == pytest.approx(-60.0 * np.log10(omega))
    assert lower.lines[1].get_ydata() == pytest.approx(np.full(50, -90.0))
    assert [text.get_text() for text in upper.get_legend().get_texts()] == ["a b", "b", "c"]
    (axes,) = loops.plot_nichols(gains, ("a", "b", "c")).axes
    marks = [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "+"]
    assert marks == [[[-180.0, 0.0]]]
    omega = np.geomspace(0.01, 10.0, 400)
    late = np.exp(-1.0j * omega) / (1.0j * omega)  # up to -663 deg at -20 dB
    (later,) = loops.plot_nichols(late[:, None], ("a",)).axes
    marks = [line.get_xydata().tolist() for line in later.lines if line.get_marker() == "+"]
    assert marks == [[[-540.0, 0.0]], [[-180.0, 0.0]]]
    assert axes.lines[1].get_ydata()[0] == pytest.approx(20.0 * np.log10(50.0))


@pytest.mark.parametrize(("moved", "listed", "rest"), [(0, 0, 0), (6, 6, 0), (7, 6, 1), (9, 6, 3)])
def test_a_smallest_margin_lists_six_of_its_dispersions(monkeypatch, capsys, moved, listed, rest):
    names = ["aero.lift", "aero.drag", "atmosphere.density", "mass.total"]
    names += [f"aero.{axis}" for axis in ("pitch", "roll", "yaw", "side_force", "damping")]
    result = SimpleNamespace(
        controller="own",
        metric=MARGIN_NAMES[0],
        nominal=6.0,
        found=3.25,
        fault="",
        parameters=dict.fromkeys(names, 1.0),
        moved=names[:moved],
    )
    campaign = SimpleNamespace(parameters=None)
    monkeypatch.setattr(linearizing, "_find_flown", lambda *_: (None, None, {"own": None}))
    monkeypatch.setattr("abhv_mc.campaign.file.check.read_campaign", lambda file: campaign)
    monkeypatch.setattr("abhv_mc.search.worst.find_worst_margins", lambda *_: [result])
    monkeypatch.setattr(
        "abhv_mc.topics.formatting.shown_value", lambda name, value, _: f"<{value:g}>"
    )
    linearizing._show_worst(None, None, None, False)
    out = " ".join(capsys.readouterr().out.split())
    assert "3.25 dB" in out and out.count("<1>") == listed
    assert (f"and {rest} more" in out) == (" more" in out) == (rest > 0)


@pytest.mark.parametrize("phases", [(), ("a phase",)])
def test_loop_figures_end_below_the_nyquist_frequency(tmp_path, monkeypatch, phases):
    drawn, linear = [], SimpleNamespace(period=0.05, phases=phases, inputs=("a", "b"))
    monkeypatch.setattr(loops, "make_loops", lambda linear: "loops")
    monkeypatch.setattr(loops, "loop_gains", lambda made, system, omega: (made, system, omega))
    monkeypatch.setattr(loops, "close", lambda gains: (None, SimpleNamespace(L=gains)))
    monkeypatch.setattr(loops, "fundamental_gains", lambda linear, omega: "fundamental")
    monkeypatch.setattr(loops, "plot_bode", lambda *arguments: arguments)
    monkeypatch.setattr(loops, "plot_nichols", lambda *arguments: arguments)
    monkeypatch.setattr(loops, "write_png", lambda figure, path: drawn.append((figure, path)))
    paths = list(loops.write_loop_figures(tmp_path, "tlc", linear))
    assert paths == [tmp_path / "bode_tlc.png", tmp_path / "nichols_tlc.png"]
    (((omega, gains, inputs), path), (nichols, _)) = drawn
    assert path == paths[0] and inputs == ("a", "b") and nichols == (gains, inputs)
    ends = omega[0], omega[-1]
    assert ends == pytest.approx((0.01, 0.999 * np.pi / 0.05)) and omega.size == 1500
    assert omega[1] / omega[0] == pytest.approx(omega[-1] / omega[-2])
    if phases:
        assert gains == "fundamental"
    else:
        assert gains[0] == "loops" and not gains[1].any() and gains[2] is omega


def test_the_table_of_a_trim_has_a_column_for_each_bank_angle(capsys):
    row = {name: 1000.0 * (k + 1) for k, (name, *_) in enumerate(flying._TRIM_ROWS)}
    level = row | {"mach": 6.1234, "dynamic_pressure_pa": 51234.0, "bank_deg": 0.0, "fault": ""}
    name, label, unit, digits = flying._TRIM_ROWS[0]
    banked = level | {"mach": 7.0, "bank_deg": 30.0, "fault": "stalled", name: np.inf}
    flying._print_trims(Path("x/own.yaml"), 30500.0, 1850.0, [level, banked])
    out = capsys.readouterr().out
    head, *lines = out.splitlines()
    assert "own: 30.5 km, 1850 m/s, Mach 6.123, 51.23 kPa" in head
    cells = [line.split() for line in lines if line.strip()]
    assert ["0", "deg", "30", "deg"] in [line[-4:] for line in cells]
    for k, (_, label, unit, digits) in enumerate(flying._TRIM_ROWS):
        value = f"{1000.0 * (k + 1) / (1e3 if unit == 'kN' else 1.0):.{digits}f}"
        (line,) = [
            line for line in lines if line.strip().startswith(f"{label.strip()} ") and value in line
        ]
        assert line.split()[-2:] == [value, value if k else "-"]
        assert unit == "-" or unit in line
    assert [line.endswith("30 deg: stalled") for line in lines if "no trim" in line] == [True]


@pytest.mark.parametrize(
    ("time", "times", "turn"),
    [("trim", ["trim", 2.0], 30.0), (2.0, ["trim", 2.0], 0.0), (2.0, [2.0, 3.0], 30.0)],
)
def test_a_bank_angle_is_for_the_trim_point_if_there_is_one(monkeypatch, time, times, turn):
    taken = []

    def take_point(*arguments):
        taken.append(arguments)
        return SimpleNamespace(warnings=())

    monkeypatch.setattr("abhv_mc_vehicle.one_flight.linear_models.take_point", take_point)
    linearizing._take("mission", "vehicle", "law", time, "30", times)
    assert taken == [("mission", "vehicle", "law", time, pytest.approx(np.deg2rad(turn)))]


@pytest.mark.parametrize(
    "option",
    [["--vehicle", "f16"], ["--at", "2s"], ["--bank", "5"], ["--hold", "speed"], ["-o", "x"]],
)
def test_a_search_of_margins_takes_no_operating_point(tmp_path, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    shown = []
    monkeypatch.setattr(linearizing, "_show_worst", lambda *arguments: shown.append(arguments))
    result = invoke("margins", "s_manoeuvre", "--worst", *option)
    assert isinstance(result.exception, InputError) and not shown
    assert invoke("margins", "s_manoeuvre", "--worst", "--controllers", "tlc").exit_code == 0
    assert [arguments[1:] for arguments in shown] == [("tlc", None, False)]


def test_margins_of_each_controller_and_time_have_their_title_and_rows(tmp_path, monkeypatch):
    printed, taken, drawn = [], [], []
    files = {"a": Path("a.yaml"), "b": Path("b.yaml")}
    found = Path("v/own.yaml"), Path("m/course.yaml"), files
    monkeypatch.setattr(linearizing, "_find_flown", lambda *_: found)
    monkeypatch.setattr(linearizing, "_take", lambda *place: place[2:4])
    monkeypatch.setattr(linearizing, "_print_rows", lambda *table: printed.append(table))

    def analyse(place, hold):
        taken.append((place, hold))
        return f"linear {place[1]}", f"stable {place[1]}", ["note"] * (place[1] == 2.0)

    def rows(name, time, stability):
        return [{"controller": name, "time_s": time, "loop": stability}]

    def draw(folder, stem, linear):
        drawn.append((folder, stem, linear))
        return [folder / f"{stem}.png"]

    monkeypatch.setattr("abhv_mc_vehicle.one_flight.linear_models.analyse_place", analyse)
    monkeypatch.setattr("abhv_mc_vehicle.stability.analysis.make_rows", rows)
    monkeypatch.setattr("abhv_mc_vehicle.cli.loops.write_loop_figures", draw)
    options = ("--at", "trim,2s", "--hold", "speed,heading", "-o", tmp_path / "o")
    result = invoke("margins", "level", *options, "--json", tmp_path / "m.json")
    assert result.exit_code == 0, result.exception
    pairs = [("a", "trim"), ("a", 2.0), ("b", "trim"), ("b", 2.0)]
    assert taken == [((files[name], time), ("speed", "heading")) for name, time in pairs]
    numbers = json.loads((tmp_path / "m.json").read_text())
    assert (numbers["vehicle"], numbers["mission"]) == ("own", "course")
    assert numbers["rows"] == [
        {"controller": name, "time_s": time if time == 2.0 else None, "loop": f"stable {time}"}
        for name, time in pairs
    ]
    assert numbers["notes"] == ["note"] * 2
    for (title, own, stability), (name, time) in zip(printed, pairs, strict=True):
        assert title.startswith(f"{name}, own, course, ") and stability == f"stable {time}"
        assert ("at 2 s" in title) == (time == 2.0) and len(own) == 1
    stems = ["a_trim", "a_2s", "b_trim", "b_2s"]
    assert drawn == [
        (tmp_path / "o", s, f"linear {t}") for s, (_, t) in zip(stems, pairs, strict=True)
    ]
    assert result.stdout.split() == [str(tmp_path / "o" / f"{stem}.png") for stem in stems]


@pytest.mark.parametrize("trimmed", [[True, True], [True, False]])
def test_a_trim_is_asked_in_si_units_and_fails_with_one_point(monkeypatch, trimmed):
    asked = []

    def trim(*arguments, **options):
        asked.append((arguments, options))
        table = pd.DataFrame({"bank_deg": [0.0, 50.0], "trimmed": trimmed}).set_index("bank_deg")
        table.attrs = {"warnings": [], "altitude_m": 1.0, "speed_mps": 2.0, "mass_kg": 3.0}
        return table

    monkeypatch.setattr("abhv_mc.api.trim", trim)
    plain = invoke("trim", "f16", "--json", "-")
    options = "--altitude=2km --speed=36km/h --bank=30,1rad --mass=1.5t --flight-path-angle=3"
    full = invoke("trim", "level", *options.split(), "--heading=90", "--json", "-")
    assert [result.exit_code for result in (plain, full)] == [int(not all(trimmed))] * 2
    f16, level, abhv = (
        find_input(*pair)
        for pair in (("f16", "vehicle"), ("level", "mission"), ("abhv", "vehicle"))
    )
    (first, second), (own, none) = asked[1], asked[0]
    assert own == (f16, None, None, None) and none.pop("mission") == level
    assert none.pop("rotating") is False and {*none.values()} == {None}
    angle = np.pi / 180.0
    assert first[0] == abhv and first[1:3] == pytest.approx((2000.0, 10.0))
    assert first[3] == pytest.approx([30.0 * angle, 1.0]) and second["mass"] == 1500.0
    assert second["flight_path_angle"] == pytest.approx(3.0 * angle)
    assert second["heading"] == pytest.approx(90.0 * angle) and second["latitude"] is None
    numbers = json.loads(full.stdout)
    assert [numbers[key] for key in ("altitude_m", "speed_mps", "mass_kg")] == [1.0, 2.0, 3.0]
    assert numbers["points"][1] == {"bank_deg": 50.0, "trimmed": trimmed[1]}


def test_the_start_of_a_trim_is_that_of_the_file():
    level, mission, abhv, ghame, wide = (
        find_input(*pair)
        for pair in (
            *(("level", "mission"), ("f16_level", "mission"), ("abhv", "vehicle")),
            *(("ghame", "vehicle"), ("winged_cone", "campaign")),
        )
    )
    model = read_campaign(wide).model
    own = Path(model.vehicle), Path(model.mission)
    for start, vehicle, found in (
        *((ghame, None, (ghame, level)), (ghame, abhv, (abhv, level))),
        *((mission, None, (abhv, mission)), (mission, ghame, (ghame, mission))),
        *((wide, None, own), (wide, ghame, (ghame, own[1]))),
    ):
        assert flying._find_mission(start, vehicle) == found
    with pytest.raises(InputError):
        flying._find_mission(find_input("tlc", "control"), None)


def test_flights_are_printed_by_metric_and_controller(capsys):
    def flight(outcome, end, *values):
        metrics = dict(zip(("a_m", "b"), values, strict=True))
        return SimpleNamespace(outcome=outcome, end_time=end, metrics=metrics, sentence=f"is {end}")

    flights = {"one": flight("ok", 60.0, 1.23456, 2.0), "two": flight("lost", 5.25, -3e6, np.nan)}
    flying._print_flights("title", flights)
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.split()]
    assert [line for line in lines if "\u2500" not in line[0]] == [
        *(["title"], ["metric", "one", "two"], ["outcome", "ok", "lost"]),
        *(["end_time_s", "60", "5.25"], ["a_m", "1.235", "-3e+06"], ["b", "2", "nan"]),
        *(["one:", "is", "60.0"], ["two:", "is", "5.25"]),
    ]


def test_a_nominal_report_has_the_channels_that_all_plans_share(tmp_path, monkeypatch):
    """Headings are drawn without jumps."""
    drawn = []
    monkeypatch.setattr(nominal_report, "plot_flown", lambda *pair: drawn.append(pair))
    monkeypatch.setattr(nominal_report, "write_png", lambda figure, path: None)
    index = CHANNEL_INDEX["heading_deg"]
    own, timing = Signal("state.own", "-", "own"), SimpleNamespace(ticks=3, tick=0.1)
    plans = {
        "one": SimpleNamespace(timing=timing, channels=(*CHANNELS, own)),
        "two": SimpleNamespace(timing=timing, channels=CHANNELS),
    }
    history = np.tile(np.arange(len(CHANNELS) + 1, dtype=np.float32), (4, 1))
    history[:, index] = 350.0, 358.0, 4.0, 12.0
    histories = {"one": history, "two": history[:, :-1] + np.float32(1.0)}
    reference = {name: np.arange(2.0) for name in ("time", *(c.name for c in REFERENCE_CHANNELS))}
    monkeypatch.setattr(nominal_report, "reference_of", lambda plan, every: reference)
    paths = list(nominal_report.write_nominal_report(tmp_path, plans, histories))
    names = ["nominal.parquet", "reference.parquet", "figures/channels.png"]
    assert paths == [tmp_path / name for name in names]
    table = pq.read_table(paths[0])
    assert table.column_names == ["controller", "time", *(c.name for c in CHANNELS)]
    assert table["time"].to_pylist() == pytest.approx([0.0, 0.1, 0.2, 0.3] * 2)
    assert table["heading_deg"].to_pylist() == [*history[:, index], *(history[:, index] + 1.0)]
    ((flights, shown),) = drawn
    curves = list(flights.values())
    assert curves[1]["heading_deg"].tolist() == [351.0, 359.0, 365.0, 373.0]
    assert curves[0][CHANNELS[0].name].tolist() == [0.0] * 4 and shown.keys() == reference.keys()
