"""Tables of differences and tolerances that the documentation quotes.

``pytest -s`` prints them.
"""

from collections.abc import Sequence

from benchmarks.verification.check_rows import Row


def check(rows: Sequence[Row]) -> None:
    """Print every row; fail where there is none, or where one is outside its tolerance."""
    print()
    for row in rows:
        line = (
            f"{row.case} | {row.simulator} | {row.quantity} | {row.difference:.1e} "
            f"({row.tolerance:.1g}) {row.unit}"
        )
        print(line if row.ok else f"{line}  OUTSIDE")
    assert rows
    assert [row for row in rows if not row.ok] == []
