"""Tests of the sentences on flights of a search."""

import re

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.pages.searched_flights import limit_sentence
from abhv_mc.shipped import find_input


def test_an_early_termination_is_not_a_value_inside_the_limit():
    campaign = read_campaign(find_input("s_manoeuvre", "campaign"))
    requirement = campaign.requirements[0]  # below 50 m
    metric = campaign.metrics[requirement.metric]
    inside, beyond, early = (
        limit_sentence(requirement, metric, worst, failures, 100)
        for worst, failures in ((45.0, 0), (55.0, 3), (45.0, 3))
    )
    assert re.search(r"\b10\s% below\b", inside) and re.search(r"\b10\s% above\b", beyond)
    assert not re.search(r"\b10\s%|below the|above", early)
