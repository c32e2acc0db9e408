"""Tests of the texts on flights of a search."""

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.pages.search_pages import margin_text
from abhv_mc.shipped import find_input


@pytest.mark.parametrize(
    ("worst", "margin"), [(45.0, "margin 10"), (55.0, "margin \N{MINUS SIGN}10")]
)
def test_the_margin_of_a_violated_limit_is_negative(worst, margin):
    campaign = read_campaign(find_input("s_manoeuvre", "campaign"))
    requirement = campaign.requirements[0]  # below 50 m
    text = margin_text(requirement, campaign.metrics[requirement.metric], worst)
    assert margin in text and "50" in text
