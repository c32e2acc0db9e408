"""Who flies in a folder: the holder of its lock; at an address, of a lease by the store's clock."""

import fcntl
import threading
from datetime import UTC, datetime, timedelta

import pytest

from abhv_mc.folder import lease as module
from abhv_mc.folder.lease import LEASE, NAME, Lease, read_holder
from abhv_mc.folder.lock import hold_lock, lock_holder
from abhv_mc.folder.remote import Remote
from abhv_mc.io.input_error import InputError


class FakeStore:
    """Objects in memory, dated by a clock that stands still until it is moved."""

    def __init__(self):
        self.address, self.objects, self.now = "s3://bucket/first", {}, datetime(2030, 1, 1, tzinfo=UTC)

    def read(self, name):
        if name not in self.objects:
            raise FileNotFoundError(name)
        return self.objects[name][0]

    def write(self, name, content):
        self.objects[name] = content, self.now

    def delete(self, name):
        self.objects.pop(name, None)

    def ages(self, *names):
        return [self.objects[name][1] if name in self.objects else None for name in names]

    def wait(self, seconds):
        self.now += timedelta(seconds=seconds)


@pytest.fixture
def store(monkeypatch):
    monkeypatch.setattr(module, "_SETTLE", 0.0)
    return FakeStore()


def take(store):
    lease = Lease(store)
    lease.take()
    return lease


def test_a_lease_holds_while_it_is_renewed_and_until_it_is_dropped(store):
    first = take(store)
    for _ in range(3):
        store.wait(0.9 * LEASE)
        first.renew()
        with pytest.raises(InputError, match="is flying"):
            take(store)
    assert list(store.objects) == [NAME]  # nothing is left of those who asked
    first.drop()
    assert read_holder(store) is None
    take(store).drop()


def test_a_lease_that_nobody_renews_is_taken_over_and_its_loser_writes_nothing_more(store, tmp_path):
    first = take(store)
    store.wait(1.1 * LEASE)
    second = take(store)
    held = dict(store.objects)
    with pytest.raises(InputError, match="is flying"):
        first.renew()
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="is flying"):
        Remote(store, tmp_path, first).push()
    first.drop()
    assert store.objects == held
    second.renew()
    second.drop()


def test_of_two_that_find_none_the_later_writer_has_it(store, monkeypatch):
    other = Lease(store)
    monkeypatch.setattr(module.time, "sleep", lambda _: other._write())
    with pytest.raises(InputError, match="is flying"):
        take(store)


@pytest.mark.parametrize("content", [b"", b"{}", b"\xff", b"[1]"])
def test_an_object_that_is_no_lease_is_somebodys(store, content):
    store.write(NAME, content)
    with pytest.raises(InputError, match="another process is flying"):
        take(store)


def test_the_holder_is_named(tmp_path):
    with hold_lock(tmp_path / ".lock"):
        assert "process" in lock_holder(tmp_path / ".lock")
        with pytest.raises(InputError, match=r"process .* is flying"), hold_lock(tmp_path / ".lock"):
            pass
    assert lock_holder(tmp_path / ".lock") is None


def test_a_look_at_the_lock_keeps_nobody_from_taking_it(tmp_path):
    """`status` or `list` at the moment of a start made `run` refuse a folder in which nobody flew."""
    (tmp_path / ".lock").touch()
    look = (tmp_path / ".lock").open()
    fcntl.flock(look, fcntl.LOCK_SH)
    threading.Timer(0.1, look.close).start()
    with hold_lock(tmp_path / ".lock"):
        assert look.closed
