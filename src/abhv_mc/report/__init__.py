"""Reports: numbers, figures and pages of campaigns, searches and comparisons."""

from abhv_mc.kernel.cache import cache_root

# If there is no home folder, matplotlib needs this cache folder when it is imported.
cache_root()
