"""Settings of Python and numpy that reduce the processor time of a start."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import LazyLoader, find_spec, module_from_spec
from typing import Any


@contextmanager
def fewer_collections() -> Iterator[None]:
    """Start the garbage collector only after 300,000 new objects until the context ends.

    Imports and kernels create many objects that stay alive.
    """
    before = gc.get_threshold()
    gc.set_threshold(300_000, 10, 10)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def postpone_tools() -> None:
    """Load two packages of numpy on first use; scipy.special would import them without need."""
    import numpy as np

    for name in {"f2py", "testing"} - vars(np).keys():
        spec: Any = find_spec(f"numpy.{name}")
        spec.loader = LazyLoader(spec.loader)
        sys.modules[spec.name] = module = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, name, module)
