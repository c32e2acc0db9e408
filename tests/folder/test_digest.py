"""The digest: blind to how rows came, sharp to every bit of what they hold."""

import numpy as np

from abhv_mc.folder.digest import Digest, digest_rows

PINNED = "9ded2633bb5c1b63ebc72da123c64739e0929e640e665c1945754b5a797da0b3"
FLIGHTS = np.arange(50)
OUTCOME = tuple("ok" if i % 7 else "sideslip_limit" for i in range(50))
COLUMNS = dict(zip("bac", np.random.default_rng(0).normal(size=(3, 50)), strict=True))


def digest(rows=slice(None), controller="tlc", flights=FLIGHTS, outcome=OUTCOME, columns=COLUMNS):
    ends = tuple(np.array(outcome)[rows].tolist())
    return digest_rows(controller, flights[rows], ends, {name: value[rows] for name, value in columns.items()})


def test_neither_the_order_of_rows_nor_that_of_columns_counts_and_not_a_number_has_one_pattern():
    parts = [digest(slice(a, b)) for a, b in ((30, 50), (0, 1), (1, 30))]
    assert sum(parts, Digest()) == digest() == digest(columns=dict(sorted(COLUMNS.items())))
    assert digest(outcome=("failed_to_run", *OUTCOME[1:])) == digest(slice(1, None))
    signs = [COLUMNS | {"a": np.where(FLIGHTS == 3, sign * np.nan, COLUMNS["a"])} for sign in (1, -1)]
    assert digest(columns=signs[0]) == digest(columns=signs[1])


def test_every_bit_counts():
    values = COLUMNS["a"].copy()
    values[17] = np.nextafter(values[17], 9.0)
    changes = (
        {"columns": COLUMNS | {"a": values}},
        {"controller": "lqr"},
        {"flights": FLIGHTS + 1},
        {"outcome": ("ok",) * 50},
        {"columns": {"z" if name == "c" else name: value for name, value in COLUMNS.items()}},
        {"columns": COLUMNS | {"a": COLUMNS["b"], "b": COLUMNS["a"]}},
    )
    assert len({digest(), *(digest(**change) for change in changes)}) == 7


def test_pinned():
    """A change here would make digests of stored campaigns meaningless."""
    found = digest_rows("tlc", np.array([3]), ("ok",), {"aero.lift": np.array([1.0]), "x_m": np.array([2.5])})
    assert str(found) == PINNED
