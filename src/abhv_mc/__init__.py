"""Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.

In a notebook::

    import abhv_mc

    results = abhv_mc.Campaign.read("campaign.yaml").run()
    results = abhv_mc.open_results("reports/campaign")  # what was flown before
    flight = abhv_mc.fly("turn", "ghame_x", {"base": "tlc", "limits.bank": "60 deg"}, {"aero.drag": 1.1})
    table = abhv_mc.trim("ghame_x", bank=["0 deg", "50 deg"])
    table = abhv_mc.margins("level", "ghame_x", "tlc", at="trim")
    model = abhv_mc.linearize("level", "ghame_x", "tlc", at="30 s")
    found = abhv_mc.worst("s_manoeuvre", "reports/worst", "altitude_error_max_m")  # and rare, tune, compare

Importing this package is cheap: what is heavy is imported where it is used.
"""

from typing import Any

__version__ = "0.1.0"
__all__ = [
    "Campaign",
    "CampaignResults",
    "__version__",
    "compare",
    "fly",
    "fly_on",
    "linearize",
    "margins",
    "open_results",
    "rare",
    "trim",
    "tune",
    "worst",
]

_HOMES = {
    "Campaign": "abhv_mc.notebook",
    **dict.fromkeys(("CampaignResults", "open_results"), "abhv_mc.campaign_results"),
    **dict.fromkeys(("compare", "rare", "tune", "worst"), "abhv_mc.searching"),
    **dict.fromkeys(("fly", "trim"), "abhv_mc.flying"),
    **dict.fromkeys(("fly_on", "linearize", "margins"), "abhv_mc.linearizing"),
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'abhv_mc' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
