"""What a user should know beside the results, on standard error: that code is compiled, what looks doubtful."""

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from abhv_mc.cli.printing import say

_TIMES = "compiled.json"  # beside the folders of compiled code: seconds that each took last time on this machine
_PARTS = {
    "flight": "the flight", "stability": "a part of the stability margins", "laws": "the reference",
    "numerics": "the ranking of flights",
}  # fmt: skip


def announce_compiling() -> None:
    """From here on, tell standard error what is compiled instead of found in the cache, or waited for, and how long."""
    from abhv_mc.kernel.jit import PLAIN, tell_compiling

    if PLAIN:
        words = "NUMBA_DISABLE_JIT is set: nothing is compiled, and flights take thousands of times as long"
        say(f"warning: {words}", file=sys.stderr, flush=True)
    tell_compiling(_tell)


@contextmanager
def _tell(function: Any, elsewhere: bool) -> Iterator[None]:
    """While a kernel is compiled, here or by another process that is waited for."""
    from abhv_mc.execution.progress import Waiting
    from abhv_mc.kernel.cache import user_folder

    part = _PARTS.get(function.__module__.removeprefix("abhv_mc.kernel.").split(".")[0], "a part")
    if elsewhere:
        with Waiting(f"waiting for another process, which compiles {part}"):
            yield
        return
    file, name = user_folder("XDG_CACHE_HOME", ".cache") / _TIMES, f"{function.__module__}.{function.__name__}"
    try:
        times = json.loads(file.read_text())
        before = f"; {times[name]:.0f} s last time" if name in times else ""
    except (OSError, ValueError):
        times, before = {}, ""
    with Waiting(f"compiling {part} for this machine (once per kind of campaign{before})") as waiting:
        yield
    with suppress(OSError):
        file.write_text(json.dumps(times | {name: round(waiting.seconds, 1)}))


def announce_warnings(warnings: Iterable[str]) -> None:
    """What deserves a second look about the mission of these flights, each sentence once."""
    for warning in dict.fromkeys(warnings):
        say(f"warning: {warning}", file=sys.stderr, flush=True)
