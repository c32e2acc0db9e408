"""Temporary working folder of a simulator process, with copies of its files."""

import contextlib
import functools
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import threading
from pathlib import Path

from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.io.messages import InputError, is_exhausted

# Program of a watcher, which ends simulators and deletes their folders if abhv-mc is killed.
# The program reads "+NAME" and "-NAME"; a name is a process group's ID or a folder's path.
_PROGRAM = """
import os, shutil, sys, time
names = set()
for line in sys.stdin:
    (names.add if line[0] == "+" else names.discard)(line[1:-1])
folders = {name for name in names if not name.isdigit()}
for process in names - folders:
    try:
        os.killpg(int(process), 9)
    except OSError:
        pass
for _ in range(20):
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    if not any(map(os.path.exists, folders)):
        break
    time.sleep(0.1)
"""
_lock = threading.Lock()


def watch(name: int | str) -> None:
    """Register a process group to end or a folder to delete if this process dies."""
    _tell(f"+{name}\n")


def unwatch(name: int | str) -> None:
    """Undo :func:`watch` once the process has ended or the folder is deleted."""
    _tell(f"-{name}\n")


def _tell(line: str) -> None:
    with _lock, contextlib.suppress(OSError):
        os.write(_pipe(os.getpid()), os.fsencode(line))


@functools.cache
def _pipe(_: int) -> int:
    """Return the pipe to this process's watcher; start the watcher on first use."""
    theirs, ours = os.pipe()
    os.posix_spawn(
        sys.executable,
        [sys.executable, "-ISc", _PROGRAM],
        os.environ,
        file_actions=[(os.POSIX_SPAWN_DUP2, theirs, 0)],
        setpgroup=0,
    )
    os.close(theirs)
    return ours


_LARGEST_COPY = 1 << 24  # size in bytes above which files are linked
_BINARY = (b"\x7fELF", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe")


def delete_working_folder(folder: Path) -> None:
    """Delete the working folder of a process and all its content."""
    shutil.rmtree(folder, ignore_errors=True)
    unwatch(str(folder))


def make_working_folder(plan: UserPlan) -> Path:
    """Return a new folder under ``TMPDIR`` with the declared files of ``plan``.

    Large files and compiled programs are linked. Copies of programs would not run on a file system
    that is mounted noexec. Scripts are copied, because many scripts change to their own folder.
    Raise InputError if a file has changed since the start of the campaign.
    """
    try:
        folder = Path(os.path.realpath(tempfile.mkdtemp(prefix="abhv-mc-simulator-")))
        watch(str(folder))
    except OSError as error:
        raise _unusable_place(error) from None
    try:
        for name, digest in plan.files:
            _place(Path(plan.folder, name), folder / name, digest, plan)
        for name in plan.folders:
            (folder / name).mkdir(parents=True, exist_ok=True)
    except BaseException as error:
        delete_working_folder(folder)
        if isinstance(error, OSError) and not is_exhausted(error):
            raise _unusable_place(error) from None
        raise
    return folder


def _place(source: Path, target: Path, digest: str, plan: UserPlan) -> None:
    """Copy or link one file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        status = source.stat()
        mode = stat.S_IMODE(status.st_mode)
        with source.open("rb") as file:
            is_program = bool(mode & stat.S_IXUSR) and file.read(4).startswith(_BINARY)
        is_linked = is_program or status.st_size > _LARGEST_COPY
        content = b"" if is_linked else source.read_bytes()
        actual_digest = (
            _hash_file(source, status.st_ino, status.st_size, status.st_mtime_ns)
            if is_linked
            else hashlib.sha256(content).hexdigest()
        )
    except OSError as error:
        if is_exhausted(error):
            raise
        actual_digest = ""
    if actual_digest != digest:
        message = "the file has changed since the start of the campaign, or is missing"
        raise InputError(source, message, "the original file")
    if is_linked:
        target.symlink_to(source)
    else:
        target.write_bytes(content)
        target.chmod(mode)


@functools.lru_cache(maxsize=256)
def _hash_file(path: Path, *_signature: int) -> str:
    """Return the SHA-256 of a file; ``_signature`` changes whenever the file changes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _unusable_place(error: OSError) -> InputError:
    return InputError(
        tempfile.gettempdir(),
        f"the working folder of a simulator cannot be created ({error.strerror or error})",
        "free space, or another folder in TMPDIR",
    )
