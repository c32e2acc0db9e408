"""Precompiled kernels in the wheel: choice of the level, and unpacking into an empty folder."""

import json
import re

import pytest

from abhv_mc_vehicle.kernel import cache as kernel_cache
from abhv_mc_vehicle.kernel.cache import LEVELS, choose_level, pack, unpack

V4, V3 = LEVELS
HERE = dict.fromkeys(V4.needed, True)


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """Folder with builds of both levels from a cache of three files."""
    cache, folder = tmp_path / "cache", tmp_path / "prebuilt"
    (cache / "module").mkdir(parents=True)
    folder.mkdir()
    for name in ("tried", "module/kernel.nbi", "module/kernel.lock"):
        (cache / name).write_text(name)
    monkeypatch.setattr(kernel_cache, "FOLDER", folder)
    for level in LEVELS:
        pack(level, cache, folder)
    return folder


def change(folder, level, **entries):
    (file,) = folder.glob(f"{level.cpu}*.json")
    file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def test_the_best_level_that_the_processor_has_is_chosen(wheel):
    assert choose_level(HERE)[0] == V4
    assert choose_level(HERE | {"avx512bw": False})[0] == V3
    level, reason = choose_level({"neon": True})
    assert level is None and re.search(r"\bavx\b", reason)


@pytest.mark.parametrize(
    "changes, named",
    [({"numba": "0.0"}, "numba 0.0"), ({"source": "another"}, "source"), ({"sha256": "0"}, ".zip")],
)
def test_an_unusable_build_is_rejected(wheel, changes, named):
    for level in LEVELS:
        change(wheel, level, **changes)
    level, reason = choose_level(HERE)
    assert level is None and named in reason


def test_a_build_is_unpacked_into_an_empty_folder_only(wheel, tmp_path):
    folder = tmp_path / "kernels"
    folder.mkdir()
    unpack(V3, folder)
    assert {file.name for file in folder.rglob("*") if file.is_file()} == {"tried", "kernel.nbi"}
    (folder / "module/kernel.nbi").write_text("a second overload")
    unpack(V3, folder)
    assert (folder / "module/kernel.nbi").read_text() == "a second overload"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "kernels", "prebuilt"]
