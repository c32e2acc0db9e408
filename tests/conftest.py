"""What every test relies on."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"  # figures without a display
# The matrices here are small, and workers share the cores: threads that wait for each other took half of the time.
# Linear algebra reads it when numpy is loaded, which nothing has done yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in each run: a suite that fails now and then teaches people to run it again.
settings.register_profile("repeatable", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def repository() -> Path:
    """The checkout's root."""
    return Path(__file__).parents[1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What compiles everything anew for minutes comes first: at the end, the other workers would wait for it."""
    items.sort(key=lambda item: item.path.name not in ("test_public_numba.py", "test_wheel.py"))
