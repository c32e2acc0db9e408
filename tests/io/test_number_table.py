"""Numbers from CSV files: read as they stand, and every mistake with its place."""

import numpy as np
import pytest

from abhv_mc.io.input_error import InputError
from abhv_mc.io.number_table import read_number_table


@pytest.fixture
def write(tmp_path):
    def write_text(text):
        path = tmp_path / "table.csv"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write_text


def test_columns_come_in_the_order_asked_for_and_empty_rows_are_left_out(write):
    table = read_number_table(write("\ufeffa, b,note\n1,2,x\n\n3,-4e1,y\n"), {"b": 50.0, "a": 5.0})
    assert table.values.tolist() == [[2.0, 1.0], [-40.0, 3.0]]
    assert table.lines == (2, 4)


def test_all_columns_without_a_wish(write):
    table = read_number_table(write("a,b\n1,2\n"))
    assert table.names == ("a", "b")
    np.testing.assert_array_equal(table.values, [[1.0, 2.0]])


@pytest.mark.parametrize(
    ("text", "wanted", "place", "found"),
    [
        ("a,c\n1,2\n", ("a", "b"), (1, 1), "no column b"),
        ("a,a\n1,2\n", ("a",), (1, None), "the column a twice"),
        ("a,b\n1,2\n1,x y\n", ("a", "b"), (3, 3), "'x y'"),
        ("a,b\n1,-101\n", ("b",), (2, 3), "'-101'"),
        ("a,b\n1,nan\n", ("b",), (2, 3), "'nan'"),
        ("a,b\n1,2,3\n", None, (2, None), "3 cells"),
        ("", ("a",), (1, 1), "no column a"),
        (b"a\n\xff\n", ("a",), (None, None), "utf-8"),
    ],
)
def test_a_mistake_is_said_with_its_place(write, text, wanted, place, found):
    with pytest.raises(InputError) as caught:
        read_number_table(write(text), wanted and dict.fromkeys(wanted, 100.0))
    assert (caught.value.line, caught.value.column) == place
    assert found in caught.value.found


def test_numbers_that_do_not_rise_are_found_in_the_file(write):
    table = read_number_table(write("word,time_s\n'a',0\n\nbb,2\nccc,2\n"), {"time_s": 10.0})
    with pytest.raises(InputError, match=r"the time 2 s; expected times that rise") as caught:
        table.check_rising("time_s", "s")
    assert (caught.value.line, caught.value.column) == (5, 5)
