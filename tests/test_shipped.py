"""The default files are found from a checkout, and come with the wheel."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import abhv_mc.shipped as found


def test_checkout(repository: Path) -> None:
    assert found.shipped_folder() == repository


def test_wheel(repository: Path, tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=repository, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    files = [path for name in ("configs", "campaigns") for path in (repository / name).rglob("*") if path.is_file()]
    assert files
    for path in files:
        assert (site / "abhv_mc/shipped_files" / path.relative_to(repository)).read_bytes() == path.read_bytes()
    code = "from abhv_mc.shipped import shipped_folder; print(shipped_folder())"
    answer = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(site)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert answer.stdout.strip() == str(site / "abhv_mc" / "shipped_files")
