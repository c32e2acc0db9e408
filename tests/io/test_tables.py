"""Tables of other programs with source locations, columns of pyarrow, atomic writes."""

import json
import sys
from decimal import Decimal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.io import foreign_table
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.foreign_table import read_foreign_table, read_head, read_numbers
from abhv_mc.io.messages import InputError
from abhv_mc.io.parquet_columns import (
    arrow_memory,
    column_values,
    distinct_texts,
    number_column,
    text_column,
)
from abhv_mc.io.units import LENGTH, TIME


def read(folder, text, name="table.csv"):
    (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)
    return read_foreign_table(folder / name)


HEADS = ("flight", "a", "b", "note", "x[0]", "x[1]")
ROWS = (("1", "1.5", "-2e3", "one", "0", "1"), ("2", "-0.25", "7", "two, more", "0", "1"))


def written(separator, heads=HEADS, rows=ROWS, decimal="."):
    def cell(text):
        text = text.replace(".", decimal)
        return f'"{text}"' if separator in text or (separator == "  " and " " in text) else text

    return "\n".join(separator.join(map(cell, row)) for row in (heads, *rows)) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        written(","),
        written(";"),
        written(";", decimal=","),
        written("\t", decimal=","),
        written("  "),
        written(", "),
        "\ufeff" + written(","),
        written(";", decimal=",").encode("utf-16"),
        written(",").replace("\n", "\r\n"),
        "# a comment\n\n" + written(",") + "\n# the end\n",
        "%" + written("  "),
        written(",", [f"{head} [km]" if head in "ab" else head for head in HEADS]),
        written(",", [f"{head} (km)" if head in "ab" else head for head in HEADS]),
        written(",", [f"{head}{{km}}" if head in "ab" else head for head in HEADS]),
        written(",", [f"{head}_km" if head in "ab" else head for head in HEADS]),
        written(",", rows=(("-", "[km]", "km", "", "", "V"), *ROWS)),
    ],
)
def test_a_table_of_any_dialect_has_the_same_numbers(tmp_path, text):
    table = read(tmp_path, text)
    columns = table.find(["flight", "a", "b"])
    numbers = table.numbers([column.position for column in columns.values()])
    assert numbers.tolist() == [[1.0, 1.5, -2000.0], [2.0, -0.25, 7.0]]
    assert table.words(table.heads.index("note"))[0] == "one"
    units = {column.unit for name, column in columns.items() if name != "flight"}
    assert len(units) == 1
    factor = 1000.0 if units == {"km"} else 1.0
    assert table.factor(columns["a"], "m") == factor


def test_parquet_and_json_have_the_numbers_of_a_csv_file(tmp_path):
    values = {
        "seed": [2**63 + 1025, 3],
        "hit": [True, False],
        "gain": [0.1, 1e-3],
        "system": ["v1", "v2"],
        "a.b": [1, None],
    }
    text = "seed,hit,gain,system,a.b\n9223372036854776833,true,0.1,v1,1\n3,False,1e-3,v2,\n"
    columns = {
        "seed": pa.array(values["seed"], pa.uint64()),
        "hit": pa.array(values["hit"]),
        "gain": pa.array([Decimal("0.100"), Decimal("0.001")]),
        "system": pa.array(values["system"]).dictionary_encode(),
        "a.b": pa.array(values["a.b"], pa.int8()),
        "unused": pa.array([{"x": 1}, None]),
        "__index_level_0__": pa.array([5, 6]),
    }
    pq.write_table(pa.table(columns), tmp_path / "table.parquet")
    rows = (
        {"seed": 2**63 + 1025, "hit": True, "gain": 0.1, "system": "v1", "a": {"b": 1}, "x": [2]},
        {"x": list(range(50)), "gain": 1e-3, "seed": 3, "hit": False, "system": "v2"},
    )
    tables = [
        read(tmp_path, text),
        read(tmp_path, "\n".join(map(json.dumps, rows)), "table.txt"),
        read_foreign_table(tmp_path / "table.parquet"),
    ]
    for table in tables:
        names = ["seed", "hit", "gain", "a.b"]
        indices = [table.heads.index(name) for name in names]
        numbers = table.numbers(indices, finite=False)
        expected = [[2.0**63 + 2048.0, 1.0, 0.1, 1.0], [3.0, 0.0, 1e-3, np.nan]]
        assert np.array_equal(numbers, expected, equal_nan=True)
        assert table.words(table.heads.index("system")) == ["v1", "v2"]


