"""The lock of a folder: one holder, who is named."""

import fcntl
import threading

import pytest

from abhv_mc.folder.lock import hold_lock, lock_holder
from abhv_mc.io.input_error import InputError


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
