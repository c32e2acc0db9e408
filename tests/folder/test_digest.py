"""The digest: blind to how rows came, sharp to every bit of what they hold."""

import numpy as np

from abhv_mc.folder.digest import Digest, digest_rows

PINNED = "9ded2633bb5c1b63ebc72da123c64739e0929e640e665c1945754b5a797da0b3"
FLIGHTS = np.arange(50)
OUTCOME = tuple("ok" if i % 7 else "sideslip_limit" for i in range(50))


def columns():
    random = np.random.default_rng(0)
    return {name: random.normal(size=50) for name in ("b", "a", "c")}


def digest(rows=slice(None), **changes):
    values = {**columns(), **changes}
    outcome = tuple(np.array(OUTCOME)[rows].tolist())
    return digest_rows("tlc", FLIGHTS[rows], outcome, {name: value[rows] for name, value in values.items()})


def test_parts_add_up_in_any_order():
    parts = [digest(slice(a, b)) for a, b in ((30, 50), (0, 1), (1, 30))]
    assert sum(parts, Digest()) == digest()


def test_column_order_does_not_matter():
    reordered = dict(sorted(columns().items()))
    assert digest_rows("tlc", FLIGHTS, OUTCOME, reordered) == digest()


def test_every_bit_counts():
    values = columns()["a"].copy()
    values[17] = np.nextafter(values[17], 9.0)
    assert digest(a=values) != digest()
    assert digest_rows("lqr", FLIGHTS, OUTCOME, columns()) != digest()
    assert digest_rows("tlc", FLIGHTS + 1, OUTCOME, columns()) != digest()
    assert digest_rows("tlc", FLIGHTS, ("ok",) * 50, columns()) != digest()
    renamed = {"z" if name == "c" else name: value for name, value in columns().items()}
    assert digest_rows("tlc", FLIGHTS, OUTCOME, renamed) != digest()
    swapped = {**columns(), "a": columns()["b"], "b": columns()["a"]}
    assert digest_rows("tlc", FLIGHTS, OUTCOME, swapped) != digest()


def test_failed_to_run_is_left_out_and_nan_has_one_pattern():
    outcome = ("failed_to_run", *OUTCOME[1:])
    assert digest_rows("tlc", FLIGHTS, outcome, columns()) == digest(slice(1, None))
    one, two = columns()["a"], columns()["a"]
    one[3] = np.nan
    two[3] = -np.nan
    assert digest(a=one) == digest(a=two)


def test_pinned():
    """A change here would make digests of stored campaigns meaningless."""
    found = digest_rows("tlc", np.array([3]), ("ok",), {"aero.lift": np.array([1.0]), "x_m": np.array([2.5])})
    assert str(found) == PINNED
