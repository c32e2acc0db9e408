"""Tests of a folder's lock: one holder, also without flock, and removal of empty folders."""

import errno
import fcntl
import json
import os
import platform
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from abhv_mc.folder import lock as module
from abhv_mc.folder.layout import write_text
from abhv_mc.folder.lock import hold_lock, lock_holder
from abhv_mc.io.messages import InputError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / "folder" / ".lock"


@pytest.fixture(params=["flock", "ENOSYS", "EOPNOTSUPP", "ENOLCK"])
def file_system(request, monkeypatch):
    """Select a file system with locks, or one whose `flock` raises an error."""
    if request.param != "flock":
        refuse_locks(monkeypatch, getattr(errno, request.param))


def refuse_locks(monkeypatch, number=errno.ENOSYS):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)


def write_lease(path, host, process, start):
    lease = path.with_name(".lock.lease")
    lease.parent.mkdir(parents=True, exist_ok=True)
    lease.write_text(json.dumps([host, process, start, "0", module._namespace()]))
    return lease


@pytest.mark.usefixtures("file_system")
def test_one_process_holds_a_folder_and_is_named(path):
    with hold_lock(path):
        assert lock_holder(path) == f"process {os.getpid()} on {platform.node()}"
        with (
            pytest.raises(InputError, match=f"process {os.getpid()} on"),
            hold_lock(path),
        ):
            pass
        (path.parent / "file").touch()
    assert lock_holder(path) is None
    with hold_lock(path):
        pass
    assert path.parent.exists()


@pytest.mark.usefixtures("file_system")
def test_a_folder_that_stays_empty_is_removed(path):
    with hold_lock(path):
        assert path.exists()
    assert not path.parent.parent.exists()
    path.parent.mkdir(parents=True)
    with hold_lock(path):
        pass
    assert not any(path.parent.iterdir())


