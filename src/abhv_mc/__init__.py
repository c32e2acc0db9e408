"""Monte Carlo dispersion analysis of a six-degree-of-freedom air-breathing hypersonic vehicle.

Importing this package is cheap: what is heavy is imported where it is used.
"""

__version__ = "0.1.0"
