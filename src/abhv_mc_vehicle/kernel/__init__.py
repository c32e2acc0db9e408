"""Compiled code that simulates flights and computes stability margins.

The subpackage imports no other part of abhv-mc. It defines the order of parameters, states and
statistics; other subpackages define their units and descriptions.
"""
