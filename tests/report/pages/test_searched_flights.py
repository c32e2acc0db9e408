"""Tests of the sentences on flights of a search."""

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.pages.searched_flights import limit_sentence
from abhv_mc.shipped import find_input


def test_an_early_termination_is_not_a_value_inside_the_limit():
    campaign = read_campaign(find_input("s_manoeuvre", "campaign"))
    requirement = campaign.requirements[0]  # below 50 m
    metric = campaign.metrics[requirement.metric]
    assert limit_sentence(requirement, metric, 45.0, 0, 100).endswith("inside the limit.")
    assert limit_sentence(requirement, metric, 55.0, 3, 100).endswith("beyond the limit.")
    assert limit_sentence(requirement, metric, 45.0, 3, 100).endswith("the worst one ended early.")
