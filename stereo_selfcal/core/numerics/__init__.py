"""Numerical methods that are independent of roads: optimiser, robust statistics, derivatives."""
