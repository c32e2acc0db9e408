"""Tests of the page on published problems: its numbers are stored and can be reproduced."""

from types import SimpleNamespace

import openturns as ot
import pytest
from scipy.stats import norm

from benchmarks.others import page, reliability, rocketpy_table, sensitivity
from benchmarks.rare_coverage import estimate


@pytest.mark.parametrize("section", page.HEADS)
def test_the_tables_of_the_page_are_those_of_the_results(section):
    text = page.PAGES[section].read_text()
    table = text.partition(f"<!-- {section} -->\n")[2].partition(f"\n<!-- /{section} -->")[0]
    assert table == page.make_table(section, page.read_rows(section))


@pytest.mark.parametrize(("operator", "threshold"), [(ot.Less(), 0.0), (ot.Greater(), 4.0)])
def test_both_methods_respect_the_failing_side_of_a_problem(operator, threshold):
    strength = ot.RandomVector(ot.JointDistribution([ot.Normal(4.0, 1.0), ot.Normal(2.0, 1.0)]))
    output = ot.CompositeRandomVector(ot.SymbolicFunction(["r", "s"], ["r - s"]), strength)
    event = ot.ThresholdEvent(output, operator, threshold)
    truth = float(norm.sf(2.0 / 2.0**0.5))  # 2 below the mean of r - s, and 2 above it
    problem = SimpleNamespace(
        getEvent=lambda: event, getName=lambda: "R-S", getProbability=lambda: truth
    )
    for answer in (
        estimate(reliability.make_case(problem), 1),
        reliability.sample_subsets(problem, 1),
    ):
        assert answer.probability == pytest.approx(truth, rel=0.15)
        assert answer.low < answer.probability < answer.high


def test_indices_of_the_test_functions_are_reproduced():
    stored = page.read_rows("sensitivity")
    for row, before in zip(sensitivity.study(3, 2000), stored, strict=True):
        assert row["published"] == before["published"]
        assert row["of_ranks"] == pytest.approx(before["of_ranks"], abs=1e-9)
        assert row["ours_total"][0] == pytest.approx(before["of_ranks"][1], abs=0.06)
        assert (row["named"][0] == 3) == (before["named"][0] == 20)


def test_the_imported_table_reproduces_the_stored_numbers():
    stored = page.read_rows("rocketpy")
    assert rocketpy_table.adopt() == stored
    for row in stored:
        for share, (value, low, high) in row["ours"].items():
            theirs, *ends = row["theirs"][share]
            assert value == pytest.approx(theirs, rel=1e-9)
            assert (low, high) == pytest.approx(ends, rel=0.005)  # bootstrapped
        most = max(row["theirs"]["variance"], key=row["theirs"]["variance"].get)
        assert row["drivers"][0] == most
