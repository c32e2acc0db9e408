"""What a user should know beside the results, on standard error: that code is compiled, what looks doubtful."""

import sys
from collections.abc import Iterable

from abhv_mc.cli.printing import say


def announce_compiling() -> None:
    """From here on, tell standard error once when the flight is being compiled instead of found in the cache."""
    from abhv_mc.jit import PLAIN, on_first_compile

    if PLAIN:
        words = "NUMBA_DISABLE_JIT is set: nothing is compiled, and flights take thousands of times as long"
        say(f"warning: {words}", file=sys.stderr, flush=True)
    on_first_compile(
        lambda: say(
            "compiling the flight for this machine (about 20 seconds, once per version)", file=sys.stderr, flush=True
        )
    )


def announce_warnings(warnings: Iterable[str]) -> None:
    """What deserves a second look about the mission of these flights, each sentence once."""
    for warning in dict.fromkeys(warnings):
        say(f"warning: {warning}", file=sys.stderr, flush=True)
