"""Numerical methods that know nothing of roads: optimiser, robust statistics, derivatives."""
