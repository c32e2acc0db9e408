"""Say why the first flight of a version takes its time."""

import sys


def announce_compiling() -> None:
    """From here on, tell standard error once when the flight is being compiled instead of found in the cache."""
    from abhv_mc.jit import on_first_compile

    on_first_compile(
        lambda: print(
            "compiling the flight for this machine (about half a minute, once per version)", file=sys.stderr, flush=True
        )
    )
