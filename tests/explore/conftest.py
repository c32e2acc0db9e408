"""A campaign of fake flights behind the explorer's server."""

import threading

import pytest
from fake_flight import ENGINE, run, write_campaign

from abhv_mc.explore.counts import open_flights
from abhv_mc.explore.server import ExploreServer


@pytest.fixture(scope="package")
def server(tmp_path_factory):
    """100 flights of two controllers, served until the end."""
    folder = tmp_path_factory.mktemp("explore")
    run(write_campaign(folder / "f"), folder / "out", runs=100, workers=1)
    with open_flights(folder / "out") as table, ExploreServer(folder / "out", table, ENGINE) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()
