"""The settings of a law of one's own, as its controller file gives them."""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control.law_file import PythonController
from abhv_mc.io.documents import Document, InputError, InputErrors, Refusal, one_of
from abhv_mc.io.units import parse_in_unit
from abhv_mc.user_code.source import Law


def make_own_settings(document: Document, controller: PythonController, law: Law) -> Floats:
    """The numbers of the class ``Settings`` in its order, SI. Raises InputErrors with line and column."""
    kind = law.settings
    known = kind._fields if kind is not None else ()
    errors: list[InputError] = []
    for name in controller.settings:
        if name not in known:
            wanted = one_of(known, name) if known else "no settings: the law has no class Settings"
            errors.append(document.key_error(("settings", name), f"unknown key '{name}'", wanted))
    values = []
    for name in known:
        if name not in controller.settings:
            if name not in kind._field_defaults:
                errors.append(document.error(("settings",), f"no key '{name}'", f"'{name}' here"))
            values.append(float(kind._field_defaults.get(name, np.nan)))
            continue
        try:
            values.append(parse_in_unit(controller.settings[name], law.mark.units.get(name, "-")))
        except Refusal as refusal:
            errors.append(document.error(("settings", name), refusal.found, refusal.wanted))
    if errors:
        raise InputErrors(errors)
    return np.array(values, dtype=np.float64)
