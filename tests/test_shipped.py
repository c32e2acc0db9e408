"""The default files are found from a checkout, and come with the wheel."""

from pathlib import Path

import abhv_mc.shipped as found


def test_checkout(repository: Path) -> None:
    assert found.shipped_folder() == repository
