"""Worker processes find the fake flight as this one does, and start from a server that has imported it."""

import multiprocessing
import os
from multiprocessing import forkserver
from pathlib import Path

import pytest

os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")]))


@pytest.fixture(scope="session", autouse=True)
def _server():
    """One server for all engines: the first would know its own alone, and each worker of another import for seconds."""
    modules = [
        "campaign.fake_flight",
        "abhv_mc.campaign.run.worker",
        "abhv_mc.campaign.run.runner",
        "abhv_mc.flight.fly",
    ]
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*modules, "scipy.stats", "joblib"])
    forkserver.ensure_running()
