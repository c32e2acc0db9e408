"""Topics of a report, each with its numbers, figures and section.

Custom topics import the public names of this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from abhv_mc.cache_root import cache_root

# Without a home folder, matplotlib needs a configuration folder when it is imported.
cache_root()

if TYPE_CHECKING:
    from abhv_mc.folder.flown_campaign import FlownCampaign
    from abhv_mc.topics.registry import register
    from abhv_mc.topics.topic import (
        Cell,
        FigureText,
        Fold,
        Heading,
        Names,
        Picture,
        Section,
        Table,
        Text,
        Topic,
    )

_HOMES = {
    "FlownCampaign": "abhv_mc.folder.flown_campaign",
    "register": "abhv_mc.topics.registry",
}

__all__ = [
    "Cell", "FigureText", "FlownCampaign", "Fold", "Heading", "Names", "Picture",
    "Section", "Table", "Text", "Topic", "register",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Return a public object, which is imported on first use to avoid circular imports."""
    if name not in __all__:
        raise AttributeError(f"module 'abhv_mc.topics' has no attribute '{name}'")
    return getattr(import_module(_HOMES.get(name, "abhv_mc.topics.topic")), name)
