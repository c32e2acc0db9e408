"""Functions that plot the figures of a report from arrays."""

from abhv_mc.topics.comparison.figures import (
    DifferencePanel,
    plot_differences,
    plot_error_against_usage,
)
from abhv_mc.topics.figure_bands import EnvelopePanel, EnvelopeRow, plot_envelopes
from abhv_mc.topics.metrics.figures import Spread, plot_distributions

__all__ = [
    "DifferencePanel",
    "EnvelopePanel",
    "EnvelopeRow",
    "Spread",
    "plot_differences",
    "plot_distributions",
    "plot_envelopes",
    "plot_error_against_usage",
]
