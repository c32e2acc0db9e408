"""Values of a kind that nobody expects in their place: refused in place, not with a traceback."""

import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.control.controller_file import read_controller
from abhv_mc.io.documents import InputError

ENTRIES = {
    "a channel that is a mapping": ("keep", "{histories: {channels: [{a: 1}]}}"),
    "a channel that is a list": ("keep", "{envelopes: {channels: [[altitude_m]]}}"),
    "correlations that are no list": ("correlations", "true"),
    "a correlation that is no mapping": ("correlations", "[7]"),
    "requirements that are no list": ("requirements", "{a: 1}"),
    "a requirement that is a number": ("requirements", "[7]"),
    "controllers of a requirement": ("requirements", "[{metric: speed_error_max_mps, below: 1, controllers: 7}]"),
    "a metric of a number beyond all": ("metrics", f"{{m: {{of: '{'9' * 400}', statistic: max}}}}"),
    "a metric of a long sum": ("metrics", f"{{m: {{of: '{'+'.join('1' * 2000)}', statistic: max}}}}"),
    "a metric of an infinite number": ("metrics", "{m: {of: altitude_m + 1e400, statistic: max}}"),
    "a metric of a number of programmers": ("metrics", "{m: {of: altitude_m + 0x20, statistic: max}}"),
    "a metric of a number with a gap": ("metrics", "{m: {of: altitude_m + 1_000, statistic: max}}"),
    "a metric of many signs": ("metrics", f"{{m: {{of: '{'-' * 3000}1', statistic: max}}}}"),
    "a metric of more signs": ("metrics", f"{{m: {{of: '{'-' * 50_000}1', statistic: max}}}}"),
    "a character beyond all": ("question", '"\\UFFFFFFFF"'),
}


@pytest.mark.parametrize("case", ENTRIES)
def test_of_a_campaign(tmp_path, case):
    key, value = ENTRIES[case]
    with pytest.raises(InputError):
        read_campaign(write_campaign(tmp_path, **{key: value}), controllers=["one"])


@pytest.mark.parametrize("law", ["{}", "[tlc]", "null", "7", "2026-01-01"])
def test_of_a_controller(tmp_path, law):
    file = tmp_path / "law.yaml"
    file.write_text(f"law: {law}\n")
    with pytest.raises(InputError, match="law"):
        read_controller(file)
