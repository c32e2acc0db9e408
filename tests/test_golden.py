"""Small reports of all kinds of campaigns have the stored numbers."""

from itertools import islice

import pytest
from golden import CASES, QUICK, STORED, compare_report


@pytest.mark.parametrize("case", CASES)
def test_every_number_of_a_report_is_the_stored_one(case, tmp_path):
    differences = compare_report(case, tmp_path)
    assert not differences, "\n".join((f"{len(differences)} in all", *islice(differences, 20)))


def test_every_stored_report_is_of_a_case():
    assert {path.name for path in STORED.iterdir()} == {
        f"{case}.json.gz" for case in (*CASES, *QUICK)
    }
