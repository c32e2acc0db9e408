"""Detection of files that native code reads unnoticed by Python audit hooks (Linux only)."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from abhv_mc.custom_code.read_guard import is_regular, simulator_guard
from abhv_mc.external_simulators.user_plan import UserPlan

_PACKAGES = {"site-packages", "dist-packages"}


def find_native_reads(processes: Iterable[int], plan: UserPlan, started: float) -> list[str]:
    """Return undeclared files that ``processes`` and their descendants map or keep open.

    Files created after ``started`` (s since the epoch) are omitted, because the processes probably
    created them. For programs other than Python functions, only files in the folders of the
    simulator and the campaign are returned, because the ownership of other files is unknown.
    """
    paths = set[str]()
    for process in {member for first in processes for member in _family(first)}:
        folder = _link(f"/proc/{process}/cwd")
        names = (name for name, _ in plan.files)
        guard = simulator_guard(names, plan.folder, plan.campaign_folder, folder, started)
        for path in _open_files(process):
            if not is_regular(path) or guard.allows(path) or _PACKAGES & set(Path(path).parts):
                continue
            if plan.python or path.startswith(guard.studies):
                paths.add(path)
    return sorted(paths)


def _family(process: int) -> set[int]:
    """Return the IDs of a process and its descendants."""
    family = {process}
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                family |= _family(int(child))
    return family


def _open_files(process: int) -> set[str]:
    """Return the paths of files that a process has opened for reading or mapped."""
    paths = set[str]()
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{process}/maps").read_text(errors="replace").splitlines()
        paths = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(f"/proc/{process}/fd"):  # noqa: PTH208
            if _is_read(process, descriptor):
                paths.add(_link(f"/proc/{process}/fd/{descriptor}"))
    return paths - {""}


def _is_read(process: int, descriptor: str) -> bool:
    """Return whether a file descriptor is open for reading."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        text = Path(f"/proc/{process}/fdinfo/{descriptor}").read_text()
        flags = int(text.partition("flags:")[2].split()[0], 8)
        return flags & (os.O_WRONLY | os.O_RDWR) != os.O_WRONLY
    return False


def _link(path: str) -> str:
    with contextlib.suppress(OSError):
        return os.readlink(path)  # noqa: PTH115
    return ""
