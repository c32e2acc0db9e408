import numpy as np
import pytest

from abhv_mc.search.methods.subset import SubsetPlan, run_subset


def first(points):
    return points[:, 0]


def test_the_same_whatever_runs_beside_it():
    plan = SubsetPlan(3, 3.0, 7)
    together = run_subset(first, plan, range(4), 100_000)
    alone = run_subset(first, plan, range(2, 3), 100_000)[0]
    np.testing.assert_array_equal(together[2].points, alone.points)
    assert together[2].levels == alone.levels


def test_batches_fill_lanes_and_flights_are_counted():
    sizes = []

    def counted(points):
        sizes.append(len(points))
        return points[:, 0]

    repetitions = run_subset(counted, SubsetPlan(3, 4.0, 1), range(4), 100_000)
    assert all(size % 32 == 0 for size in sizes)
    assert sum(sizes) == sum(one.flights for one in repetitions)


def test_chains_keep_the_conditional_law():
    """Beyond a level, the coordinates that the severity leaves out stay standard normal."""
    repetitions = run_subset(first, SubsetPlan(3, 3.5, 3, chains=512), range(4), 10**6)
    others = np.concatenate([one.points[:, 1:] for one in repetitions])
    assert others.mean() == pytest.approx(0.0, abs=0.05)
    assert others.std() == pytest.approx(1.0, abs=0.05)


def test_acceptance_is_kept_near_its_optimum():
    repetitions = run_subset(lambda u: u.sum(axis=1), SubsetPlan(30, 20.0, 3), range(4), 10**6)
    rates = [level.acceptance for one in repetitions for level in one.levels[1:]]
    assert 0.3 < np.mean(rates) < 0.6


def test_a_plateau_is_not_climbed():
    """Half of the points share the greatest severity: no level can be closed in on the event."""
    (one,) = run_subset(lambda u: np.minimum(u[:, 0], 0.0), SubsetPlan(2, 1.0, 0), range(1), 100_000)
    assert not one.reached and one.probability == 0.0


def test_flights_that_do_not_suffice_drop_the_last_repetitions():
    plan = SubsetPlan(2, 4.5, 0)
    kept = run_subset(first, plan, range(6), 6 * 640 + 6 * 4 * 576 + 3 * 576)
    assert [one.number for one in kept] == list(range(len(kept)))
    assert 0 < len(kept) < 6
    full = run_subset(first, plan, range(6), 10**6)
    assert [one.probability for one in kept] == [one.probability for one in full[: len(kept)]]


def test_where_too_few_would_be_left_all_end_as_cut_short():
    kept = run_subset(first, SubsetPlan(2, 4.5, 0), range(6), 6 * 640 + 6 * 2 * 576 + 3 * 576, fewest=4)
    assert len(kept) == 4
    assert all(one.cut_short and not one.reached for one in kept)
