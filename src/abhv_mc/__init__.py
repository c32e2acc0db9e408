"""Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.

In a notebook::

    import abhv_mc

    results = abhv_mc.Campaign.read("campaign.yaml").run()
    results = abhv_mc.open_results("reports/campaign")  # what was flown before
    flight = abhv_mc.fly("turn", "abhv", {"base": "tlc", "limits.bank": "60 deg"}, {"aero.drag": 1.1})
    table = abhv_mc.trim("abhv", bank=["0 deg", "50 deg"])
    table = abhv_mc.margins("level", "abhv", "tlc", at="trim")
    model = abhv_mc.linearize("level", "abhv", "tlc", at="30 s")
    found = abhv_mc.worst("s_manoeuvre", "reports/worst", "altitude_error_max_m")  # and rare, tune, compare

Importing this package is cheap: what is heavy is imported where it is used.
"""

from typing import Any

__version__ = "0.1.0"
_MODULES = ("extend", "plots", "statistics", "topics")  # public as they are
_ADDED = ("tune",)  # by packages, as entry points of the group abhv_mc.functions
__all__ = [
    "Campaign", "InputError", "InputErrors", "LinearModel", "Results", "StateSpace", "__version__", "compare", "extend",
    "fly", "fly_on", "linearize", "margins", "open_results", "plots", "rare", "simulate", "statistics", "topics",
    "trim", "tune", "worst",
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
        return getattr(import_module("abhv_mc.api"), name)
    raise AttributeError(f"module 'abhv_mc' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
