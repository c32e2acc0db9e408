"""A user's Python code as it may run: made of nothing but what it declares.

It is run once in a child process under a watch, before it runs anywhere else; what was found right is noted by its
hash in the user's cache. Laws and channels in Python all come through :func:`check_closure`.
"""

import hashlib
from types import FunctionType

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.compiler_target import code_folder
from abhv_mc.kernel.jit import compiler
from abhv_mc.user_code.child import LostError, in_child
from abhv_mc.user_code.compiled import code_hash
from abhv_mc.user_code.design import DesignModel, design_gains
from abhv_mc.user_code.load_law import load_law
from abhv_mc.user_code.module import Law, run_module
from abhv_mc.user_code.native import NativeLaw
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import in_its_folder
from abhv_mc.user_code.vehicle_functions import find_code, load_functions
from abhv_mc.user_code.watch import watching
from abhv_mc.vehicle.vehicle_code import VehicleCode

_LONGEST = 600.0  # s that a file may run


def check_closure(source: UserSource) -> None:
    """Run a Python file in the child, once for each content. Raises InputError for what it does or reads wrong."""
    key = hashlib.sha256(f"{source.hash} {source.file} {code_hash()}".encode()).hexdigest()[:24]
    note = code_folder(compiler()) / "laws" / f"closed_{key}"
    if note.exists():
        return
    try:
        in_child(_run_watched, source, limit=_LONGEST)
    except LostError as lost:
        found = f"a file that does not run: {lost.words}"
        raise InputError(source.file, found, "a file that runs on its own") from None
    note.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with atomic_write(note) as temporary:
        temporary.write_text("", encoding="utf-8")


def _run_watched(source: UserSource) -> None:
    run_module.cache_clear()  # a module that ran already opens nothing
    with watching(source):
        run_module(source)


def watched_design(law: Law | NativeLaw, model: DesignModel, settings: Floats) -> tuple[tuple[str, ...], Floats]:
    """Names and columns [tick, gain] of what the law's design gives, run in the child under the watch.

    Raises InputError.
    """
    if law.design is None:
        return (), np.empty((len(model.table), 0))
    if isinstance(law, NativeLaw) and not str(law.design).endswith(".py"):
        return law.read_gains(model.time)
    given = law if isinstance(law, NativeLaw) else law.source
    return in_child(_design, given, model, settings, find_code(model.vehicle))


def _design(
    law: NativeLaw | UserSource, model: DesignModel, settings: Floats, code: VehicleCode | None
) -> tuple[tuple[str, ...], Floats]:
    if code is not None:
        load_functions(code, model.vehicle)
    source = law.design_source() if isinstance(law, NativeLaw) else law
    with in_its_folder(source), watching(source):
        if isinstance(law, NativeLaw):
            design, given = run_module(source).names.get("design"), law.make_settings(settings)
            if not isinstance(design, FunctionType):
                raise InputError(source.file, "no function design", "def design(model, settings)")
            return design_gains(source, design, model, given)
        loaded = load_law(law)
        given = loaded.settings(*settings.tolist()) if loaded.settings is not None else None
        return design_gains(source, loaded.design, model, given)
