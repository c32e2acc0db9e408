"""Small reports of all kinds of campaigns have the stored numbers."""

import copy
from itertools import islice

import pytest
from golden import CASES, STORED, compare_report, find_differences


@pytest.mark.parametrize("case", CASES)
def test_every_number_of_a_report_is_the_stored_one(case, tmp_path):
    differences = compare_report(case, tmp_path)
    assert not differences, "\n".join((f"{len(differences)} in all", *islice(differences, 20)))


def test_every_stored_report_is_of_a_case():
    assert {path.name for path in STORED.iterdir()} == {f"{case}.json.gz" for case in CASES}


def test_a_moved_number_and_a_lost_one_are_named():
    stored = {"a": [1.0, {"b": 2.0, "c": "PASS"}], "d": None, "e": 0.0}
    differences = copy.deepcopy(stored)
    differences["a"][0] *= 1.0 + 1e-10
    differences["new"] = 1
    differences["e"] = 1e-12
    assert not list(find_differences(stored, differences))
    differences["a"][1] |= {"b": 2.0 + 1e-6, "c": "FAIL"}
    del differences["d"]
    paths = [text.partition(":")[0] for text in find_differences(stored, differences)]
    assert paths == ["/a/1/b", "/a/1/c", "/d"]
