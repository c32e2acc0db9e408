"""Synthetic campaigns for reports, each made once."""

from functools import cache

import pytest
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown


@pytest.fixture(scope="session")
def flown(tmp_path_factory):
    """Return a function that gives results of ``runs`` flights of three controllers."""
    return cache(
        lambda runs: read_flown(write_campaign(tmp_path_factory.mktemp("topics") / "c", runs=runs))
    )
