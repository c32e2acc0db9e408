"""Benchmark of the compiled flight, relative to the peak performance of the machine."""
