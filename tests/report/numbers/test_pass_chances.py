"""Plans of campaigns: chances of a PASS."""

import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.numbers.pass_chances import plan_campaign


@pytest.mark.parametrize(("family", "risk"), [("", 0.1), ("{risk: 12 %}", 0.03)])
def test_each_verdict_is_planned_with_its_share_of_the_joint_risk(tmp_path, family, risk):
    entry = "metric: altitude_error_max_m, below: 50, probability: 0.9, consumer_risk: 0.1"
    keys = {"family": family} if family else {}
    requirements = f"[{{{entry}}}, {{{entry.replace('50', '40')}}}]"
    campaign = write_campaign(tmp_path, requirements=requirements, **keys)
    planned = plan_campaign(read_campaign(campaign))
    assert [item.risk_used for item in planned.requirements] == pytest.approx([risk, risk])
