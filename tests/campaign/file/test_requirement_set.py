"""Requirements set after the results are those whose choice may raise the risk."""

import pytest

from abhv_mc.campaign.file.requirement_set import find_later_choices

ENTRY = {"metric": "miss", "probability": 0.9, "consumer_risk": 0.1}


@pytest.mark.parametrize(
    ("first", "current", "is_later"),
    [
        ({"below": 5.0}, {"below": 4.0}, False),
        ({"above": -5.0}, {"above": -4.0}, False),
        ({"below": 5.0, "above": -5.0}, {"below": 5.0, "above": -5.0}, False),
        ({"below": 5.0, "above": -5.0}, {"below": 6.0, "above": -4.0}, True),
        ({"below": 5.0}, {"below": 5.0, "above": -5.0}, True),
    ],
)
def test_only_one_sided_limits_may_change_without_a_note(first, current, is_later):
    sets = [{"requirements": [{**ENTRY, **entry}]} for entry in (first, current)]
    later = find_later_choices(sets[:1], sets[1], ["a"])
    assert later == (frozenset({(0, "a")}) if is_later else frozenset())
