import pytest

from benchmarks.kernels import parts, run
from benchmarks.spread import Spread, find_spreads

MACHINE = {"processor": "CPU", "simd": "AVX2", "cores": 2, "load_before": 0.25}


def make_parts(flight):
    """A process: every part takes 0.05 ms, divisions and roots 0.5 ms."""
    found = {}
    for law in parts.BOTH:
        found[law] = {name: 0.05 for name, (_, _, laws) in parts.PARTS.items() if law in laws}
        found[law] |= {"flight": flight, parts.SLOW: 0.5}
    return found


@pytest.fixture
def runs():
    return [make_parts(flight) for flight in (2.0, 4.0, 1.0)]


@pytest.fixture
def shares(runs):
    return {law: find_spreads([parts.find_shares(one[law]) for one in runs]) for law in parts.BOTH}


def test_parts_and_what_they_leave_make_up_the_flight(runs):
    shares = parts.find_shares(runs[0]["lqr"])
    assert shares.pop(parts.SLOW) == 0.25  # within the parts, not beside them
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares[parts.REST] == pytest.approx(1.0 - 11 * 0.05 / 2.0)


def test_the_table_of_parts_has_the_shares_of_each_process(shares):
    table = parts.make_table(MACHINE, 3, shares)
    assert "medians of 3 processes." in table
    assert "| actuators | 2.5 % | 1.2 to 5.0 % | 2.5 % | 1.2 to 5.0 % |" in table
    assert "| LQR |  |  | 2.5 % | 1.2 to 5.0 % |" in table
    assert f"| {parts.SLOW} | 25.0 % | 12.5 to 50.0 % |" in table
    assert table.count("\n|") == 2 + len(parts.PARTS) + 2


def test_the_record_of_parts_keeps_medians_and_ends(runs, shares):
    record = parts.make_record(MACHINE, runs, shares)
    assert record["tlc"]["flight"] == 2.0  # ms
    kept = [record[key]["tlc"][parts.SLOW] for key in ("lowest", "shares", "highest")]
    assert kept == [0.125, 0.25, 0.5]
    assert record["processes"] == 3


def test_the_kernels_have_median_and_ends():
    ratios = {"exp: libm / own": Spread(3.6204, 3.5, 3.75)}
    assert "| exp: libm / own | 3.62 | 3.50 to 3.75 |" in run.make_table(MACHINE, 3, ratios)
    record = run.make_record(MACHINE, 3, ratios)
    assert [record[key]["exp: libm / own"] for key in ("lowest", "ratios", "highest")] == [3.5, 3.62, 3.75]
