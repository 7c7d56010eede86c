"""Bounds on the accuracy of any estimator."""
