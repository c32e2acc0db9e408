"""Reports: numbers, figures and pages of campaigns, searches and comparisons."""

from abhv_mc.cache_root import cache_root

# Without a home folder, matplotlib needs a configuration folder when it is imported.
cache_root()
