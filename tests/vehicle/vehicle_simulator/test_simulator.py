"""Choice between threads and worker processes."""

import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.executor import find_isolation


@pytest.mark.parametrize(
    ("entries", "isolation"),
    [
        ({"runs": "256"}, "threads"),
        ({"runs": "257", "execution": "{workers: 4}"}, "threads"),
        ({"runs": "257", "execution": "{workers: 5}"}, "processes"),
        ({"runs": "256", "execution": "{flight_time_limit: 1 s}"}, "processes"),
        ({"runs": "256", "channels": "channels.py"}, "processes"),
        ({"runs": "256", "execution": "{isolation: processes}"}, "processes"),
    ],
)
def test_few_flights_or_workers_without_custom_code_use_threads(tmp_path, entries, isolation):
    channels = "from abhv_mc.extend import channel\n\n\n@channel(unit='m')\n"
    channels += "def miss(actual, command):\n    return actual.altitude - command.altitude\n"
    (tmp_path / "channels.py").write_text(channels)
    campaign = read_campaign(write_campaign(tmp_path, **entries))
    assert find_isolation(campaign.simulator.engine, campaign.model.execution) == isolation
