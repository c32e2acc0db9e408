"""Rows of the proof: what is no number is not ok, and the JSON says so."""

from abhv_mc.topics.plain import plain
from abhv_mc.verification.check_rows import Row, all_ok, rows_record


def test_a_row_that_is_no_number_is_not_ok():
    good, bad = Row("a", "b", "c", "m", 1.0, 1.0), Row("a", "b", "d", "m", float("nan"), 1.0)
    assert good.ok
    assert not bad.ok
    assert not all_ok([])
    record = plain(rows_record([good, bad]))
    assert record["ok"] is False and record["rows"][1]["difference"] is None
