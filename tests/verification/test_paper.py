"""The papers' numbers are met, and a tolerance that is missed is seen."""

import pytest
from verification.shown import check

from abhv_mc.verification.paper import verify_paper


def test_the_papers_numbers() -> None:
    rows = verify_paper()
    check(rows)
    scaled = verify_paper(1e-4)
    assert not any(row.ok for row in scaled)
    assert [row.tolerance for row in scaled] == pytest.approx([1e-4 * row.tolerance for row in rows])
