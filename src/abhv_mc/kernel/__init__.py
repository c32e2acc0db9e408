"""Compiled code of flights and stability margins, whose hash names the cache folder.

It imports no other part of the package. It defines the order of tables (parameters, state,
statistics); names, units and descriptions of their entries are defined in the layers above.
"""
