"""report.json is what its schema says."""

import copy

import pytest
from jsonschema import Draft202012Validator

from abhv_mc.report.numbers.report_numbers import make_numbers, report_schema
from abhv_mc.topics.topic import Models


@pytest.fixture(scope="module")
def validator():
    schema = report_schema()
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def test_a_report_is_valid_and_one_with_a_wrong_number_is_not(validator, failing):
    numbers = make_numbers(Models(failing))
    assert list(validator.iter_errors(numbers)) == []
    for path, value in (
        (("verdicts", "requirements", 0, "controllers", "tlc", "failures"), "none"),
        (("comparison", "pairs", "tlc - lqr", "pairs"), 1.5),
        (("flights", "counts", "lqr", "more"), 1),
    ):
        wrong = copy.deepcopy(numbers)
        place = wrong
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        assert not validator.is_valid(wrong), path
