"""Reports: numbers, figures and pages of campaigns, searches and comparisons."""

from abhv_mc.kernel.cache import cache_root

# Before matplotlib is imported, which writes its files there if there is no home folder.
cache_root()
