"""Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.

===================================== =============================================================
``Campaign``, ``open_results``,       campaigns and their results
``Results``
``fly``, ``trim``, ``simulate``       single flights, steady flight, tables of inputs
``Plant``                             flights that are advanced step by step
``margins``, ``linearize``,           stability margins and linear models
``fly_on``, ``LinearModel``,
``StateSpace``
``worst``, ``rare``, ``tune``         worst cases, rare failures, controller gains
``compare``                           comparison of two campaigns
``InputError``, ``InputErrors``       errors of invalid files and arguments
``extend``, ``topics``                interfaces for custom controllers and report sections
``statistics``, ``plots``             functions on arrays, and figures
===================================== =============================================================

Large modules are imported on first use.

Examples
--------
>>> import abhv_mc
>>> results = abhv_mc.Campaign.read("s_manoeuvre").run()  # doctest: +SKIP
>>> results.summary[0]  # doctest: +SKIP
"""

from typing import Any

from abhv_mc.version import __version__

_MODULES = ("extend", "plots", "statistics", "topics")
# functions that other packages register in the entry point group abhv_mc.functions
_ADDED = ("tune",)
__all__ = [
    "Campaign", "InputError", "InputErrors", "LinearModel", "Plant", "Results", "StateSpace",
    "__version__", "compare", "extend", "fly", "fly_on", "linearize", "margins", "open_results",
    "plots", "rare", "simulate", "statistics", "topics", "trim", "tune", "worst",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name in _MODULES:
        return import_module(f"abhv_mc.{name}")
    if name in _ADDED:
        from abhv_mc.entry_points import FUNCTIONS, load_entry_point

        function = load_entry_point(FUNCTIONS, name)
        if function is None:
            raise AttributeError(f"abhv_mc.{name} is in a package that is not installed")
        return function
    if name in __all__:
        from abhv_mc.process_settings import postpone_numpy_tools

        postpone_numpy_tools()
        return getattr(import_module("abhv_mc.api"), name)
    raise AttributeError(f"module 'abhv_mc' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
