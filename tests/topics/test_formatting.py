"""Formatting of numbers, parameters, controllers and tables."""

import math

import numpy as np
import pytest

from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.shipped import shipped_files
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.formatting import (
    axis_unit,
    bounds,
    count_of,
    estimate,
    fixed,
    json_data,
    level_name,
    p_equation,
    p_value,
    parameter_doc,
    percent,
    shown_value,
    significant,
    spoken_name,
)
from abhv_mc.topics.topic import (
    Cell,
    Entry,
    Fold,
    Record,
    Records,
    Section,
    Table,
    controller_label,
    full_labels,
    grouped,
    interval_cell,
    make_records,
)
from abhv_mc_vehicle.plant.parameters import OURS, PARAMETERS


def test_every_parameter_has_its_own_name():
    assert spoken_name("aero.yawing_moment.sideslip") == "yawing moment due to sideslip"
    assert spoken_name("mass.center_of_gravity_x") == "centre of gravity x"
    assert len({spoken_name(parameter.name) for parameter in PARAMETERS}) == len(PARAMETERS)


@pytest.mark.parametrize(
    ("interval", "value", "ends"),
    [
        (Interval(24.123, 23.5, 24.8), "24.1", "23.5 to 24.8"),
        (Interval(0.00712, 0.0070, 0.0072), "0.00712", "0.00700 to 0.00720"),
        (Interval(12345.0, 12000.0, 12700.0), "12\u202f300", "12\u202f000 to 12\u202f700"),
        (Interval(-1.93, -1.951, -1.92), "−1.930", "−1.951 to −1.920"),
        (Interval(45.31, 44.12, math.inf), "45.3", "at least 44.1"),
        (Interval(0.71, -math.inf, 0.74), "0.71", "at most 0.74"),
        (Interval(3.0, -5.0, 11.0), "3", "−5 to 11"),
        (Interval(1.57209706, 1.57209700, 1.57209718), "1.572", "1.572 to 1.572"),
        (Interval(math.nan, 3.0, math.inf), "—", ""),
        (Interval(0.0, 0.0, 0.0), "0", "0 to 0"),
    ],
)
def test_digits_are_those_that_the_error_allows(interval, value, ends):
    assert estimate(interval) == value
    assert bounds(interval) == ends


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.9973, "99.73"),
        (0.99865, "99.865"),
        (1.0, "100"),
        (0.0, "0"),
        (0.1, "10"),
        (0.06696, "6.7"),
        (1e-9, "< 0.0001"),
        (1.0 - 1e-9, "> 99.9999"),
    ],
)
def test_shares_keep_their_nines(share, text):
    assert percent(share) == f"{text}\u202f%"


def test_small_p_values_keep_two_digits():
    assert p_value(0.0032) == "0.0032"


def test_only_the_papers_own_lqr_is_called_so(tmp_path):
    """The label 'LQR' alone would suggest the paper's controller."""
    paper = shipped_files("control")["lqr"].read_bytes()
    for name, text in (("lqr", paper), ("mine", paper.replace(b"800.0", b"200.0"))):
        folder = tmp_path / "inputs" / "controllers" / name
        folder.mkdir(parents=True)
        (folder / "lqr.yaml").write_bytes(text)
    labels = full_labels(tmp_path, ["tlc", "lqr", "mine"])
    assert labels == {"tlc": "TLC", "lqr": "LQR (paper's weights)", "mine": "mine"}


def table(*groups):
    return Table("t", ("Requirement", "Controller", "Ended early", "Room", "Why"), groups)


DASH = "\N{EM DASH}"
OWN = Parameters((Parameter("mine", "rad", 0.0, "angle", of_user=True),))
ROWS = (
    (Cell("TLC", head=True), Cell("0"), Cell("1 %"), Cell("")),
    (Cell("LQR", head=True), Cell("0"), Cell("2 %"), Cell(DASH)),
)
GROUP = grouped(ROWS, Cell("altitude", head=True))