def test_a_workbook_has_its_numbers_units_and_rows(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (
        ["flight", "apogee", "hit", "by"],
        [None, "ft", None, None],
        [1, 1000.5, True, "A, B"],
        [2, "2000,5", False, None],
        [3, "far", False, "C"],
    ):
        book.active.append(row)
    book.create_sheet("notes").append(["not read"])
    book.save(tmp_path / "flights.xlsx")
    table = read_foreign_table(tmp_path / "flights.xlsx")
    assert table.heads == ("flight", "apogee", "hit", "by")
    assert table.units == ("", "ft", "", "")
    assert table.numbers([0, 2]).tolist() == [[1.0, 1.0], [2.0, 0.0], [3.0, 0.0]]
    assert table.words(3) == ["A, B", "", "C"]
    with pytest.raises(InputError, match=r"flights\.xlsx:4: found '2000,5' .*'apogee'"):
        table.numbers([1])


@pytest.mark.parametrize(
    ("text", "location", "problem"),
    [
        ("a,b\n1,2\n1,x y\n", (3, 3), "'x y'.*'b'"),
        ("a  b\n1  2\n 1.5   x\n", (3, 8), "'x'.*'b'"),
        ("a b\n1 2\n\t1 \tx\n", (3, 5), "'x'.*'b'"),
        ("a, b\n1, 2\n1,  x\n", (3, 5), "'x'.*'b'"),
        ("a\tb\n1\t2\n1\tx\n", (3, 3), "'x'.*'b'"),
        ('a;b\n1;2\n"1" ; x\n', (3, 7), "'x'.*'b'"),
        ("a,b\n1,2\n\n1,\n", (4, 3), "''.*'b'"),
        ("a;b\n1,5;2\n1.5;3\n", (2, 1), "'1,5'"),  # a decimal comma, or thousands?
        ("a;b\n1,5;2\n2,5;2\n1.5;3\n", (4, 1), "'1.5'"),  # most numbers have a comma
        ('a,b\n"1,234",2\n', (2, 1), "'1,234'"),
        ("a,b\n1,nan\n", (2, 3), "'nan'"),
        ("a,b\n1,2,3\n", (2, None), "3 cells"),
        ("", (1, None), "no rows"),
        (b"a\n\xff\n", (None, None), "utf-8"),
        ('{"a": 1, "b": 2}\n\n{"a": 1\n', (3, None), "delimiter"),
        ('{"a": 1, "b": 2}\n\n{"a": 1}\n', (3, None), "''.*'b'"),
    ],
)
def test_a_mistake_is_said_with_its_place(tmp_path, text, location, problem):
    with pytest.raises(InputError, match=problem) as caught:
        read(tmp_path, text).numbers([0, 1])
    assert (caught.value.line, caught.value.column) == location


@pytest.mark.parametrize(
    "lines", ["7,x", '"7","x"', '7, "x"', "", "# note", '7,"x\ny"', "7,µ", "7,x\r", "7,x\v"]
)
def test_lines_of_a_large_file_are_read_and_located_as_those_of_a_small_one(
    tmp_path, monkeypatch, lines
):
    monkeypatch.setattr(foreign_table, "_BLOCK", 500)
    body = f"{lines}\n" + "1,a\n" * 300 + "bad,b"
    tables = [read(tmp_path, 'n,"w"\n' + "0,z\n" * rows + body) for rows in (2, 1200)]
    small, large = ([table.words(i)[-302:] for i in (0, 1)] for table in tables)
    assert large == small
    located = []
    for table in tables:
        with pytest.raises(InputError, match="'bad'") as caught:
            table.numbers([0])
        located.append((caught.value.line - len(table), caught.value.column))
    assert located[0] == located[1]


@pytest.mark.parametrize("rows", [1, 1500])
@pytest.mark.parametrize(
    ("first", "second", "other", "expected"),
    [
        ("12,788", "0,125", "1", 12.788),
        ("12,788", "\N{MINUS SIGN}1250,125", "1", 12.788),
        ("12,788", "1,250e+03", "1", 12.788),
        ("12,788", "1", "1,5", 12.788),  # in a column that is not read
        ("12,788", "1250", "x", 12.788),  # 1,250 would have a separator
        ("12,788", "1,234,567", "1", 12788.0),
        ("12,788", "1,250.5", "1", 12788.0),
        ("12,788.25", "1", "1", 12788.25),
        ("12,788", "3.25", "1", 12788.0),
        ("1.0D+03", "1", "12,788", 1000.0),
        ("12,788", "1", "1250", None),
        ("12,788", "1", "12.5", None),
        ("-12,788", "-1,250", "x,y", None),
    ],
)
def test_commas_have_one_meaning_in_a_file(tmp_path, rows, first, second, other, expected):
    for separator in "\t;,":
        cells = f'"{separator}"'.join(("{}", "1", other))
        body = f'"{cells.format(first)}"\n"{cells.format(second)}"\n' * rows
        table = read(tmp_path, separator.join("abc") + "\n" + body)
        if expected is None:
            with pytest.raises(InputError, match=r"12.788 or -?12788; .*decimal: .*thousands: "):
                table.numbers([0, 1])
            for comma, value in (("decimal", 12.788), ("thousands", 12788.0)):
                numbers = read_foreign_table(table.path, comma=comma).numbers([0])
                assert (abs(numbers[::2]) == value).all()
        else:
            assert (table.numbers([0, 1])[::2, 0] == expected).all()


@pytest.mark.parametrize(
    ("text", "location", "problem"),
    [
        ("time_s\n1\n", (1, None), "altitude"),
        ("time_s,altitude\n1,2\n", (1, 8), "'altitude'"),
        ("time_s,altitude_kg\n1,2\n", (1, 8), "'altitude_kg' ('1 kg'"),
        ("time_s,altitude [m],altitude_m\n1,2,2\n", (1, 21), "two columns 'altitude'"),
        ("time_s, altitude [m],  altitude_m\n1,2,2\n", (1, 24), "two columns 'altitude'"),
        ("time_s,altitude_min\n1,2\n", (1, None), "altitude"),
        ("time_s,altitude_km\n1,1e6\n", (2, 3), "'altitude' is 1e+09 m"),
    ],
)
def test_columns_of_a_quantity_have_its_unit(tmp_path, text, location, problem):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_numbers(tmp_path / "table.csv", {"time": TIME, "altitude": LENGTH})
    assert (caught.value.line, caught.value.column) == location
    assert problem in caught.value.found


def test_numbers_that_do_not_rise_are_found_in_the_file(tmp_path):
    (tmp_path / "table.csv").write_text("word,time_ms\n'a',0\n\nbb,2\nccc,2\n")
    table = read_numbers(tmp_path / "table.csv", {"time": TIME})
    assert np.array_equal(table.values, [[0.0], [2e-3], [2e-3]])
    with pytest.raises(InputError, match=r"\btime 0\.002 s\b") as caught:
        table.check_rising("time", "s")
    assert (caught.value.line, caught.value.column) == (5, 5)


def test_a_head_is_a_name_and_perhaps_a_unit():
    names = ["x", "inertia_xx", "speed", "x[0]"]
    for head, expected in {
        "x": ("x", ""),
        "x[0]": ("x[0]", ""),
        "x[1]": ("", ""),
        "inertia_xx_kg_m2": ("inertia_xx", "kg m2"),
        "speed_mps": ("speed", "m/s"),
        "speed (ft/s)": ("speed", "ft/s"),
        "speed_error": ("", ""),
    }.items():
        assert read_head(head, names) == expected


NUMBERS = [
    np.array([1.5, np.nan, -0.0]),
    np.arange(4),
    np.array([1.5, 2.5], np.float32),
    np.empty(0),
    np.eye(3)[:, 1],
]


@pytest.mark.parametrize(
    "values", NUMBERS, ids=["floats", "integers", "singles", "empty", "strided"]
)
def test_numbers_become_a_column_and_come_back(values):
    column = number_column(values)
    column.validate(full=True)
    assert column.type == pa.array(values).type
    for chunks in ([], [column], [column, column.slice(1, 1)]):
        chunked = pa.chunked_array(chunks, column.type)
        restored = column_values(chunked)
        assert restored.dtype == values.dtype
        assert np.array_equal(restored, chunked.to_numpy(), equal_nan=values.dtype.kind == "f")
    assert np.array_equal(
        column_values(pa.chunked_array([pa.array([1.5, None]), [2.0]])), [1.5, np.nan, 2.0], True
    )


@pytest.mark.parametrize("texts", [["ok", "", "ground", "ok"], ["größer", "α"], []])
def test_texts_become_a_column_and_come_back(texts):
    column = text_column(texts)
    column.validate(full=True)
    assert column.equals(pa.array(texts, pa.string()))
    names, which = distinct_texts(pa.chunked_array([column]))
    assert [names[i] for i in which] == texts and names == sorted(set(texts))


def test_the_memory_of_arrow_does_not_belong_to_python():
    content = bytes(range(256))
    references = sys.getrefcount(content)
    buffer = arrow_memory(content)
    assert buffer.to_pybytes() == content
    assert sys.getrefcount(content) == references


def test_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a/b.txt"
    with atomic_write(path, durable=True) as temporary:
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with pytest.raises(TypeError), atomic_write(path) as temporary:
        temporary.write_text(3)
    assert path.read_text() == "new" and list(path.parent.iterdir()) == [path]
