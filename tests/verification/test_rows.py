"""Rows of the proof: what is no number is not ok, and the JSON says so."""

from abhv_mc.verification.rows import Row, all_ok, write_rows


def test_a_row_that_is_no_number_is_not_ok(tmp_path):
    good, bad = Row("a", "b", "c", "m", 1.0, 1.0), Row("a", "b", "d", "m", float("nan"), 1.0)
    assert good.ok
    assert not bad.ok
    assert not all_ok([])
    write_rows(tmp_path / "rows.json", [good, bad])
    assert '"ok": false' in (tmp_path / "rows.json").read_text().splitlines()[1]
    assert '"difference": null' in (tmp_path / "rows.json").read_text()
