import numpy as np
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.probe_dispersions import make_trials

GUSTS = """{wind.gust_north: {distribution: normal, sigma: 5 m/s},
            wind.gust_start: {distribution: uniform, low: 5 s, high: 45 s}}"""


def test_a_gust_that_blows_either_way_blows_while_its_start_is_tried(tmp_path):
    """Its start was refused as one that changes no controller's flight: the gust stood at its median, nothing."""
    trials = make_trials(read_campaign(write_campaign(tmp_path, dispersions=GUSTS)))
    assert (trials[4:, 0] == trials[4, 0]).all()
    assert trials[4, 0] > 0.0
    assert np.array_equal(trials[5:, 1], [5.0, 45.0])
