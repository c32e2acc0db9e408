"""All that is compiled for flights and margins, and nothing else: its hash names the folder of compiled code.

It imports nothing else of the package. Orders of tables (parameters, state, statistics) are facts of it; what their
entries are called, their units and words stand above.
"""