def test_a_cell_is_repeated_in_the_rows_that_it_spans():
    assert table(GROUP).plain_rows() == [
        ["altitude", "TLC", "0", "1 %", ""],
        ["altitude", "LQR", "0", "2 %", DASH],
    ]
    assert [row[0].rows for row in GROUP] == [2, 0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (fixed(-0.04, 1), "0.0"),
        (fixed(-0.06, 1), "−0.1"),
        (fixed(1236, -1), "1240"),
        (significant(999.6), "1000"),
        (significant(-0.012345), "−0.0123"),
        (significant(math.inf), DASH),
        (percent(1e-6 * (1 + 1e-9)), "0.0001\u202f%"),
        (percent(0.5), "50\u202f%"),
        (percent(1.24, 2), "124\u202f%"),
        (percent(None), DASH),
        (p_equation(1e-4), "p = 0.00010"),
        (p_equation(9e-5), "p < 0.0001"),
        (shown_value("aero.lift", 1.0811, OURS), "+8.1\xa0%"),
        (shown_value("aero.lift", 1.00004, OURS), "0.0\xa0%"),
        (shown_value("aero.lift", 0.95, OURS), "−5.0\xa0%"),
        (shown_value("failure.elevator.stuck_at", 0.1, OURS), "5.73\xa0deg"),
        (shown_value("failure.elevator.stuck_at", None, OURS), "where it is"),
        (shown_value("failure.elevator.stuck_time", math.inf, OURS), "never"),
        (shown_value("wind.north", 2.0, OURS), "2.00\xa0m/s"),
        (shown_value("initial.roll_rate", 0.1, OURS), "5.73\xa0deg/s"),
        (shown_value("aero.lift.increment", -0.02, OURS), "−0.0200"),
        (shown_value("failure.rudder.duration", math.inf, OURS), "for good"),
        (shown_value("aero.lift", 1.0, OURS), "0.0\xa0%"),
        (axis_unit("aero.lift", OURS), ("factor", 1.0)),
        (axis_unit("initial.roll_rate", OURS), ("deg/s", 180.0 / math.pi)),
        (axis_unit("aero.lift.increment", OURS), ("", 1.0)),
        (axis_unit("wind.north", OURS), ("m/s", 1.0)),
        (axis_unit("mine", OWN), ("rad", 1.0)),
        (shown_value("mine", 0.1, OWN), "0.100\xa0rad"),
        (axis_unit("unknown", OWN), ("factor", 1.0)),
        (parameter_doc("mine", OWN), "angle"),
        (parameter_doc("unknown", OWN), ""),
        (count_of(3, 12000), "3 of 12\u202f000"),
        (level_name(0.9973), "q99.73"),
        (p_value(9.9e-5), "< 0.0001"),
        (p_value(0.5), "0.50"),
        (percent(-0.02), "−2\u202f%"),
        (percent(0.99999), "99.999\u202f%"),
        (spoken_name("mass.total"), "mass"),
        (spoken_name("my_input"), "my input"),
        (spoken_name("failure.elevator.slow_time"), "elevator slowing time"),
        (spoken_name("failure.elevator.stuck_time"), "elevator sticking time"),
        (spoken_name("failure.elevator.stuck_at"), "elevator failure stuck at"),
        (spoken_name("sensor.pitch.factor"), "sensor pitch factor"),
        (interval_cell(Interval(math.inf, 1.0, math.inf)).plain, "not reached"),
        (interval_cell(Interval(24.123, 23.5, 24.8)).plain, "24.1 (23.5 to 24.8)"),
        (Cell("1", "n", best=True).plain, "1* (n)"),
        (controller_label("lqr_robust+aero.lift=0.9"), "LQR robust aero.lift=0.9"),
        (spoken_name("failure.sensor.q.loss_time"), "q sensor loss time"),
        (spoken_name("sensor.pitch_rate_bias"), "pitch rate bias"),
        (spoken_name("aero.lift.increment"), "lift increment"),
        (spoken_name("wind.north"), "wind north"),
    ],
)
def test_numbers_and_names_as_text(text, expected):
    assert text == expected


def test_json_has_null_for_what_is_not_finite():
    values = [np.float64("nan"), math.inf, np.int64(3), (True, None), np.array([1.5, -np.inf])]
    data = {"a": values, "b": Interval(1.0, -math.inf, 2.0)}
    interval = {"value": 1.0, "low": None, "high": 2.0}
    assert json_data(data) == {"a": [None, None, 3, [True, None], [1.5, None]], "b": interval}


def test_columns_and_tables_without_entries_are_left_out():
    rows = (
        (Cell("a", head=True), Cell("0"), Cell(""), Cell("0", "n"), Cell("0")),
        (Cell("", head=True), Cell("0"), Cell(DASH), Cell(""), Cell("7")),
    )
    idle = Table("T", ("A", "B", "C", "D", "E"), (rows[:1], rows[1:]))
    section = Section("S", (idle, Fold("F", (idle, Fold("G", (idle,))))))
    tables = section.without_idle().tables()
    assert len(tables) == 3 and {table.heads for table in tables} == {("A", "D", "E")}
    assert tables[0].plain_rows() == [["a", "0 (n)", "0"], ["", "", "7"]]
    empty = Table("T", ("A", "B"), ())
    assert empty.without_idle() == empty


def test_records_are_lines_of_at_most_80_columns_with_whole_commands():
    records = make_records([("One", "a"), ("Two", ""), ("Three", "b"), ("One", "c")])
    assert [record.line for record in records.records] == ["One: a; c", "Three: b"]
    assert repr(records).splitlines() == ["One    a", "       c", "Three  b"]
    command = f"`abhv-mc run DIR/{'x' * 30} --DIRECTORY`"
    long = Record(
        "Next", (Entry(("TLC", "LQR"), f"{'word ' * 9}{command} and {'more ' * 20}"), Entry())
    )
    moved = Records((long,)).at("my folder")
    assert moved.records[0].entries[0].names == ("TLC", "LQR")
    lines = repr(moved).split("\n")
    assert lines[0].startswith("Next  TLC, LQR: word") and lines[-1] == ""
    assert all(len(line) <= 80 for line in lines if "`" not in line) and len(lines) == 5
    assert all(line.startswith(" " * 8) for line in lines[1:-1])
    assert command.replace("DIR/", "my folder/") in " ".join(map(str.strip, lines))
    assert any("`abhv-mc run my folder/" in line and "--DIRECTORY`" in line for line in lines)
    assert repr(Records(())) == ""