def test_a_lock_on_a_deleted_lock_file_is_not_accepted(path, monkeypatch):
    """Waiting processes have the deleted file open, and a lock on it excludes no other process."""
    flock, deleted = fcntl.flock, []

    def flock_after_deletion(descriptor, how):
        if not deleted:
            deleted.append(os.fstat(descriptor).st_ino)
            path.unlink()
        flock(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", flock_after_deletion)
    with hold_lock(path), pytest.raises(InputError, match=f"{os.getpid()}"), hold_lock(path):
        pass


def test_other_errors_of_the_file_system_are_input_errors(path, monkeypatch):
    refuse_locks(monkeypatch, errno.EROFS)
    with pytest.raises(InputError, match="Read-only"), hold_lock(path):
        pass


def test_a_test_of_the_lock_does_not_prevent_taking_it(tmp_path):
    """`runs` during the start of `run` made it reject a free folder."""
    (tmp_path / ".lock").touch()
    look = (tmp_path / ".lock").open()
    fcntl.flock(look, fcntl.LOCK_SH)
    threading.Timer(0.1, look.close).start()
    with hold_lock(tmp_path / ".lock"):
        assert look.closed


@pytest.mark.parametrize("kill", ["reaped", "zombie", "another start"])
def test_the_lease_of_a_process_of_this_host_that_died_is_taken_over(path, monkeypatch, kill):
    refuse_locks(monkeypatch)
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    start = module._start_of(process.pid)
    write_lease(path, platform.node(), process.pid, "0" if kill == "another start" else start)
    path.touch()
    if kill != "another start":
        assert lock_holder(path) == f"process {process.pid} on {platform.node()}"
        with pytest.raises(InputError, match=f"process {process.pid} on"), hold_lock(path):
            pass
        process.kill()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        if kill == "reaped":
            process.wait()
    assert lock_holder(path) is None
    with hold_lock(path):
        assert lock_holder(path) == f"process {os.getpid()} on {platform.node()}"
    assert not path.with_name(".lock.lease").exists()
    process.kill()
    process.communicate()


@pytest.mark.parametrize(("own", "other"), [("boot pid:[1]", "boot pid:[2]"), ("", "")])
def test_only_the_same_namespace_declares_a_holder_dead(path, monkeypatch, own, other):
    """Process numbers of other containers and before a restart mean nothing here."""
    refuse_locks(monkeypatch)
    monkeypatch.setattr(module, "_namespace", lambda: other)
    lease = write_lease(path, platform.node(), 2**22 + 1, "1")
    path.touch()
    monkeypatch.setattr(module, "_namespace", lambda: own)
    assert lock_holder(path) == f"process {2**22 + 1} on {platform.node()}"
    with pytest.raises(InputError) as refused, hold_lock(path):
        pass
    assert f"rm '{lease}'" in str(refused.value)


def test_a_process_of_another_proc_is_not_looked_up_there(monkeypatch):
    """As in a container that sees the /proc of its host."""
    monkeypatch.setattr(os, "getpid", lambda: 2**22 + 1)
    assert module._start_of(os.getppid()) == "" and module._start_of(2**22 + 1) is None
    assert module._namespace().endswith(str(Path("/proc/self/ns/pid").readlink()))


@pytest.mark.parametrize("text", [None, '["other", 1, "1", "0", ""]'])
def test_a_holder_without_its_lease_writes_nothing_more(path, monkeypatch, text):
    refuse_locks(monkeypatch)
    lease = path.with_name(".lock.lease")
    with hold_lock(path):
        write_text(path.parent / "file", "1")
        lease.unlink()
        if text:
            lease.write_text(text)
        with pytest.raises(InputError, match=r"\.lock\.lease"):
            write_text(path.parent / "file", "2")
    assert (path.parent / "file").read_text() == "1" and lease.exists() == (text is not None)


@pytest.mark.parametrize("text", ['["node7", 12, "3", "0"]', "", "[1]"])
def test_the_lease_of_another_host_is_named_with_the_command_that_removes_it(
    path, monkeypatch, text
):
    refuse_locks(monkeypatch)
    lease = write_lease(path, "", 0, "")
    lease.write_text(text)
    path.touch()
    assert lock_holder(path) == ("process 12 on node7" if "node7" in text else "another process")
    with pytest.raises(InputError) as refused, hold_lock(path):
        pass
    assert f"rm '{lease}'" in str(refused.value)
    lease.unlink()
    with hold_lock(path):
        pass


def test_a_lease_that_was_taken_over_in_the_meantime_is_put_back(path, monkeypatch):
    """The second process has seen a dead lease and moves the one by which the first replaced it."""
    refuse_locks(monkeypatch)
    lease = write_lease(path, platform.node(), 2**22 + 1, "1")
    path.touch()
    has_died, first = module._has_died, hold_lock(path)

    def see_before_the_first(text):
        monkeypatch.setattr(module, "_has_died", has_died)
        assert has_died(text)
        first.__enter__()
        return True

    monkeypatch.setattr(module, "_has_died", see_before_the_first)
    with pytest.raises(InputError, match=f"process {os.getpid()}"), hold_lock(path):
        pass
    assert lease.exists() and lock_holder(path) is not None
    (path.parent / "file").touch()
    first.__exit__(None, None, None)
    assert sorted(entry.name for entry in path.parent.iterdir()) == [".lock", "file"]


def test_only_one_process_takes_over_a_dead_lease(path, monkeypatch):
    refuse_locks(monkeypatch)
    switch = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(20):
            write_lease(path, platform.node(), 2**22 + 1, "1")
            start, end, won, lost = threading.Barrier(4), threading.Barrier(4), [], []

            def take(start=start, end=end, won=won, lost=lost):
                start.wait()
                try:
                    with hold_lock(path):
                        won.append(1)
                        end.wait()
                except InputError:
                    lost.append(1)
                    end.wait()

            threads = [threading.Thread(target=take) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert (len(won), len(lost)) == (1, 3)
    finally:
        sys.setswitchinterval(switch)
