"""Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.

In a notebook::

    import abhv_mc

    results = abhv_mc.Campaign.read("campaign.yaml").run()
    results = abhv_mc.open_results("reports/campaign")  # what was flown before

Importing this package is cheap: what is heavy is imported where it is used.
"""

from typing import Any

__version__ = "0.1.0"
__all__ = ["Campaign", "CampaignResults", "__version__", "open_results"]

_NOTEBOOK = ("Campaign", "CampaignResults", "open_results")


def __getattr__(name: str) -> Any:
    if name in _NOTEBOOK:
        from importlib import import_module

        return getattr(import_module("abhv_mc.notebook"), name)
    raise AttributeError(f"module 'abhv_mc' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *_NOTEBOOK])
