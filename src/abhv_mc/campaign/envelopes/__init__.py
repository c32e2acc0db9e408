"""Envelopes over all flights, collected as blocks land."""
