"""Tables on a terminal: folded, then divided, never cut."""

import os
from itertools import pairwise

import pytest

from abhv_mc.cli.printing import new_table, print_section_table, print_table
from abhv_mc.topics.section import Cell, Table, grouped


@pytest.fixture
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.usefixtures("narrow")
def test_a_wide_table_is_divided_and_repeats_its_first_column(capsys):
    heads = [f"Quantity number {k} of the flight (m/s)" for k in range(12)]
    table = new_table(("Flight",), heads)
    for flight in (7, 2013):
        table.add_row(str(flight), *(f"{flight + k / 7:.5f}" for k in range(12)))
    print_table(table)
    out = capsys.readouterr().out
    lines = [line.rstrip() for line in out.splitlines()]
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith("  2013 ") for line in lines) >= 2
    assert all(f"{2013 + k / 7:.5f}" in out for k in range(12))


@pytest.mark.usefixtures("narrow")
def test_a_long_word_is_folded_and_a_group_is_named_once(capsys):
    digest = "0123456789abcdef" * 6
    rows = [(Cell(name), Cell(digest)) for name in ("first", "second")]
    print_section_table(
        Table("Digests", ("What", "Of", "Digest"), (grouped(rows, Cell("flights", head=True)),))
    )
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert out.count("flights") == 1 and out.count("second") == 1


def test_a_pipe_takes_a_table_as_it_is(capsys, monkeypatch):
    monkeypatch.delitem(os.environ, "COLUMNS", raising=False)
    table = new_table(("Words",), ())
    table.add_row("a " * 60)
    print_table(table)
    lines = capsys.readouterr().out.splitlines()
    assert any(line.count("a ") >= 59 for line in lines)
    assert all(len(one) == len(other) for one, other in pairwise(filter(None, lines)))
