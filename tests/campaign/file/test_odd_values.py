"""Values of a kind that nobody expects in their place: refused in place, not with a traceback."""

import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.control.controller_file import read_controller
from abhv_mc.io.documents import InputError

ENTRIES = {
    "a channel that is a mapping": ("keep", "{histories: {channels: [{a: 1}]}}"),
    "a correlation that is no mapping": ("correlations", "[7]"),
    "a requirement that is a number": ("requirements", "[7]"),
    "controllers of a requirement": ("requirements", "[{metric: speed_error_max_mps, below: 1, controllers: 7}]"),
    "a metric of a number beyond all": ("metrics", f"{{m: {{of: '{'9' * 400}', statistic: max}}}}"),
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
