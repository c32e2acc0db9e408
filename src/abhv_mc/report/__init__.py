"""Reports: numbers, figures and pages of campaigns, searches and comparisons."""

from abhv_mc.kernel.cache import cache_root

# Matplotlib needs this cache folder on import if there is no home folder.
cache_root()
