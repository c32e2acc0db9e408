from benchmarks.limit import GOALS, make_rows


def make_run(factor):
    of_controllers = ("flights_per_second_per_core", "one_at_a_time_ms", "batched_over_one")
    of_controllers += ("flops_per_flight", "times_the_floor")
    one = {name: factor * (4e7 if name == "flops_per_flight" else 2.0) for name in of_controllers}
    figures = {name: factor for name in GOALS if name not in of_controllers}
    return {**figures, "controllers": {"tlc": one, "lqr": one}}


def test_every_figure_has_its_row_with_median_and_ends():
    rows = make_rows([make_run(1.0), make_run(3.0), make_run(1.5)])
    assert "| peak of a core, GFLOP/s | 1.5 | 1 to 3 |  |" in rows
    assert "| ms a flight, one at a time, LQR | 3 | 2 to 6 |  |" in rows
    assert "| operations a flight, TLC | 60,000,000 | 40,000,000 to 120,000,000 |  |" in rows
    assert len(rows) == len(GOALS) + 5


def test_a_goal_of_tlc_is_none_of_lqr():
    rows = [row for row in make_rows([make_run(1.0)]) if row.startswith("| flights per second and core")]
    assert ["700" in row for row in rows] == [True, False]
