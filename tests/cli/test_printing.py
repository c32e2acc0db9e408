"""Tests of tables on a terminal, which are wrapped, then split, but never cut."""

import io
import os
import sys
from contextlib import nullcontext
from itertools import pairwise
from types import SimpleNamespace

import pytest

from abhv_mc.cli import printing
from abhv_mc.cli.errors import open_streams
from abhv_mc.cli.printing import _fold, new_table, print_section_table, print_table, say
from abhv_mc.topics.topic import Cell, Table, grouped


@pytest.fixture
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("width", range(60, 81, 2))
def test_a_wide_table_is_split_and_repeats_its_first_column(capsys, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    heads = [f"Quantity number {k} of the flight (m/s)" for k in range(12)]
    table = new_table(("Flight",), heads)
    for flight in (7, 2013):
        table.add_row(str(flight), *(f"{flight + k / 7:.5f}" for k in range(12)))
    print_table(table)
    out = capsys.readouterr().out
    lines = [line.rstrip() for line in out.splitlines()]
    assert max(map(len, lines)) <= width
    assert sum(line.startswith("  2013 ") for line in lines) >= 2
    assert all(f"{2013 + k / 7:.5f}" in out for k in range(12))


@pytest.mark.usefixtures("narrow")
def test_a_long_word_is_wrapped_and_a_group_is_named_once(capsys):
    digest = "0123456789abcdef" * 6
    rows = [(Cell(name), Cell(digest)) for name in ("first", "second")]
    print_section_table(
        Table(
            "Digests",
            ("What", "As", "Of", "Digest"),
            (grouped(rows, Cell("flights", head=True), Cell("rows")),),
        )
    )
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert [out.count(word) for word in ("flights", "rows", "first", "second")] == [1] * 4


@pytest.mark.usefixtures("narrow")
def test_long_names_of_rows_are_wrapped_and_repeated_in_each_piece(capsys):
    name = "Angle of attack error, settled, max < 0.5 deg in 99.73 %"
    heads = ["Controller", *(f"Campaign {k}" for k in range(9))]
    rows = [
        (Cell(controller), *(Cell(f"PASS, {100 * k + 107}") for k in range(9)))
        for controller in ("LQR robust", "TLC robust")
    ]
    print_section_table(
        Table("Verdicts", ("Requirement", *heads), (grouped(rows, Cell(name, head=True)),))
    )
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    pieces = sum(line.startswith("  Requirement ") for line in lines)
    assert pieces == sum(line.startswith("  Angle of ") for line in lines) > 1
    assert sum("LQR robust" in line for line in lines) == pieces
    assert all(sum(f"PASS, {100 * k + 107}" in line for line in lines) == 2 for k in range(9))


def test_a_table_in_a_pipe_is_not_wrapped(capsys, monkeypatch):
    monkeypatch.delitem(os.environ, "COLUMNS", raising=False)
    table = new_table(("Words",), ())
    table.add_row("a " * 60)
    print_table(table)
    lines = capsys.readouterr().out.splitlines()
    assert any(line.count("a ") >= 59 for line in lines)
    assert all(len(line) == len(next_line) for line, next_line in pairwise(filter(None, lines)))


@pytest.mark.usefixtures("narrow")
def test_the_last_column_is_not_cut(capsys):
    table = new_table(("Flight",), "abcde")
    table.add_row("flight", *["123456789012"] * 5)
    print_table(table)
    assert capsys.readouterr().out.count("123456789012") == 5


def test_characters_that_a_stream_cannot_encode_are_escaped(monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(file := io.BytesIO(), "ascii"))
    open_streams()
    print("\u2212", flush=True)
    assert file.getvalue() == b"\\u2212\n"


@pytest.mark.parametrize(("columns", "keys"), [(2, 1), (3, 2)])
def test_a_group_and_its_rows_are_the_keys_of_a_table(monkeypatch, columns, keys):
    """Of two columns, only the first names rows; a group of one row is none."""
    found = []
    monkeypatch.setattr("abhv_mc.cli.printing.print_table", lambda _, keys: found.append(keys))
    cells = tuple(Cell(str(k)) for k in range(columns - 1))
    for rows in ([cells, cells], [cells]):
        print_section_table(Table("t", ("A", "B", "C")[:columns], (grouped(rows, Cell("g")),)))
    assert found == [keys, 1]


@pytest.mark.parametrize(
    ("setting", "folds", "text"),
    [
        ({}, True, "a\n\x1b[32mPASS\x1b[0m"),
        ({}, False, "a \x1b[32mPASS\x1b[0m"),
        ({"NO_COLOR": "1"}, True, "a\nPASS"),
        ({"TERM": "dumb"}, False, "a PASS"),
    ],
)
def test_text_is_coloured_and_folded_where_asked(monkeypatch, setting, folds, text):
    monkeypatch.delenv("NO_COLOR", raising=False)
    for name, value in {"TERM": "xterm", "COLUMNS": "5", **setting}.items():
        monkeypatch.setenv(name, value)
    screen = io.StringIO()
    screen.isatty = lambda: True
    say("a PASS", folds=folds, file=screen)
    assert screen.getvalue() == f"{text}\n"


@pytest.mark.parametrize(
    ("line", "folded"),
    [
        ("one two three four five", ["one two three", "four five"]),
        ("Next  one two three four", ["Next  one two", "      three", "      four"]),
        ("  a b c d e f g h i j k", ["  a b c d e f g", "  h i j k"]),
        ("one two three  four five", ["one two three  four five"]),  # cells of a table
        ("run `a b c d e f g h i j` now", ["run", "`a b c d e f g h i j`", "now"]),
        ("one two three 4", ["one two three 4"]),
        ("x-y-z-x-y-z-x-y-z-x-y-z", ["x-y-z-x-y-z-x-y-z-x-y-z"]),
    ],
)
def test_lines_are_folded_between_words_under_their_text(line, folded):
    assert _fold(line, 15) == "\n".join(folded)


@pytest.mark.parametrize(
    ("module", "by_other", "words"),
    [
        ("abhv_mc_vehicle.kernel.flight.loop", False, "compiling the flight for"),
        ("abhv_mc_vehicle.kernel.stability", True, "compile the stability margins for"),
        ("abhv_mc_vehicle.kernel.laws.tlc", False, "compiling the reference for"),
        ("abhv_mc_vehicle.other", False, "compiling a kernel for"),
    ],
)
def test_a_kernel_that_is_compiled_is_named(monkeypatch, module, by_other, words):
    labels = []
    monkeypatch.setattr(printing, "Waiting", lambda label: labels.append(label) or nullcontext())
    with printing._tell(SimpleNamespace(__module__=module), by_other):
        pass
    assert words in labels[0] and ("waiting" in labels[0]) == by_other


def test_a_wrapped_table_has_each_cell_in_its_column(monkeypatch, capsys):
    """Numbers are never wrapped; long texts get at least 16 columns."""
    monkeypatch.setenv("COLUMNS", "44")
    table = new_table(("Name", "Text"), ("x", "long head", "third"), "title")
    table.add_row("a", "one two three four five six", "1.5", "22", "333333")
    table.add_row("bb", "", "10.25", "", "4\n5")
    print_table(table)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "title",
        "  Name  Text                  x  long",
        "                                 head",
        "  a     one two three       1.5    22",
        "        four five six",
        "  bb                      10.25",
        "",
        "  Name   third",
        "  a     333333",
        "  bb         4",
        "             5",
        "",
    ]
