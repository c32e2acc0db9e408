"""Status of a results folder, and stores selected by addresses."""

from dataclasses import replace
from pathlib import Path

import pytest

from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import Manifest, write_manifest
from abhv_mc.folder.stores import LocalStore, open_store, read_status
from abhv_mc.io.messages import InputError


def test_a_running_campaign_without_lock_is_interrupted(tmp_path):
    root = tmp_path / "out"
    (root / "flights").mkdir(parents=True)
    (root / "flights/a").write_bytes(b"123")
    manifest, path = Manifest("n", "running", 5, "c", "s", runs_planned=9), root / "manifest.json"
    write_manifest(path, manifest)
    store, size = LocalStore(tmp_path), 3 + path.stat().st_size
    status = read_status(root, store, "out")
    assert (status.manifest, status.holder) == (replace(manifest, state="interrupted"), None)
    assert status.as_entries() == status.manifest.as_entries() | {
        "folder": str(root), "holder": None, "bytes": size
    }  # fmt: skip
    with hold_lock(root / ".lock"):
        status = read_status(root, store, "out")
    assert status.manifest == manifest and status.holder.startswith("process ")
    write_manifest(path, replace(manifest, state="complete"))
    assert read_status(root, store, "out").manifest.state == "complete"
    write_manifest(path, replace(manifest, search={"kind": "worst"}))
    with pytest.raises(InputError, match="search"):
        read_status(root, store, "out")


def test_paths_and_file_addresses_are_local_and_other_schemes_need_a_package(tmp_path):
    for path in (tmp_path, Path(f"file://{tmp_path}")):
        store = open_store(path)
        with store.reading() as folder, store.writing() as other:
            assert folder == other == tmp_path
    with pytest.raises(InputError, match="unknown scheme in 'ftp://a/b'"):
        open_store(Path("ftp://a/b"))
