"""A campaign's report: numbers, figures, page."""

from abhv_mc.kernel.cache import cache_root

cache_root()  # before matplotlib is imported, which keeps files there if there is no home folder
