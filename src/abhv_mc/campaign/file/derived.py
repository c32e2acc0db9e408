"""What a campaign file's derived inputs must be to each other and to the nominal vehicle."""

import math

import numpy as np

from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.sampling.derived import Derived, compile_derived
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.io.documents import Document, InputError, Refusal, one_of
from abhv_mc.plant.parameters import Parameters

_SAME = 1e-9  # by how much of itself a nominal value may be rounded


def check_derived(document: Document, model: Campaign, parameters: Parameters, errors: list[InputError]) -> Derived:
    """The campaign's derived inputs; what is wrong is added to ``errors``."""
    made = []
    nominal = full_rows((), np.empty((1, 0)), (), parameters)
    for name, text in model.derived.items():
        where = ("derived", name)
        if name not in parameters:
            expected = one_of(parameters.dispersible, name)
            errors.append(document.key_error(where, f"unknown parameter '{name}'", expected))
            continue
        try:
            each = compile_derived(name, text, parameters)
            others = sorted(other for other in each.of if other in model.derived and other != name)
            if others:
                raise Refusal(f"'{others[0]}', which is derived itself", "what is drawn, or its expression")
            if seeds := sorted(each for each in {name, *each.of} if parameters[each].seed):
                raise Refusal(f"'{seeds[0]}', a seed", "what is a quantity")
            value, usual = float(each.evaluate(nominal)[0]), parameters[name].nominal
            if not (value == usual or math.isclose(value, usual, rel_tol=_SAME, abs_tol=_SAME)):
                found = f"{value:g} where all others are nominal"
                wish = f"{usual:g}, so that the nominal flight stays it (a bias is the mean of a distribution)"
                raise Refusal(found, wish)
            made.append(each)
        except Refusal as refusal:
            errors.append(document.error(where, refusal.found, refusal.expected))
    return tuple(made)
