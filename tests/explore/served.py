"""A campaign of fake flights behind the explorer's server."""

import contextlib
import threading

import pytest
from fake_flight import ENGINE, write_campaign

import abhv_mc
from abhv_mc.explore.counts import open_flights
from abhv_mc.explore.server import ExploreServer


@contextlib.contextmanager
def serve(folder):
    """100 flights of two controllers, served until the end."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("abhv_mc.execution.runner.make_engine", lambda: ENGINE)
        abhv_mc.Campaign.read(write_campaign(folder / "f")).run(output=folder / "out", runs=100, workers=1)
    with open_flights(folder / "out") as table, ExploreServer(folder / "out", table, ENGINE) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()
