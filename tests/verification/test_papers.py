"""The papers' numbers are met, and a tolerance that is missed, or what is no number, is seen."""

from dataclasses import replace

from verification.shown import check

from abhv_mc.topics.plain import plain
from abhv_mc.verification.check_rows import Row, all_ok, rows_record
from abhv_mc.verification.everything import verify_paper


def test_the_papers_numbers() -> None:
    scaled = verify_paper(1e-4)
    assert not any(row.ok for row in scaled)
    check([replace(row, tolerance=1e4 * row.tolerance) for row in scaled])


def test_a_row_that_is_no_number_is_not_ok() -> None:
    good, bad = Row("a", "b", "c", "m", 1.0, 1.0), Row("a", "b", "d", "m", float("nan"), 1.0)
    assert good.ok and not bad.ok and not all_ok([])
    record = plain(rows_record([good, bad]))
    assert record["ok"] is False and record["rows"][1]["difference"] is None
