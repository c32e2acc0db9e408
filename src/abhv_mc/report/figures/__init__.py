"""Figures fit for print: every `plot_*` takes arrays and returns a matplotlib Figure; no pyplot, no global state."""
